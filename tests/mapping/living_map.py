"""A map with a smoother and a life cycle, fed by painted blocks; tests say which landmark each block is."""

from dataclasses import replace

import numpy as np

from painted_blocks import WALL_M, paint, pose
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.config import LifeSettings, LiftingSettings, MapSettings
from seo_slam.geometry import inverse
from seo_slam.mapping.lifecycle import LifeCycle
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView
from seo_slam.mapping.status_checks import StatusChecks
from seo_slam.mapping.watch import Watch
from seo_slam.settings.concrete import StatusSettings
from seo_slam.settings.observing import CloudSettings
from seo_slam.testing.worlds import TINY_CAMERA, tiny_observations
from seo_slam.types import Landmarks, Motion

PERIOD_S = 0.5


class LivingMap:
    """Keyframes half a second apart."""

    def __init__(self, old=(), status=None, **life):
        """``status``: settings of DualMap's checks, which then decide about lives."""
        self.objects = ObjectMap(MapSettings(), embedding_size=8, clouds=CloudSettings(enabled=status is not None))
        self.smoother = GtsamSmoother()
        settings, lifting, words = LifeSettings(**life), LiftingSettings(), HashedEmbedder(size=8)
        self.life = LifeCycle(settings, lifting, self.objects, LabelLikelihood(words))
        if status is not None:
            checks = StatusSettings(**status)
            watch = Watch(lifting, self.objects, settings.vanishing) if checks.existence else None
            self.life = StatusChecks(checks, self.objects, words, watch, settings)
        self.events = []
        self.keyframes = 0
        self._T = None
        self._now_is = {}
        self._old = Landmarks.from_rows(list(old)) if old else None
        for row in old:
            self.objects.restore(row)

    def see(self, found, there=None, aside_m=0.0, times=1, before=(), wall_m=WALL_M):
        """Keyframes that find the blocks ``{id: block}``; painted are those ``there`` (or else the found), and those ``before`` all.

        A wall at 0 m is an image without depth, but for the blocks. An id that a move took away stands for the one it became.

        Returns:
            (kind, id) of what happened, "created" left out.
        """
        happened = []
        for _ in range(times):
            painted = [*(found if there is None else there).values(), *before]
            happened += self._see_once(found, paint(painted, aside_m, wall_m), aside_m)
        self.events += happened
        return [(event.kind, event.landmark_id) for event in happened]

    def _see_once(self, found, depth_m, aside_m):
        T = pose(aside_m)
        blocks = list(found.values())
        ids = np.array([self._now_is.get(i, i) for i in found], dtype=np.int64)
        self.objects.next_id = max(self.objects.next_id, int(ids.max(initial=-1)) + 1)
        seen = tiny_observations(np.array([block.p_world for block in blocks]), tuple(block.label for block in blocks), T)
        seen = replace(
            seen,
            clouds=tuple(_front(p, block.half_m) for p, block in zip(seen.p_camera, blocks, strict=True)),
            size_m=np.array([[2 * block.half_m] * 2 for block in blocks]).reshape(-1, 2),
        )
        if self._T is None:
            self.smoother.start(T, 1e-6 * np.eye(6), self._old)
        self.smoother.update(None if self._T is None else Motion(inverse(self._T) @ T, 1e-6 * np.eye(6)), seen, ids)
        self._T = T
        stamp_s = PERIOD_S * self.keyframes
        self.keyframes += 1
        known, positions = self.smoother.positions()
        self.objects.integrate(seen, ids, T, stamp_s, positions[np.searchsorted(known, ids)], self.smoother.poses())
        events = self.life.step(DepthView(TINY_CAMERA, depth_m, T, stamp_s), ids, self.smoother)
        self._now_is |= {event.other_id: event.landmark_id for event in events if event.kind == "moved"}
        return events

    def ids(self):
        """Of all landmarks; map and graph must agree."""
        assert self.smoother.positions()[0].tolist() == sorted(self.objects.things)
        return sorted(self.objects.things)

    def kinds(self):
        """(kind, id) of all that happened so far."""
        return [(event.kind, event.landmark_id) for event in self.events]

    def state(self, landmark_id):
        return self.objects[landmark_id].state

    def position(self, landmark_id):
        ids, p_world = self.smoother.positions()
        return p_world[ids.tolist().index(landmark_id)]


def _front(p_camera, half_m):
    """A block's front as a grid of points (400, 3) around its middle."""
    side = np.linspace(-0.95 * half_m, 0.95 * half_m, 20)
    x, y = np.meshgrid(side, side)
    return p_camera + np.stack([x.ravel(), y.ravel(), np.zeros(400)], axis=1)
