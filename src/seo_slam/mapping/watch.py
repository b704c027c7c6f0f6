"""Counts, for every landmark, the views in which it should have been seen, and believes in it as far as it was."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.config import LiftingSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Smoother
from seo_slam.mapping.existence import Sightings, believe
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.recall import MeasuredGaps, MeasuredRecall
from seo_slam.mapping.sight import DepthView, Sight, look
from seo_slam.mapping.thing import Thing
from seo_slam.types import IntArray

SEEN_THROUGH = 0.6
"""Share of the open surface seen through from which the place counts as free."""

MOSTLY_OPEN = 0.5
"""… if no more of it than this is hidden; what the camera sees through needs no detector to be missed."""

LIKE_BEFORE = 0.25
"""A landmark should be seen where it looks at least this much as large as when it was found."""

LEAST_REACH_M = 0.1
"""A landmark this near to where one was removed is at the same place."""

HIDDEN_MORE = 0.15
"""… and where no more of it is hidden than then, give or take."""


@dataclass(frozen=True, slots=True, eq=False)
class _Buried:
    """What is remembered of a place from which a landmark was removed: what comes up there again is judged by all that was seen."""

    p_world: FloatArray
    reach_m: float
    sightings: Sightings


class Watch:
    """Keeps the hits and misses of every landmark, and its existence."""

    def __init__(self, lifting: LiftingSettings, object_map: ObjectMap, vanishing: float) -> None:
        """Watch over the things of ``object_map``; ``vanishing`` is the prior chance that one was taken away since it was last seen."""
        self._lifting = lifting
        self._map = object_map
        self._vanishing = vanishing
        self._buried: dict[int, _Buried] = {}

    def step(self, view: DepthView, hits: IntArray, smoother: Smoother) -> list[tuple[Thing, FloatArray]]:
        """Count one keyframe.

        Args:
            view: its depth image and pose.
            hits: ids of the landmarks observed in it.
            smoother: has the positions.

        Returns:
            Of what this view says something: the thing, its existence now believed, and its position (3,) in the world.
        """
        ids, p_world = smoother.positions()
        near = np.flatnonzero(np.linalg.norm(p_world - view.T_world_camera[:3, 3], axis=1) <= 1.5 * self._lifting.max_depth_m)
        things = [self._map[int(ids[row])] for row in near]
        surfaces = [p_world[row] + thing.surface() for row, thing in zip(near, things, strict=True)]
        sight = look(surfaces, view, self._lifting.max_depth_m, self._lifting.depth_noise_at_1m_m)
        seen = set(hits.tolist())
        for row, thing in enumerate(things):
            if thing.observations == 1 and thing.id in seen:
                self._remember_place(thing, p_world[near[row]])
        touched = [(thing, p_world[near[row]]) for row, thing in enumerate(things) if _weigh(thing, sight, row, thing.id in seen)]
        self._believe([thing for thing, _ in touched])
        return touched

    def bury(self, thing: Thing, p_world: FloatArray) -> None:
        """Remember what was seen at the place (3,) of a landmark that leaves the map, for what comes up there again."""
        if self._map.is_confirmed(thing):
            self._buried[thing.id] = _Buried(p_world, max(0.5 * float(thing.size_m().max()), LEAST_REACH_M), thing.sightings)

    def moved(self, landmark_id: int) -> None:
        """Forget the place of what turned out to be somewhere else: what comes there next is another thing."""
        self._buried.pop(landmark_id, None)

    def _believe(self, things: list[Thing]) -> None:
        confirmed = [thing.sightings for thing in self._map.things.values() if self._map.is_confirmed(thing)]
        confirmed += [buried.sightings for buried in self._buried.values()]
        recall = MeasuredRecall((sightings.hits, sightings.misses) for sightings in confirmed)
        gaps = MeasuredGaps(sightings.gaps for sightings in confirmed)
        for thing in things:
            own = thing.sightings
            thing.existence = believe(own, recall, gaps.outlasting(own.tail, own.gaps), self._vanishing).there

    def _remember_place(self, thing: Thing, p_world: FloatArray) -> None:
        """Let a new landmark inherit what was seen where one was removed."""
        for landmark_id, buried in self._buried.items():
            if float(np.linalg.norm(buried.p_world - p_world)) <= buried.reach_m:
                thing.sightings = self._buried.pop(landmark_id).sightings
                return


def found_share(thing: Thing) -> float:
    """Share of the views in which a landmark was or should have been seen in which it was."""
    missed = thing.sightings.misses + thing.sightings.tail
    return thing.observations / (thing.observations + missed)


def _weigh(thing: Thing, sight: Sight, row: int, hit: bool) -> bool:
    """Count a view for or against a landmark; False if it says nothing."""
    free = bool(sight.in_view[row] and sight.through[row] >= SEEN_THROUGH and sight.hidden[row] <= MOSTLY_OPEN)
    plain = bool(sight.in_view[row]) and _as_visible_as_before(thing, float(sight.area_px[row]), float(sight.hidden[row]))
    if hit:
        thing.sightings.hit(plain)
        if sight.in_view[row]:
            thing.remember_look(float(sight.area_px[row]), float(sight.hidden[row]))
    elif plain or free:
        thing.sightings.miss(free)
    return hit or plain or free


def _as_visible_as_before(thing: Thing, area_px: float, hidden: float) -> bool:
    """Whether a view shows a landmark about as well as those in which it was found."""
    if not thing.looks:
        return hidden <= HIDDEN_MORE
    areas_px, shares = zip(*thing.looks, strict=True)
    return area_px >= LIKE_BEFORE * _lower_quartile(areas_px) and hidden <= statistics.median(shares) + HIDDEN_MORE


def _lower_quartile(values: Sequence[float]) -> float:
    """Of a few dozen numbers; numpy takes many times as long for so few."""
    return values[0] if len(values) == 1 else statistics.quantiles(values, n=4, method="inclusive")[0]
