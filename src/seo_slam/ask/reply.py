"""The question as a chat model gets it, and what of its reply is believed."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from seo_slam.agents.asking import ask as ask_model
from seo_slam.agents.prompts import prompt
from seo_slam.ask.claims import fault_in, ids_in
from seo_slam.ask.retrieval import Retrieved
from seo_slam.ask.words import LONGEST_LABEL, place_of, printable, unseen_for_s
from seo_slam.interfaces import ChatModel, ChatRequest
from seo_slam.map import Map
from seo_slam.types import Landmark

_MOST_WORDS = 4
_MOST_TOKENS = 500  # several things with reasons; the 250 of SEO-SLAM IV-B are for one edit


class CitedLandmark(BaseModel):
    """One thing that an answer is about."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    id: int = Field(description="The id of a landmark that was given.")
    why: str = Field(max_length=300, description="Why it serves the request, in a few words.")


class MapReply(BaseModel):
    """What the model is to reply."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    answer: str = Field(min_length=1, max_length=2000, description="The answer in one to four sentences.")
    landmarks: list[CitedLandmark] = Field(max_length=50, description="The landmarks that serve the request, the best first.")


@dataclass(slots=True)
class _Referee:
    """Checks replies against what the model was given, and remembers the last reason to refuse one."""

    given: Mapping[int, Landmark]
    lengths_m: Sequence[float]
    complaint: str = field(default="", init=False)

    def __call__(self, reply: MapReply) -> str:
        self.complaint = self._fault(reply)
        return self.complaint

    def _fault(self, reply: MapReply) -> str:
        if not tidy(reply.answer):
            return "the answer is empty"
        unknown = [row.id for row in reply.landmarks if row.id not in self.given]
        if unknown:
            return f"it names landmark {unknown[0]!s:.40}, which was not given (ids: {', '.join(map(str, self.given))})"
        positions_m = {i: row.position_m for i, row in self.given.items()}
        texts = (tidy(text) for text in (reply.answer, *(row.why for row in reply.landmarks)))  # as they will be read
        faults = (fault_in(text, positions_m, self.lengths_m) for text in texts)
        return next((fault for fault in faults if fault), "")


async def reply_of(chat: ChatModel, question: str, found: Sequence[Retrieved], map_: Map) -> tuple[MapReply | None, str]:
    """Ask a chat model about retrieved things.

    Returns:
        The reply, whose every id and figure is one that the model was given, and ""; or None and why there is none.

    Raises:
        AgentError: no reply could be had.
    """
    rows = [hit.landmark for hit in found]
    places = {row.id: place_of(row, map_) for row in rows}
    lengths_m = [*(float(x) for row in rows for x in row.size_m), *(place.distance_m for place in places.values() if place)]
    referee = _Referee({row.id: row for row in rows}, lengths_m)
    reply = await ask_model(chat, request_for(question, found, map_), MapReply, referee)
    return reply, "" if reply else referee.complaint or "it was not in the form that was asked for"


def request_for(question: str, found: Sequence[Retrieved], map_: Map) -> ChatRequest:
    """The request: the question and the things as one line of JSON, since both are data and no instruction."""
    data = {"question": printable(question.strip()), "landmarks": [_as_data(hit.landmark, map_) for hit in found]}
    return ChatRequest(
        system=prompt("ask").text,
        text=json.dumps(data, ensure_ascii=False, allow_nan=False),
        max_tokens=_MOST_TOKENS,
    )


def cited_ids(reply: MapReply, known: Sequence[int]) -> dict[int, str]:
    """Id -> why, "" for those that only the text names; in the order of the reply."""
    whys: dict[int, str] = {}
    for row in reply.landmarks:
        whys.setdefault(row.id, " ".join(tidy(row.why).split()))
    return whys | {i: "" for i in ids_in(tidy(reply.answer), known) if i not in whys}


def tidy(text: str) -> str:
    """Text of a model without characters that could steer a terminal or hide; line ends stay, other white space becomes spaces."""
    shown = "".join(c if c == "\n" or c.isprintable() else " " if c.isspace() else "" for c in text)
    return "\n".join(line.rstrip() for line in shown.strip().split("\n"))


def _as_data(landmark: Landmark, map_: Map) -> dict[str, Any]:
    others = sorted((word for word in landmark.labels if word != landmark.label), key=lambda word: (-landmark.labels[word], word))
    place = place_of(landmark, map_)
    return {
        "id": landmark.id,
        "label": _clean(landmark.label),
        "category": _clean(landmark.category),
        "other_words": [_clean(word) for word in others[:_MOST_WORDS]],
        "position_m": _rounded(landmark.position_m),
        "size_m": _rounded(landmark.size_m),
        "place": _clean(place.words(landmark, with_id=False), 2 * LONGEST_LABEL) if place else "",
        "seen_times": landmark.observations,
        "last_seen_s_ago": round(unseen_for_s(landmark, map_), 1),
        "state": landmark.state,
        "existence": round(float(landmark.existence), 2),
    }


def _rounded(values: Any) -> list[float]:
    return [round(float(x), 2) + 0.0 for x in np.asarray(values)]


def _clean(text: str, longest: int = LONGEST_LABEL) -> str:
    return printable(text)[:longest]
