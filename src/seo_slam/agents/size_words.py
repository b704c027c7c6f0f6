"""Words for sizes, where they tell alike things apart."""

from collections.abc import Sequence

import numpy as np

MUCH = 1.6
"""A thing is large, or small, if it is so many times as large as the others of its kind usually are, or less than the inverse of it."""

LEAST_M = 0.02
"""Extents are not known better than this."""


def size_word(longest_m: float, others_m: Sequence[float]) -> str:
    """Return "large" or "small" for a thing among others of its kind, by the longest extents in metres; "" if it is like them or alone."""
    if not len(others_m):
        return ""
    ratio = max(longest_m, LEAST_M) / max(float(np.median(others_m)), LEAST_M)
    return "large" if ratio >= MUCH else ("small" if ratio <= 1.0 / MUCH else "")
