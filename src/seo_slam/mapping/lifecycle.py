"""The life of a landmark: existence from hits and from misses where it should have been seen; tentative, stable, lost, removed.

Beyond both papers: SEO-SLAM removes only what an agent rejects, DualMap what was seen too seldom at first.
"""

from dataclasses import dataclass

import numpy as np

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.config import LifeSettings, LiftingSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Smoother
from seo_slam.mapping.existence import Sightings, believe
from seo_slam.mapping.moves import Moves
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.recall import MeasuredGaps, MeasuredRecall
from seo_slam.mapping.sight import DepthView, Sight, look
from seo_slam.mapping.thing import Thing
from seo_slam.records import MapEvent
from seo_slam.types import IntArray, LandmarkState

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


class LifeCycle:
    """Keeps every landmark's existence; decides what becomes stable, is lost, is found again, or leaves the map."""

    def __init__(self, settings: LifeSettings, lifting: LiftingSettings, object_map: ObjectMap, likelihood: LabelLikelihood) -> None:
        """Watch over the things of ``object_map``; ``likelihood`` compares labels."""
        self._settings = settings
        self._lifting = lifting
        self._map = object_map
        self._moves = Moves(lifting, object_map, likelihood)
        self._buried: dict[int, _Buried] = {}

    def step(self, view: DepthView, hits: IntArray, smoother: Smoother) -> list[MapEvent]:
        """Weigh one keyframe.

        Args:
            view: its depth image and pose.
            hits: ids of the landmarks observed in it.
            smoother: has the positions; landmarks that leave the map leave it too.

        Returns:
            What became stable, lost, found or removed.
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
        touched = [thing for row, thing in enumerate(things) if self._weigh(thing, sight, row, thing.id in seen)]
        confirmed = [thing.sightings for thing in self._map.things.values() if self._map.is_confirmed(thing)]
        confirmed += [buried.sightings for buried in self._buried.values()]
        recall = MeasuredRecall((sightings.hits, sightings.misses) for sightings in confirmed)
        gaps = MeasuredGaps(gap for sightings in confirmed for gap in sightings.gaps)
        events = []
        for thing in touched:
            own = thing.sightings
            thing.existence = believe(own, recall, gaps.outlasting(own.tail, own.gaps), self._settings.vanishing).there
            events += self._judge(thing, p_world[int(np.searchsorted(ids, thing.id))], view.timestamp_s, smoother)
        self._moves.remember(view)
        moved = self._moves.resolve(smoother, view.timestamp_s)
        for event in moved:  # what comes to its old place next is another thing
            self._buried.pop(event.landmark_id, None)
        return events + moved

    def _weigh(self, thing: Thing, sight: Sight, row: int, hit: bool) -> bool:
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

    def _judge(self, thing: Thing, p_world: FloatArray, now_s: float, smoother: Smoother) -> list[MapEvent]:
        settings = self._settings
        sure = thing.existence >= settings.stable_existence and _found_share(thing) >= settings.stable_share
        if thing.state == "tentative" and sure and self._map.is_confirmed(thing):
            self._moves.became_stable(thing, p_world, now_s)
            return [self._becomes(thing, "stable", "stable")]
        if thing.state == "lost" and sure:
            self._moves.is_back(thing.id)
            return [self._becomes(thing, "stable", "found")]
        if thing.state == "stable" and thing.existence < settings.lost_existence:
            self._moves.vanished(thing, p_world, now_s)
            return [self._becomes(thing, "lost", "lost")]
        hopeless = thing.existence < settings.removed_existence and thing.sightings.tail >= settings.removed_misses
        if hopeless and not 0 <= now_s - thing.last_seen_s < settings.removed_seconds:  # below 0: the clock began anew
            return [self._remove(thing, p_world, smoother)]
        return []

    def _becomes(self, thing: Thing, state: LandmarkState, kind: str) -> MapEvent:
        thing.state = state
        thing.version += 1
        return MapEvent(kind, thing.id, thing.label)

    def _remember_place(self, thing: Thing, p_world: FloatArray) -> None:
        """Let a new landmark inherit what was seen where one was removed."""
        for landmark_id, buried in self._buried.items():
            if float(np.linalg.norm(buried.p_world - p_world)) <= buried.reach_m:
                thing.sightings = self._buried.pop(landmark_id).sightings
                return

    def _remove(self, thing: Thing, p_world: FloatArray, smoother: Smoother) -> MapEvent:
        if self._map.is_confirmed(thing):
            self._buried[thing.id] = _Buried(p_world, max(0.5 * float(thing.size_m().max()), LEAST_REACH_M), thing.sightings)
        smoother.remove(thing.id)
        self._map.forget(thing.id)
        self._moves.removed(thing.id)
        return MapEvent("removed", thing.id, thing.label)


def _found_share(thing: Thing) -> float:
    """Share of the views in which a landmark was or should have been seen in which it was."""
    missed = thing.sightings.misses + thing.sightings.tail
    return thing.observations / (thing.observations + missed)


def _as_visible_as_before(thing: Thing, area_px: float, hidden: float) -> bool:
    """Whether a view shows a landmark about as well as those in which it was found."""
    if not thing.looks:
        return hidden <= HIDDEN_MORE
    looks = np.array(thing.looks)
    return area_px >= LIKE_BEFORE * float(np.quantile(looks[:, 0], 0.25)) and hidden <= float(np.median(looks[:, 1])) + HIDDEN_MORE


class SightingsOnly:
    """The paper's variants: a landmark counts once seen often enough, and only agents remove it."""

    def __init__(self, object_map: ObjectMap) -> None:
        """Watch over the things of ``object_map``."""
        self._map = object_map

    def step(self, view: DepthView, hits: IntArray, smoother: Smoother) -> list[MapEvent]:  # noqa: ARG002
        """See ``LifeCycle.step``; only the hits are looked at."""
        events = []
        for thing in (self._map[int(i)] for i in hits if int(i) in self._map):
            thing.existence = 1.0
            if thing.state != "stable" and self._map.is_confirmed(thing):
                events.append(MapEvent("found" if thing.state == "lost" else "stable", thing.id, thing.label))
                thing.state = "stable"
                thing.version += 1
        return events
