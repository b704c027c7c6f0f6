"""Reads what an agent asks a chat model: the last line of the text is JSON, and its keys tell the role."""

import json
from dataclasses import dataclass
from typing import Any, Literal

from seo_slam.interfaces import ChatRequest

ChatRole = Literal["verification", "description", "merging", "other"]


@dataclass(frozen=True, slots=True)
class AskedBox:
    """A box that a question is about.

    Attributes:
        number: drawn at the box.
        label: what the map calls it.
        position_m: (x, y, z) where the map has it, if the question says so.
    """

    number: int
    label: str
    position_m: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Question:
    """A question of an agent, read.

    Attributes:
        role: which agent asks; "other" is a question of someone else, such as a probe of what the server can do.
        boxes: what it is about, in the order of the question.
        known_labels: description: labels given so far.
        separate_beyond_m: merging: what is further apart is to be left apart.
    """

    role: ChatRole
    boxes: tuple[AskedBox, ...] = ()
    known_labels: tuple[str, ...] = ()
    separate_beyond_m: float = float("inf")


def question_of(request: ChatRequest) -> Question:
    """Read a request; whatever cannot be read as a question of the three agents has the role "other"."""
    try:
        asked = json.loads(request.text.rstrip().rpartition("\n")[2])
        boxes = tuple(_asked_box(entry) for entry in asked["landmarks"])
        known_labels = tuple(str(label) for label in asked.get("known_labels", ()))
        separate_beyond_m = float(asked.get("separate_beyond_m", "inf"))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return Question("other")
    return Question(_role(asked), boxes, known_labels, separate_beyond_m)


def role_of(request: ChatRequest) -> ChatRole:
    """Return which agent asks: questions for known labels are descriptions, those with a distance are mergings."""
    return question_of(request).role


def _role(asked: dict[str, Any]) -> ChatRole:
    if "known_labels" in asked:
        return "description"
    return "merging" if "separate_beyond_m" in asked else "verification"


def _asked_box(entry: Any) -> AskedBox:
    position = entry.get("position_m")
    if position is not None:
        x, y, z = (float(value) for value in position)
        position = (x, y, z)
    return AskedBox(int(entry["box"]), str(entry.get("label", "")), position)
