"""What each agent's model is to reply (SEO-SLAM Fig 5), as types: the form only. What a field means for the map is the agents' business."""

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

NOT_AVAILABLE = "N/A"


def _without_null(value: Any) -> Any:
    return NOT_AVAILABLE if value is None else value  # null is how JSON says N/A


Words = Annotated[str, BeforeValidator(_without_null)]


class Reply(BaseModel):
    """Base of all replies: unknown fields, NaN and infinity are refused; a number in quotes is a number."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Verdict(Reply):
    """What is in one box."""

    box: int = Field(description="number at the rectangle")
    object: Words = Field(description="what is in it, in plain words, or N/A")
    score: float = Field(description="1.0 the label fits, 0.0 it is something else, -1.0 no thing, or unclear")


class Verification(Reply):
    """A verdict for each box."""

    verdicts: tuple[Verdict, ...] = Field(max_length=64)


class Description(Reply):
    """What the thing is; both labels N/A: nothing can be recognised."""

    matched_label: Words = Field(description="the known label that fits, or N/A")
    generated_label: Words = Field(description="a new label, or N/A")
    category: Words = Field(description="the plain word for such a thing, or N/A")


class Duplicates(Reply):
    """Boxes around one thing."""

    boxes: tuple[int, ...] = Field(max_length=64)
    best: int = Field(description="the most complete, least hidden of them")


class Merging(Reply):
    """All groups of duplicates; none if there are none."""

    duplicates: tuple[Duplicates, ...] = Field(max_length=64)
