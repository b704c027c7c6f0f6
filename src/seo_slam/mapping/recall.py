"""How often a detector finds the things that are there: a distribution over things, measured while it runs.

Detectors find a keyboard in every view and a thin book in one of six; a simulated one finds everything about equally often. How telling
a miss is depends on that, so the spread between things is measured with the mean (empirical Bayes).
"""

from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
from scipy.special import betaln

PRIOR_RATES = (0.9, 0.5, 0.1)
"""Things believed to have been measured before the first one is: a wide guess."""

PRIOR_WEIGHT = 0.5
"""Together they weigh as much as this share of one measured thing."""

LEAST_VIEWS = 5
"""A thing's rate is looked at after so many views in which it should have been seen."""

SHARE_OF_THINGS = 0.75
"""Of all that a detector finds repeatedly so much is taken for things; what it finds least may be mistakes of its own."""

LIKENESS = 10.0
"""A thing is found about as often as one of those measured: as if that one had been looked at so many times."""


class MeasuredRecall:
    """The rates at which things are found: a mixture with one component for each thing measured."""

    def __init__(self, counts: Iterable[tuple[float, float]]) -> None:
        """Take hits and misses of each thing, in views in which it should have been seen."""
        measured = sorted(hits / (hits + misses) for hits, misses in counts if hits + misses >= LEAST_VIEWS)
        things = measured[int((1.0 - SHARE_OF_THINGS) * len(measured)) :]
        rates = np.array([*PRIOR_RATES, *things])
        self._a, self._b = LIKENESS * rates + 0.5, LIKENESS * (1.0 - rates) + 0.5
        weights = np.array([PRIOR_WEIGHT / len(PRIOR_RATES)] * len(PRIOR_RATES) + [1.0] * len(things))
        self._log_weights = np.log(weights / weights.sum()) - betaln(self._a, self._b)

    def log_likelihood(self, hits: float, misses: float) -> float:
        """Return the log probability of a sequence of hits and misses of a thing that is there."""
        return float(np.logaddexp.reduce(self._log_weights + betaln(self._a + hits, self._b + misses)))


PRIOR_GAPS = 10.0
"""Gaps believed to have been measured at first; one in 1 + k of them lasted k views or more."""

OWN_GAPS = 1.0
"""A thing's own gaps count beside what is measured of all things, which is worth so many of them."""


class MeasuredGaps:
    """How long things that are there go unfound: lengths of all gaps that ended with a hit."""

    def __init__(self, gaps: Iterable[Mapping[int, int]]) -> None:
        """Take the gaps of all things: of each how many were how long; most are 0 long."""
        counts: Counter[int] = Counter()
        for of_one in gaps:
            counts.update(of_one)
        self._counts = counts
        self._total = counts.total()

    def outlasting(self, length: int, own: Mapping[int, int]) -> float:
        """Return the chance that a gap of a thing with these gaps of its own lasts ``length`` views or more."""
        of_all = (_longer(self._counts, length) + PRIOR_GAPS / (1.0 + length)) / (self._total + PRIOR_GAPS)
        return (_longer(own, length) + OWN_GAPS * of_all) / (sum(own.values()) + OWN_GAPS)


def _longer(counts: Mapping[int, int], length: int) -> int:
    return sum(times for gap, times in counts.items() if gap >= length)
