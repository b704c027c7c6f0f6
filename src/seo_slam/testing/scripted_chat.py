"""A chat model that says to each agent what a test wrote down for it."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from seo_slam.interfaces import ChatRequest
from seo_slam.simulation.chat_question import Question, question_of
from seo_slam.simulation.simple_reply import simplest_reply
from seo_slam.testing.chat_faults import Fault

Scripted = str | Fault | Mapping[str, Any] | Callable[[Question], Any]
"""A text, a fault, the JSON to be sent as an object, or a function from the question to one of these."""


def scripted(
    *,
    verification: Scripted | None = None,
    description: Scripted | None = None,
    merging: Scripted | None = None,
    other: Scripted | None = None,
) -> Callable[[ChatRequest], str | Fault]:
    """Return answers for a ``ChatServer``, one for each agent; an agent without one is told what changes nothing.

    Args:
        verification: what the verification agent is told. Without it: a match, of every box.
        description: what the description agent is told. Without it: the label that it asked with.
        merging: what the merging agent is told. Without it: no duplicates.
        other: what anyone else is told. Without it: the simplest value that fits the schema.
    """
    given: dict[str, Scripted | None] = {"verification": verification, "description": description, "merging": merging, "other": other}

    def answer(request: ChatRequest) -> str | Fault:
        question = question_of(request)
        reply: Any = given[question.role]
        if callable(reply) and not isinstance(reply, Fault):
            reply = reply(question)
        if reply is None:
            reply = simplest_reply(request) if question.role == "other" else _harmless(question)
        return reply if isinstance(reply, str | Fault) else json.dumps(reply)

    return answer


def _harmless(question: Question) -> dict[str, Any]:
    if question.role == "verification":
        return {"verdicts": [{"box": box.number, "object": box.label, "score": 1.0} for box in question.boxes]}
    if question.role == "description":
        label = question.boxes[0].label if question.boxes else "N/A"
        return {"matched_label": "N/A", "generated_label": label, "category": label}
    return {"duplicates": []}
