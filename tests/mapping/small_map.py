"""An object map with a smoother under it, fed by made-up keyframes."""

from dataclasses import replace

import numpy as np

from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.config import MapSettings
from seo_slam.mapping.lifecycle import SightingsOnly
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView
from seo_slam.testing.worlds import T_WORLD_FIRST, TINY_CAMERA, tiny_observations
from seo_slam.types import Motion

AT = np.array([1.2, 0.2, 0.8])


class SmallMap:
    """Keyframes from a camera that stands still, 0.2 s apart unless said otherwise. What is seen often enough is stable."""

    def __init__(self, **settings):
        self.objects = ObjectMap(MapSettings(**settings), embedding_size=8)
        self.life = SightingsOnly(self.objects)
        self.smoother = GtsamSmoother()
        self.smoother.start(T_WORLD_FIRST, 1e-6 * np.eye(6))
        self.keyframes = 0
        self.camera = TINY_CAMERA
        self.T = T_WORLD_FIRST

    def see(self, things, timestamp_s=None, scores=None, half_m=0.06):
        """One keyframe that sees ``{id: (p_world, label)}``; an id of None makes a new landmark. Return the events."""
        rows = list(things)
        p_world = np.array([things[i][0] for i in rows], dtype=np.float64).reshape(-1, 3)
        seen = tiny_observations(p_world, tuple(things[i][1] for i in rows))
        clouds = tuple(p + half_m * np.random.default_rng(3).uniform(-1, 1, (400, 3)) for p in seen.p_camera)
        seen = replace(seen, clouds=clouds, size_m=np.full((len(rows), 2), 2 * half_m))
        if scores is not None:
            seen = replace(seen, scores=np.array(scores, dtype=np.float64))
        ids = np.array([int(self.objects.new_ids(1)[0]) if i is None else i for i in rows], dtype=np.int64)
        self.objects.next_id = max(self.objects.next_id, int(ids.max(initial=-1)) + 1)
        still = Motion(np.eye(4), 1e-6 * np.eye(6)) if self.keyframes else None
        self.smoother.update(still, seen, ids)
        stamp = 0.2 * self.keyframes if timestamp_s is None else timestamp_s
        self.keyframes += 1
        known, positions = self.smoother.positions()
        events = self.objects.integrate(seen, ids, T_WORLD_FIRST, stamp, positions[np.searchsorted(known, ids)])
        no_depth = np.zeros((TINY_CAMERA.height, TINY_CAMERA.width), dtype=np.float32)
        return events + self.life.step(DepthView(TINY_CAMERA, no_depth, T_WORLD_FIRST, stamp), ids, self.smoother)

    def row(self, landmark_id):
        return next(row for row in self.objects.rows(self.smoother) if row.id == landmark_id)

    def ids(self):
        return [row.id for row in self.objects.rows(self.smoother)]


def kinds(events):
    return [(event.kind, event.landmark_id) for event in events]
