"""The life of a landmark: existence from hits and from misses where it should have been seen; tentative, stable, lost, removed.

Beyond both papers: SEO-SLAM removes only what an agent rejects, DualMap what was seen too seldom at first.
"""

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.config import LifeSettings, LiftingSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Smoother
from seo_slam.mapping.moves import Moves
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView
from seo_slam.mapping.thing import Thing
from seo_slam.mapping.watch import Watch, found_share
from seo_slam.records import MapEvent
from seo_slam.types import IntArray, LandmarkState


class LifeCycle:
    """Keeps every landmark's existence; decides what becomes stable, is lost, is found again, or leaves the map."""

    def __init__(self, settings: LifeSettings, lifting: LiftingSettings, object_map: ObjectMap, likelihood: LabelLikelihood) -> None:
        """Watch over the things of ``object_map``; ``likelihood`` compares labels."""
        self._settings = settings
        self._map = object_map
        self._watch = Watch(lifting, object_map, settings.vanishing)
        self._moves = Moves(lifting, object_map, likelihood)

    def step(self, view: DepthView, hits: IntArray, smoother: Smoother) -> list[MapEvent]:
        """Weigh one keyframe.

        Args:
            view: its depth image and pose.
            hits: ids of the landmarks observed in it.
            smoother: has the positions; landmarks that leave the map leave it too.

        Returns:
            What became stable, lost, found or removed.
        """
        events = []
        for thing, p_world in self._watch.step(view, hits, smoother):
            events += self._judge(thing, p_world, view.timestamp_s, smoother)
        self._moves.remember(view)
        moved = self._moves.resolve(smoother, view.timestamp_s)
        for event in moved:
            self._watch.moved(event.landmark_id)
        return events + moved

    def _judge(self, thing: Thing, p_world: FloatArray, now_s: float, smoother: Smoother) -> list[MapEvent]:
        settings = self._settings
        sure = thing.existence >= settings.stable_existence and found_share(thing) >= settings.stable_share
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

    def _remove(self, thing: Thing, p_world: FloatArray, smoother: Smoother) -> MapEvent:
        self._watch.bury(thing, p_world)
        smoother.remove(thing.id)
        self._map.forget(thing.id)
        self._moves.removed(thing.id)
        return MapEvent("removed", thing.id, thing.label)


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
