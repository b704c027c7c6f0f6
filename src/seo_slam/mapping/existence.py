"""The probability that a landmark is there, from its hits and from the views in which it should have been seen and was not.

Three explanations compete. It is there, and found at a rate that things have; it never was, and the detector's mistake comes back at a
rate that mistakes have; or it was there until its last hit and is gone since. Rates are integrated out (Beta-binomial), and how long a
thing that is there goes unfound is measured (``recall``), so that a thing found in one view of six is not taken for gone after five.
"""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from scipy.special import betaln

from seo_slam.mapping.recall import MeasuredRecall

FALSE_RATE = (2.0, 4.0)
"""How often a mistake that sticks to a place comes back, a Beta distribution: a third of the time or so. A judgement."""

HITS_WHEN_GONE = 0.02
"""Chance that a thing that is gone is seen again by mistake."""

FREE_WHEN_THERE, FREE_WHEN_FALSE, FREE_WHEN_GONE = 0.1, 0.3, 0.7
"""Chance that the camera sees through the place: poses err; flat things leave little free space behind."""

MOST_FREE_VIEWS = 5
"""Views through a place that count; the next ones repeat the same errors."""

FALSE_SHARE = 0.1
"""Prior odds that a landmark is a mistake: most of what is found again is there. To refute it takes ten times that, for a mistaken
removal is made again and again."""


@dataclass(slots=True)
class Sightings:
    """What counts for and against a landmark.

    Attributes:
        hits: views in which it should have been seen, and was.
        misses: views in which it should have been seen, and was not, but was later.
        tail: such views since it was last seen.
        free: those of the tail in which the camera saw through its place.
        gaps: how many earlier tails were how long, each ended by a view that saw it; 0 where it was seen again at once.
    """

    hits: int = 0
    misses: int = 0
    tail: int = 0
    free: int = 0
    gaps: Counter[int] = field(default_factory=Counter)

    def hit(self, should_be_seen: bool) -> None:
        """It was seen; whatever was missed before, it was there."""
        self.gaps[self.tail] += 1
        self.hits += int(should_be_seen)
        self.misses += self.tail
        self.tail = self.free = 0

    def miss(self, seen_through: bool) -> None:
        """It should have been seen, and was not."""
        self.tail += 1
        self.free += int(seen_through)

    def of_a_part(self, observations: int) -> "Sightings":
        """Of a part of the thing that has so many of its observations: no more hits than that."""
        return Sightings(min(self.hits, observations), self.misses, self.tail, self.free, self.gaps.copy())

    def merged(self, other: "Sightings") -> "Sightings":
        """Of two halves of one thing: a view that one half missed may have been a hit of the other."""
        last = self if self.tail <= other.tail else other
        views = max(self.hits + self.misses, other.hits + other.misses)
        hits = min(self.hits + other.hits, views)
        return Sightings(hits, views - hits, last.tail, last.free, self.gaps + other.gaps)


@dataclass(frozen=True, slots=True)
class Belief:
    """Probabilities that a landmark is there, that it never was, and that it was and is gone; they sum to 1."""

    there: float
    false: float
    gone: float


def believe(sightings: Sightings, recall: MeasuredRecall, outlasting: float, vanishing: float) -> Belief:
    """Weigh the three explanations.

    Args:
        sightings: of it.
        recall: the rates at which things are found.
        outlasting: chance that a thing that is there goes unfound for as long as the tail; what its own rate makes of the tail
            counts if that is more.
        vanishing: prior probability that a thing was taken away since it was last seen.
    """
    free = min(sightings.free, MOST_FREE_VIEWS)
    hits, misses, tail = sightings.hits, sightings.misses, sightings.tail
    found_before = recall.log_likelihood(hits, misses)
    streak = float(np.log(outlasting))  # mistakes, too, come and go in streaks
    there = found_before + max(recall.log_likelihood(hits, misses + tail) - found_before, streak) + free * np.log(FREE_WHEN_THERE)
    false_before = _false_log_likelihood(hits, misses)
    false = np.log(FALSE_SHARE) + false_before + max(_false_log_likelihood(hits, misses + tail) - false_before, streak)
    false += free * np.log(FREE_WHEN_FALSE)
    gone = np.log(vanishing) + found_before + tail * np.log(1.0 - HITS_WHEN_GONE) + free * np.log(FREE_WHEN_GONE)
    weights = np.exp(np.array([there, false, gone]) - max(there, false, gone))
    shares = (weights / weights.sum()).tolist()
    return Belief(*shares)


def _false_log_likelihood(hits: float, misses: float) -> float:
    """Log probability of a sequence of hits and misses of a mistake (Beta-binomial)."""
    a, b = FALSE_RATE
    return float(betaln(a + hits, b + misses) - betaln(a, b))
