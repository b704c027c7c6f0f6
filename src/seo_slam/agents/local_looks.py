"""What looks at a landmark say about whether it is anything, added up over the sides it was seen from."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from seo_slam.agents.contrast import colour_contrast
from seo_slam.agents.local_patch import cut_patch
from seo_slam.agents.relief import relief_of
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.interfaces import AgentView

ALL_FLAT, PARTLY_FLAT = 0.8, 0.5
"""Shares of a surface that lies on what is around it."""

LEAST_OWN = 0.05
"""Share of a box that must stand out by itself to count."""

LEAST_CONTRAST = 0.15
"""Share of a box whose colour is found nowhere around."""

NOTHING, MAYBE, THING = 3.0, 2.0, -2.0
"""Log likelihood ratios of the three outcomes of a look, nothing against a thing; see docs/local-agents.md for how often which was
counted. "Nothing" is as sure as for the flattest things there are, wall sockets: 6 % of the looks at them come to it."""

SAME_SIDE = 0.25
"""What a further look from the same side adds: it errs mostly as the first one did."""

SIDES = 8

LEAST_Z_M = 0.05


@dataclass(frozen=True, slots=True)
class Look:
    """One look at a landmark.

    Attributes:
        going_on: share of its surface that lies on the surfaces around it.
        own: share of its box that stands before them and ends near the box.
        contrast: share of its box whose colour is found nowhere around.
    """

    going_on: float
    own: float
    contrast: float

    def nothing(self) -> float:
        """Return the log likelihood ratio that there is nothing against that there is a thing."""
        if self.contrast >= LEAST_CONTRAST or self.going_on <= PARTLY_FLAT:
            return THING
        if self.going_on > ALL_FLAT:
            return NOTHING
        return MAYBE if self.own < LEAST_OWN else THING


def look_at(landmark_id: int, view: AgentView, noise: float) -> Look | None:
    """Return what a view shows of a landmark with a box; None where too little of it or around it is seen.

    Args:
        landmark_id: whose.
        view: with its box and evidence.
        noise: standard deviation of a pixel's inverse depth, 1/m.
    """
    patch = cut_patch(view.frame, view.boxes_px[landmark_id])
    if patch is None:
        return None
    contrast = colour_contrast(patch)
    relief = relief_of(patch, surface_px(landmark_id, view), noise) if contrast is not None else None
    return Look(relief.going_on, relief.own, contrast) if relief is not None and contrast is not None else None


def side_of(landmark_id: int, view: AgentView) -> int:
    """Return from which of eight directions, seen from above, a view looks at a landmark."""
    x, y, _ = view.T_world_camera[:3, 3] - place_of(landmark_id, view)
    return int(np.floor(np.arctan2(y, x) / (2.0 * np.pi) * SIDES)) % SIDES


def place_of(landmark_id: int, view: AgentView) -> FloatArray:
    """Return (3,) the position of a landmark, world frame."""
    place: FloatArray = view.landmarks.p_world[int(np.searchsorted(view.landmarks.ids, landmark_id))]
    return place


def version_of(landmark_id: int, view: AgentView) -> int:
    """Return the version of a landmark that a view shows."""
    return int(view.landmarks.versions[int(np.searchsorted(view.landmarks.ids, landmark_id))])


def observations_of(landmark_id: int, view: AgentView) -> int:
    """Return in how many keyframes a landmark was seen."""
    return int(view.landmarks.observations[int(np.searchsorted(view.landmarks.ids, landmark_id))])


@dataclass(slots=True)
class LooksAtOne:
    """All looks at one landmark.

    Attributes:
        p_world: (3,) where it was.
        by_side: side -> log ratios of the looks from there.
        tried: side -> looks tried, with or without a result.
        was_there: it has surely been a thing: if nothing stands out any more, it is gone, which others find out.
        confirmed: it was passed on, to be described and merged.
        doubts: word that it should have had instead of its own, and side -> how often that was said.
    """

    p_world: FloatArray
    by_side: dict[int, list[float]] = field(default_factory=dict)
    tried: dict[int, int] = field(default_factory=dict)
    was_there: bool = False
    confirmed: bool = False
    doubts: dict[tuple[str, int], int] = field(default_factory=dict)

    def add(self, side: int, log_ratio: float) -> None:
        """Take a look's result."""
        self.by_side.setdefault(side, []).append(log_ratio)

    def total(self) -> float:
        """Return the log likelihood ratio of all looks: nothing against a thing."""
        return added_up(self.by_side.values())


def added_up(sides: Iterable[list[float]]) -> float:
    """Return the sum over sides of their mean, which counts a little more the more looks it is of."""
    return float(sum(np.mean(side) * (1.0 + SAME_SIDE * (len(side) - 1)) for side in sides if side))


def surface_px(landmark_id: int, view: AgentView) -> FloatArray:
    """Return (M, 3) points of a landmark's surface: pixel column, row, and depth in metres; those behind the camera are left out."""
    evidence = view.evidence.get(landmark_id)
    if evidence is None or not len(evidence.surface_world):
        return np.zeros((0, 3))
    p_camera = transform_points(inverse(view.T_world_camera), evidence.surface_world)
    p_camera = p_camera[p_camera[:, 2] > LEAST_Z_M]
    return np.concatenate([view.frame.camera.project(p_camera), p_camera[:, 2:]], axis=1)
