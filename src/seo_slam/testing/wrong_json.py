"""Right replies made wrong: JSON that is valid and still not what was asked for."""

import json
from collections.abc import Callable
from typing import Any, Literal

WrongKind = Literal["shape", "list", "missing", "unknown_boxes", "coordinates", "ids_as_text", "out_of_range", "long"]
"""In which way a reply is wrong:

- shape: an object of other keys.
- list: a list with the reply in it, twice.
- missing: the last field of every object is left out.
- unknown_boxes: box numbers that nobody drew.
- coordinates: places instead of box numbers.
- ids_as_text: words instead of box numbers.
- out_of_range: every number is 1e9.
- long: all texts together as long as can be.
"""

_BOX_KEYS = ("box", "boxes", "best")


def wrong_json(right: str, kind: WrongKind, characters: int = 10_000_000) -> str:
    """Return a right reply made wrong; a reply that is no JSON counts as an empty object.

    Args:
        right: the reply as it should be.
        kind: in which way it is made wrong.
        characters: for "long": how many.
    """
    try:
        reply = json.loads(right)
    except ValueError:
        reply = {}
    if kind == "shape":
        reply = {"answer": 42, "explanation": "The boxes look fine to me."}
    elif kind == "list":
        reply = [reply, reply]
    elif kind == "missing":
        reply = _without_last_fields(reply)
    elif kind == "out_of_range":
        reply = _changed(reply, lambda value: 1e9 if isinstance(value, int | float) else value)
    elif kind == "long":
        each = characters // max(_count_texts(reply), 1)
        reply = _changed(reply, lambda value: "long " * (each // 5) if isinstance(value, str) else value)
    else:
        reply = _with_other_boxes(reply, kind)
    return json.dumps(reply)


def _with_other_boxes(reply: Any, kind: str) -> Any:
    stand_ins: dict[str, Callable[[int], Any]] = {
        "unknown_boxes": lambda number: number + 96,
        "coordinates": lambda number: [0.25 * number, 1.5, 0.75],
        "ids_as_text": lambda number: f"landmark {number}",
    }
    made = stand_ins[kind]
    changed = _changed_boxes(reply, made)
    if changed == reply and isinstance(reply, dict):  # a description names no boxes
        changed = {"box": made(1), **reply}
    return changed


def _changed_boxes(reply: Any, made: Callable[[int], Any]) -> Any:
    if isinstance(reply, list):
        return [_changed_boxes(entry, made) for entry in reply]
    if not isinstance(reply, dict):
        return reply
    return {
        key: _changed(value, lambda number: made(number) if isinstance(number, int) else number)
        if key in _BOX_KEYS
        else _changed_boxes(value, made)
        for key, value in reply.items()
    }


def _changed(reply: Any, change: Callable[[Any], Any]) -> Any:
    """Apply ``change`` to everything that is neither object nor list."""
    if isinstance(reply, list):
        return [_changed(entry, change) for entry in reply]
    if isinstance(reply, dict):
        return {key: _changed(value, change) for key, value in reply.items()}
    return change(reply)


def _without_last_fields(reply: Any) -> Any:
    if isinstance(reply, list):
        return [_without_last_fields(entry) for entry in reply]
    if not isinstance(reply, dict):
        return reply
    kept = list(reply.items())
    if kept and not (isinstance(kept[-1][1], list) and kept[-1][1]):
        kept.pop()
    return {key: _without_last_fields(value) for key, value in kept}


def _count_texts(reply: Any) -> int:
    if isinstance(reply, list):
        return sum(map(_count_texts, reply))
    if isinstance(reply, dict):
        return sum(map(_count_texts, reply.values()))
    return int(isinstance(reply, str))
