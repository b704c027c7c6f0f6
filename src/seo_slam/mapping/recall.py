"""How often a detector finds the things that are there: a distribution over things, measured while it runs.

Detectors find a keyboard in every view and a thin book in one of six; a simulated one finds everything about equally often. How telling
a miss is depends on that, so the spread between things is measured with the mean (empirical Bayes).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

PRIOR_RATES = (0.9, 0.5, 0.1)
"""Things believed to have been measured before the first one is, a wide guess; together they weigh as much as one."""

LEAST_VIEWS = 5
"""A thing's rate is looked at after so many views in which it should have been seen."""

SHARE_OF_THINGS = 0.75
"""Of all that a detector finds repeatedly so much is taken for things; what it finds least may be mistakes of its own."""

LEAST_VARIANCE = 0.01
WEIGHTS = (1.0, 12.0)
"""Bounds of the distribution's weight a + b: never wider than a coin's, never surer than twelve views."""


@dataclass(frozen=True, slots=True)
class BetaRate:
    """A Beta distribution of hit rates: density ~ r^(a-1) (1-r)^(b-1)."""

    a: float
    b: float


def measured_recall(counts: Iterable[tuple[float, float]]) -> BetaRate:
    """Fit by moments the rates of things, given as (hits, misses) in views in which they should have been seen."""
    measured = sorted(hits / (hits + misses) for hits, misses in counts if hits + misses >= LEAST_VIEWS)
    things = measured[int((1.0 - SHARE_OF_THINGS) * len(measured)) :]
    rates = np.array([*PRIOR_RATES, *things])
    weights = np.array([1.0 / len(PRIOR_RATES)] * len(PRIOR_RATES) + [1.0] * len(things))
    mean = float(np.average(rates, weights=weights))
    variance = max(float(np.average((rates - mean) ** 2, weights=weights)), LEAST_VARIANCE)
    weight = float(np.clip(mean * (1.0 - mean) / variance - 1.0, *WEIGHTS))
    return BetaRate(mean * weight, (1.0 - mean) * weight)


PRIOR_GAPS = 10.0
"""Gaps believed to have been measured at first; one in 1 + k of them lasted k views or more."""

OWN_GAPS = 1.0
"""A thing's own gaps count beside what is measured of all things, which is worth so many of them."""


class MeasuredGaps:
    """How long things that are there go unfound: lengths of all gaps that ended with a hit."""

    def __init__(self, gaps: Iterable[int]) -> None:
        """Take the gaps of all things; most are 0 long."""
        self._sorted = np.sort(np.fromiter(gaps, dtype=np.int64))

    def outlasting(self, length: int, own: Sequence[int]) -> float:
        """Return the chance that a gap of a thing with these gaps of its own lasts ``length`` views or more."""
        longer = len(self._sorted) - int(np.searchsorted(self._sorted, length))
        of_all = (longer + PRIOR_GAPS / (1.0 + length)) / (len(self._sorted) + PRIOR_GAPS)
        return (sum(gap >= length for gap in own) + OWN_GAPS * of_all) / (len(own) + OWN_GAPS)
