"""Masks as COCO run-length code.

Pixels are read column by column; the counts are the lengths of runs of 0, then 1, then 0, and so on. COCO writes the counts as a
list of numbers or packed into text: 5 bits a character, each count from the fourth on as the difference to the one two before it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.types import BoolArray, IntArray

_FIRST_CHARACTER = 48
_PAYLOAD = 0x1F
_CONTINUES = 0x20
_NEGATIVE = 0x10
_LONGEST = 13  # 5-bit groups of a 64-bit number


def encode_mask(mask: BoolArray) -> dict[str, list[int]]:
    """Return ``{"size": [H, W], "counts": [...]}`` of a mask (H, W) bool, not packed."""
    pixels = np.asarray(mask, dtype=np.bool_).ravel(order="F")
    changes = np.flatnonzero(pixels[1:] != pixels[:-1]) + 1
    edges = np.concatenate([[0], changes, [len(pixels)]])
    counts = np.diff(edges).tolist()
    starts_set = bool(len(pixels) and pixels[0])
    return {"size": [int(mask.shape[0]), int(mask.shape[1])], "counts": [0, *counts] if starts_set else counts}


def decode_mask(code: Mapping[str, Any]) -> BoolArray:
    """Return the mask (H, W) bool of a COCO run-length code, packed or not.

    Raises:
        FrameError: as ``read_code``.
    """
    (height, width), counts = read_code(code)
    values = np.arange(len(counts)) % 2 == 1
    return np.repeat(values, counts).reshape((height, width), order="F")


def read_code(code: Any) -> tuple[tuple[int, int], IntArray]:
    """Check a code and return its size (H, W) and its counts (R,), not packed.

    Raises:
        FrameError: a key is missing or unknown, a count is negative or no whole number, or the counts do not fill the image.
    """
    if not isinstance(code, Mapping) or set(code) != {"size", "counts"}:
        got = sorted(map(str, code)) if isinstance(code, Mapping) else type(code).__name__
        raise FrameError(f"run-length mask: got {got}, wanted the keys 'size' and 'counts'")
    size = code["size"]
    if not (isinstance(size, list | tuple) and len(size) == 2 and all(_is_whole(s) and s > 0 for s in size)):
        raise FrameError(f"run-length mask: size is {size!r:.40}, wanted [height, width]")
    counts = _counts(code["counts"])
    if (counts < 0).any():
        raise FrameError(f"run-length mask: count {int(np.argmax(counts < 0))} is negative")
    total, wanted = int(counts.sum()), int(size[0]) * int(size[1])
    if total != wanted:
        raise FrameError(f"run-length mask: the counts cover {total} pixels, the size {list(size)} has {wanted}")
    return (int(size[0]), int(size[1])), counts


def _counts(counts: Any) -> IntArray:
    if isinstance(counts, str):
        return _unpack(counts)
    if not isinstance(counts, list | tuple | np.ndarray) or not all(_is_whole(c) for c in counts):
        raise FrameError("run-length mask: counts are neither a list of whole numbers nor packed text")
    if any(abs(int(c)) > 2**40 for c in counts):
        raise FrameError("run-length mask: a count is too large to be one")
    return np.array(counts, dtype=np.int64)


def _unpack(text: str) -> IntArray:
    counts: list[int] = []
    value = groups = 0
    for position, character in enumerate(text):
        bits = ord(character) - _FIRST_CHARACTER
        if not 0 <= bits < 64 or groups >= _LONGEST:
            raise FrameError(f"run-length mask: character {position} ({character!r}) is not COCO's packed text")
        value |= (bits & _PAYLOAD) << (5 * groups)
        groups += 1
        if bits & _CONTINUES:
            continue
        if bits & _NEGATIVE:
            value -= 1 << (5 * groups)
        counts.append(value + counts[-2] if len(counts) > 2 else value)
        if abs(counts[-1]) > 2**40:
            raise FrameError("run-length mask: a count is too large to be one")
        value = groups = 0
    if groups:
        raise FrameError("run-length mask: the packed text is cut off")
    return np.array(counts, dtype=np.int64)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)
