"""What a language model says of a map, checked: it may name only things that it was given, and no place but theirs.

The ids are those in brackets, after "landmark" or after "#". The places are numbers in digits: tuples, values of an axis, lengths.
"""

import re
import unicodedata
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from seo_slam.geometry import FloatArray

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)"
_GROUP = re.compile(rf"[(\[{{<]\s*{_NUMBER}(?:\s*[,;|\s]\s*{_NUMBER})+\s*m?\s*[)\]}}>]")
_BARE_TUPLE = re.compile(rf"{_NUMBER}(?:\s*[,;]\s*{_NUMBER})+")
_AXIS = re.compile(rf"\b([xyz])\s*(?:[:=≈]|is)?\s*({_NUMBER})", re.IGNORECASE)
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
_LENGTH = re.compile(
    rf"({_NUMBER})\s*-?\s*(?:(cm\b|centimet(?:er|re)s?\b)|(mm\b|millimet(?:er|re)s?\b)|(ft\b|feet\b|foot\b)|(inch(?:es)?\b)|(m\b|met(?:er|re)s?\b))",
    re.IGNORECASE,
)
_LENGTH_GROUPS = ("cm", "mm", "ft", "in", "m")
_BRACKETED_ID = re.compile(r"[(\[]\s*#?(\d+)\s*[)\]]")
_HASH_ID = re.compile(r"#\s*(\d+)")
_MORE_IDS = r"(?:(?:\s*(?:,|&|and|or))+\s*\d+(?!\d|\.\d|\s*(?:m|cm|mm|ft|met|feet)))*"
_NAMED_ID = re.compile(rf"\b(?:landmarks?|ids?)\s*[:=#]?\s*(\d+{_MORE_IDS})", re.IGNORECASE)
_INTEGER = re.compile(r"\d+")
_DASHES = str.maketrans("\u2212\u2010\u2011\u2012\u2013", "-----")


def fault_in(text: str, positions_m: Mapping[int, FloatArray], lengths_m: Iterable[float]) -> str:
    """Say what is wrong with a text about things of a map; "" if nothing is.

    Args:
        text: what the model wrote.
        positions_m: id -> (3,) world position of each thing that it was given.
        lengths_m: further lengths that it was given.
    """
    plain = _normalised(text)
    unknown = [i for i in _ids(plain, positions_m) if i not in positions_m]
    if unknown:
        return f"it names landmark {_shortened(unknown[0])}, which was not given (ids: {', '.join(map(str, positions_m)) or 'none'})"
    for numbers in _tuples(plain, positions_m):
        if not any(_is_position(numbers, position) for position in positions_m.values()):
            return f"it gives the position {_shortened(', '.join(numbers))}, where no landmark is"
    for axis, number in _AXIS.findall(plain):
        if not any(_rounds_to(number, position["xyz".index(axis.lower())]) for position in positions_m.values()):
            return f"it gives {axis} {_shortened(number)}, where no landmark is"
    known_m = [*lengths_m, *(value for position in positions_m.values() for value in position)]
    for number, *units in _LENGTH.findall(plain):
        scale = next(_UNITS[name] for name, unit in zip(_LENGTH_GROUPS, units, strict=True) if unit)
        if not any(_rounds_to(number.lstrip("+-"), abs(value), scale) for value in known_m):
            return f"it gives the length {_shortened(number)} {''.join(units)}, which is not in the map"
    return ""


def ids_in(text: str, known: Iterable[int]) -> tuple[int, ...]:
    """Return the ids that a text names, in their order, each once."""
    return tuple(dict.fromkeys(_ids(_normalised(text), known)))


def _ids(text: str, known: Iterable[int]) -> Iterator[int]:
    found: list[tuple[int, int]] = []
    for pattern in (_BRACKETED_ID, _HASH_ID, _NAMED_ID):
        for match in pattern.finditer(text):
            found += [(match.start(1) + number.start(), int(number[0])) for number in _INTEGER.finditer(match[1])]
    for match in _GROUP.finditer(text):
        if _is_list_of_ids(match[0], known):
            found += [(match.start() + number.start(), int(number[0])) for number in _INTEGER.finditer(match[0])]
    return iter(i for _, i in sorted(found))


def _tuples(text: str, known: Iterable[int]) -> Iterator[list[str]]:
    """Tuples that look like positions: in brackets, or bare with a decimal point."""
    for match in _GROUP.finditer(text):
        if not _is_list_of_ids(match[0], known):
            yield re.findall(_NUMBER, match[0])
    for match in _BARE_TUPLE.finditer(_GROUP.sub(" ", text)):
        if "." in match[0].rstrip("."):
            yield re.findall(_NUMBER, match[0])


def _is_list_of_ids(group: str, known: Iterable[int]) -> bool:
    return not re.search(r"[-+.]", group) and {int(number) for number in _INTEGER.findall(group)} <= set(known)


def _is_position(numbers: list[str], position_m: FloatArray) -> bool:
    return len(numbers) <= 3 and all(_rounds_to(number, value) for number, value in zip(numbers, position_m, strict=False))


def _rounds_to(number: str, value_m: float, scale: float = 1.0) -> bool:
    """Whether a printed number is the value, rounded to the digits that are printed."""
    decimals = len(number.rstrip(".").partition(".")[2])
    return bool(np.abs(float(number) * scale - value_m) <= 0.501 * scale * 10.0**-decimals)


def _normalised(text: str) -> str:
    return unicodedata.normalize("NFKC", text).translate(_DASHES)


def _shortened(value: object) -> str:
    text = str(value)
    return text if len(text) <= 40 else text[:40] + "…"
