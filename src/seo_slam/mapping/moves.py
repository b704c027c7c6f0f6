"""Things that vanish in one place while a like one appears in another: the same thing, with the same id, where nothing else fits.

A newcomer must have appeared: its place was seen before, and it was not there. It must be the only like one for a vanished thing, and
the other way round; and no like thing may be left that has not been looked at since, since that might be the one that moved.
"""

from dataclasses import dataclass, replace

import numpy as np

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.camera import Camera
from seo_slam.config import LiftingSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Smoother
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView, look
from seo_slam.mapping.thing import Thing
from seo_slam.records import MapEvent

VIEWS_REMEMBERED = 400
SHRINK = 4
"""Remembered depth images keep every fourth pixel: enough to tell whether a place was in view and not hidden."""

EMPTY_VIEWS = 4
"""A newcomer's place must have been in plain view so often before it was first seen."""

PLAINLY_SEEN = 0.3
"""… with no more of it hidden than this share."""

LIKE_SIZE = 2.0
"""The diagonal of one thing's extent differs between places by less than this factor: it may lie turned."""

PATIENCE_S = 5.0
"""So long a like thing that was not looked at since may hold up a decision; then one change is likelier than two."""

LIKE_LABEL = 1.0
"""Log likelihood ratio of the labels from which two landmarks are like each other: e times more likely if they are one thing."""


@dataclass(frozen=True, slots=True, eq=False)
class _Vanished:
    """A thing that is not where it was; it may be in the map still ("lost"), or have left it."""

    thing: Thing
    p_world: FloatArray
    since_s: float


class Moves:
    """Pairs vanished things with newcomers."""

    def __init__(self, lifting: LiftingSettings, object_map: ObjectMap, likelihood: LabelLikelihood) -> None:
        """Watch over the things of ``object_map``; ``likelihood`` compares labels."""
        self._lifting = lifting
        self._map = object_map
        self._likelihood = likelihood
        self._views: list[DepthView] = []
        self._vanished: dict[int, _Vanished] = {}
        self._newcomers: dict[int, float] = {}  # since when
        self._removed: set[int] = set()

    def remember(self, view: DepthView) -> None:
        """Keep a small copy of a view; when there are too many, every second one goes."""
        self._views.append(_shrunk(view))
        if len(self._views) > VIEWS_REMEMBERED:
            self._views = self._views[::2]

    def vanished(self, thing: Thing, p_world: FloatArray, now_s: float) -> None:
        """A thing is not at its place (3,) any more; what was missed there more often than found is not worth a search."""
        self._newcomers.pop(thing.id, None)
        if thing.sightings.hits >= thing.sightings.misses:
            self._vanished.setdefault(thing.id, _Vanished(thing, p_world, now_s))

    def is_back(self, landmark_id: int) -> None:
        """A landmark was found where it was."""
        self._vanished.pop(landmark_id, None)

    def removed(self, landmark_id: int) -> None:
        """A vanished landmark left the map for its misses; others that leave it, merged or by an agent, are not looked for."""
        self._removed.add(landmark_id)

    def became_stable(self, thing: Thing, p_world: FloatArray, now_s: float) -> None:
        """Note a thing as a newcomer if its place (3,) was seen without it before."""
        before = [view for view in self._views if view.timestamp_s < thing.first_seen_s - 1e-6]
        surface = [p_world + thing.surface()]
        empty = 0
        for view in reversed(before):
            sight = look(surface, view, self._lifting.max_depth_m, self._lifting.depth_noise_at_1m_m)
            empty += int(sight.in_view[0] and sight.hidden[0] <= PLAINLY_SEEN)
            if empty >= EMPTY_VIEWS:
                self._newcomers[thing.id] = now_s
                return

    def resolve(self, smoother: Smoother, now_s: float) -> list[MapEvent]:
        """Give newcomers the id of the thing that they must be.

        Returns:
            An event "moved" each; ``other_id`` is the id that the newcomer had until then.
        """
        present = {i: since_s for i, since_s in self._newcomers.items() if i in self._map and self._map[i].state == "stable"}
        self._newcomers = present
        self._vanished = {i: gone for i, gone in self._vanished.items() if self._is_missing(i)}
        if not present or not self._vanished:
            return []
        ids, p_world = smoother.positions()
        where = {int(i): p for i, p in zip(ids, p_world, strict=True)}
        rivals = {new: [old for old, gone in self._vanished.items() if self._may_be(gone, self._map[new], where[new])] for new in present}
        events = []
        for new, olds in sorted(rivals.items()):
            if len(olds) != 1 or sum(olds[0] in others for others in rivals.values()) != 1:
                continue
            waited_s = now_s - max(present[new], self._vanished[olds[0]].since_s)
            if waited_s >= PATIENCE_S or not self._unverified(self._map[new]):
                events.append(self._move(self._vanished.pop(olds[0]), new, where[new], smoother))
        return events

    def _is_missing(self, landmark_id: int) -> bool:
        return self._map[landmark_id].state == "lost" if landmark_id in self._map else landmark_id in self._removed

    def _may_be(self, vanished: _Vanished, newcomer: Thing, p_world: FloatArray) -> bool:
        thing = vanished.thing
        apart_m = float(np.linalg.norm(vanished.p_world - p_world))
        elsewhere = apart_m > 0.5 * float(max(thing.size_m().max(), newcomer.size_m().max()))
        return elsewhere and newcomer.first_seen_s > thing.last_seen_s and self._alike(thing, newcomer)

    def _alike(self, a: Thing, b: Thing) -> bool:
        smaller, larger = sorted((float(np.linalg.norm(a.size_m())), float(np.linalg.norm(b.size_m()))))
        return larger < LIKE_SIZE * smaller and self._likelihood.between(a.distribution(), b.distribution()) >= LIKE_LABEL

    def _unverified(self, newcomer: Thing) -> bool:
        """Whether another like thing has not been seen since the newcomer came: it might be the one."""
        return any(
            other.state == "stable"
            and other.id not in self._newcomers
            and other.last_seen_s < newcomer.first_seen_s
            and self._alike(other, newcomer)
            for other in self._map.things.values()
        )

    def _move(self, vanished: _Vanished, new_id: int, p_world: FloatArray, smoother: Smoother) -> MapEvent:
        old = vanished.thing
        if old.id in self._map:
            smoother.remove(old.id)
            self._map.forget(old.id)
        smoother.rename(new_id, old.id)
        self._map.rename(new_id, old)
        self._newcomers.pop(new_id, None)
        self._removed.discard(old.id)
        detail = f"{old.label}: from {_place(vanished.p_world)} to {_place(p_world)}"
        return MapEvent("moved", old.id, detail, other_id=new_id)


def _place(p_world: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.2f}" for v in p_world) + ") m"


def _shrunk(view: DepthView) -> DepthView:
    camera = view.camera
    depth_m = np.ascontiguousarray(view.depth_m[::SHRINK, ::SHRINK])
    height, width = depth_m.shape
    small = Camera(camera.fx / SHRINK, camera.fy / SHRINK, camera.cx / SHRINK, camera.cy / SHRINK, width, height, camera.distortion)
    return replace(view, camera=small, depth_m=depth_m)
