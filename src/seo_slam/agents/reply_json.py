"""Finds JSON objects in what a chat model said, at bounded cost, whatever it said."""

import json
import math
import re
from collections.abc import Iterator
from typing import Any, NoReturn

MOST_CHARACTERS = 65_536
"""More of a reply is not looked at: a reply of 250 tokens has about 1000."""
MOST_STARTS = 32
"""Places at which an object may begin that are tried."""

_FENCE = re.compile(r"```[A-Za-z]{0,10}\s*\n?(.*?)```", re.DOTALL)
_OBJECT_BEGINS = re.compile(r'\{\s*"')
_END_OF_THOUGHT = "</think>"


def json_objects_in(text: str) -> list[dict[str, Any]]:
    """Return the different JSON objects in a reply: the whole text, else those in code fences, else those between words.

    Objects inside objects are not counted. Of a text with ``</think>`` only what comes after it counts. An object with NaN, infinity,
    a key twice or unbounded nesting is none: two readers could read it in two ways.
    """
    looked_at = text[:MOST_CHARACTERS].strip()
    said = looked_at.rpartition(_END_OF_THOUGHT)[2].strip()
    whole = _loaded(looked_at) or _loaded(said)
    if whole is not None:
        return [whole]
    fenced = [found for body in _FENCE.findall(said)[:MOST_STARTS] if (found := _loaded(body.strip())) is not None]
    return _different(fenced or list(_between_words(said)))


def _between_words(text: str) -> Iterator[dict[str, Any]]:
    start = text.find("{")
    for _ in range(MOST_STARTS):
        if start < 0:
            return
        end = start + 1
        try:
            found, end = _DECODER.raw_decode(text, start)
            yield found  # it begins with a brace: an object
        except (ValueError, RecursionError):
            if _OBJECT_BEGINS.match(text, start):
                return  # cut off or crooked: what stands inside it is not the reply
        start = text.find("{", end)


def _loaded(text: str) -> dict[str, Any] | None:
    try:
        found = _DECODER.decode(text)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _different(objects: list[dict[str, Any]]) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = []
    for candidate in objects:
        if candidate not in out:
            out.append(candidate)
    return out


def _object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) != len(pairs):
        raise ValueError("a key stands twice")
    return made


def _finite(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError("a number is too large")
    return value


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


_DECODER = json.JSONDecoder(object_pairs_hook=_object_of, parse_float=_finite, parse_constant=_refuse_constant)
