"""Which anchor to go to next when the thing was not where the map had it (DualMap IV-C, Table V)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor
from seo_slam.geometry import FloatArray
from seo_slam.navigation.outcomes import Candidate

_WIDE_M2 = 0.5  # of a top: a larger one has no more room for things than anybody uses
_EMPTY_WEIGHT = 0.7  # of an anchor that carried nothing when it was mapped
_LEAST_WEIGHT = 0.5  # what looks least like the query is worth so much of what looks most like it


@dataclass(frozen=True, slots=True, eq=False)
class Option:
    """A candidate with what going there takes.

    Attributes:
        candidate: which.
        anchor: its anchor.
        place_xy: (2,) from where it would be looked at.
        way_m: how long the way to that place is.
    """

    candidate: Candidate
    anchor: Anchor
    place_xy: FloatArray
    way_m: float


def most_learned(options: Sequence[Option], seen: Mapping[int, float], near_m: float, travel_m: float) -> Option:
    """Return the option from which most is to be learned.

    A thing that is not where it was and was not seen on the way is where nobody has looked. So a place is worth the sum, over all anchors
    within ``near_m`` of it that are still open, of what was not seen of them yet, each weighed from 0.5 to 1 by its score among the
    options (Eq 5: a table with fruit on it is likelier to have the banana), and less if its top is small or carried nothing; times what
    was not seen of the anchor itself; divided by 1 + way / ``travel_m``. Where everything was seen, the highest score decides (the paper).

    Args:
        options: at least one.
        seen: anchor -> share of its top that was seen.
        near_m: a look around shows anchors so near.
        travel_m: a way so long halves what a place is worth.
    """
    scores = np.array([option.candidate.score for option in options])
    spread = float(np.ptp(scores))
    likeness = (scores - scores.min()) / spread if spread > 0 else np.ones(len(options))
    unseen = np.array([1.0 - seen.get(option.anchor.id, 0.0) for option in options])
    weight = unseen * (_LEAST_WEIGHT + (1.0 - _LEAST_WEIGHT) * likeness) * np.array([_room_for_things(option.anchor) for option in options])
    places = np.array([option.place_xy for option in options])
    middles = np.array([option.anchor.xy_world for option in options])
    near = np.linalg.norm(places[:, None] - middles, axis=2) <= near_m
    np.fill_diagonal(near, True)
    worth = unseen * (near * weight).sum(axis=1) / (1.0 + np.array([option.way_m for option in options]) / travel_m)
    if worth.max() <= 1e-9:
        worth = scores
    return max(zip(options, worth, strict=True), key=lambda pair: (pair[1], pair[0].candidate.score, -pair[0].anchor.id))[0]


def _room_for_things(anchor: Anchor) -> float:
    low, high = anchor.bounds_world
    wide = min(1.0, float(np.prod(high - low)) / _WIDE_M2)
    return float(np.sqrt(wide)) * (1.0 if anchor.volatiles else _EMPTY_WEIGHT)
