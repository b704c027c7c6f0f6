"""Which landmark of the local concrete map is what was asked for (DualMap IV-C)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor, Place, Volatile
from seo_slam.geometry import FloatArray
from seo_slam.navigation.outcomes import Candidate
from seo_slam.navigation.query import cosine
from seo_slam.types import Landmark

_LOW_M = 0.3  # above the floor: things that stand on it are seen from here up


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """A landmark and how well it fits the query.

    Attributes:
        landmark: of the local map.
        score: cosine of its feature with that of the query.
    """

    landmark: Landmark
    score: float

    @property
    def label(self) -> str:
        """Its word, for people."""
        return self.landmark.label or "thing without a name"


def ranked(landmarks: Sequence[Landmark], feature: FloatArray) -> tuple[Match, ...]:
    """Return landmarks by falling score; of equals the more often observed, then the older first.

    Args:
        landmarks: of the local map.
        feature: (D,) of the query.
    """
    if not landmarks:
        return ()
    scores = cosine(np.stack([landmark.embedding for landmark in landmarks]), feature)
    rows = [Match(landmark, float(score)) for landmark, score in zip(landmarks, scores, strict=True)]
    return tuple(sorted(rows, key=lambda row: (-round(row.score, 9), -row.landmark.observations, row.landmark.id)))


def is_at(landmark: Landmark, anchor: Anchor, growth: float, beside_m: float = 0.0) -> bool:
    """Whether a landmark is on or within an anchor: its middle is in the footprint's box, grown on each side.

    A thing larger than the anchor's box, such as the anchor itself seen more wholly, counts when the box's middle is in its own.

    Args:
        landmark: of the local map.
        anchor: of the abstract map.
        growth: of the box, as a share of its side.
        beside_m: of the box, at least so much.
    """
    low, high = anchor.bounds_world
    grown = np.maximum(growth * (high - low), beside_m)
    own_low, own_high = box_of(landmark)
    middle = 0.5 * (own_low + own_high)
    inside = bool((middle >= low - grown).all() and (middle <= high + grown).all())
    return inside or bool((anchor.xy_world >= own_low).all() and (anchor.xy_world <= own_high).all())


def stood_beside(anchor: Anchor, candidate: Candidate) -> bool:
    """Whether what made an anchor a candidate stood next to it, not on it."""
    relations = [volatile.relation for volatile in _behind(anchor, candidate)]
    return bool(relations) and all(relation == "next to" for relation in relations)


def look_at_z_m(anchor: Anchor, candidate: Candidate) -> float:
    """Return the height at which a candidate is to be looked for: the anchor's top, or near the floor for what stood beside it."""
    return min(anchor.support_z_m, anchor.z_range_m[0] + _LOW_M) if stood_beside(anchor, candidate) else anchor.support_z_m


def place_of(anchor: Anchor, candidate: Candidate) -> Place | None:
    """Return where what made an anchor a candidate was seen last; None where the anchor itself did, or the map does not know."""
    return next((volatile.place for volatile in _behind(anchor, candidate) if volatile.place is not None), None)


def _behind(anchor: Anchor, candidate: Candidate) -> tuple[Volatile, ...]:
    """The thing that made an anchor a candidate; of what was seen on the way those of its word, any of which it may be."""
    if candidate.thing is not None:
        return (candidate.thing,)
    if not candidate.volatile:
        return ()
    return tuple(volatile for volatile in anchor.volatiles if volatile.label == candidate.because)


def center_of(landmark: Landmark) -> FloatArray:
    """Return (3,) the middle of a landmark's box, world frame; its position where no cloud is kept."""
    cloud = landmark.cloud_world
    return np.asarray(0.5 * (cloud.min(axis=0) + cloud.max(axis=0)) if len(cloud) else landmark.position_m)


def box_of(landmark: Landmark) -> tuple[FloatArray, FloatArray]:
    """Low and high corner (2,) of a landmark seen from above."""
    if len(landmark.cloud_world):
        return landmark.cloud_world[:, :2].min(axis=0), landmark.cloud_world[:, :2].max(axis=0)
    half = 0.5 * landmark.size_m[:2]
    return landmark.position_m[:2] - half, landmark.position_m[:2] + half
