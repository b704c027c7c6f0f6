"""An object map that keeps clouds, with DualMap's status checks over it, fed by made-up keyframes from a camera that stands still."""

from dataclasses import replace

import numpy as np

from seo_slam.backends.given_poses_smoother import GivenPosesSmoother
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.config import MapSettings
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView
from seo_slam.mapping.status_checks import StatusChecks
from seo_slam.settings.concrete import StatusSettings
from seo_slam.settings.observing import CloudSettings
from seo_slam.testing.worlds import T_WORLD_FIRST, TINY_CAMERA, tiny_observations
from seo_slam.types import Landmarks, Motion

AT = np.array([1.2, 0.2, 0.8])


class CheckedMap:
    """``see`` takes one keyframe's observations: (landmark id or None for a new one, place, word or None), an id as often as one likes."""

    def __init__(self, smoother=None, named_share=1 / 3, noise_at_1m_m=0.0, before=None, **settings):
        """``before`` is a landmark of a map that is continued."""
        clouds = CloudSettings(enabled=True, named_share=named_share, noise_at_1m_m=noise_at_1m_m)
        self.objects = ObjectMap(MapSettings(), embedding_size=8, clouds=clouds)
        self.checks = StatusChecks(StatusSettings(**settings), self.objects, HashedEmbedder(size=8))
        self.smoother = smoother or GivenPosesSmoother()
        old = None
        if before is not None:
            self.objects.restore(before, T_WORLD_FIRST)
            old = Landmarks.from_rows([before], 8)
        self.smoother.start(T_WORLD_FIRST, 1e-6 * np.eye(6), old)
        self.keyframes = 0

    def see(self, *seen, period_s=0.5, half_m=0.05, feature=None, thick=1.0, placed=True):
        """One keyframe; return [(kind, id), …] of what happened; new and renamed ones are not told."""
        made = tiny_observations(np.array([p for _, p, _ in seen]).reshape(-1, 3), tuple(word for _, _, word in seen))
        points = half_m * np.random.default_rng(3).uniform(-1, 1, (300, 3)) * np.array([1.0, 1.0, thick])
        made = replace(made, clouds=tuple(p + points for p in made.p_camera))
        if feature is not None:
            made = replace(made, embeddings=np.tile(feature, (len(made), 1)))
        ids = np.array([int(self.objects.new_ids(1)[0]) if i is None else i for i, _, _ in seen], dtype=np.int64)
        self.smoother.update(Motion(np.eye(4), 1e-6 * np.eye(6)) if self.keyframes else None, made, ids)
        stamp_s = period_s * self.keyframes
        self.keyframes += 1
        known, positions = self.smoother.positions()
        own = positions[np.searchsorted(known, ids)]
        events = self.objects.integrate(made, ids, T_WORLD_FIRST, stamp_s, own, self.smoother.poses(), placed)
        view = DepthView(TINY_CAMERA, np.zeros((TINY_CAMERA.height, TINY_CAMERA.width), np.float32), T_WORLD_FIRST, stamp_s)
        events += self.checks.step(view, ids, self.smoother)
        return [(event.kind, event.landmark_id) for event in events if event.kind not in ("created", "relabelled")]

    def ids(self):
        return sorted(self.objects.things)

    def row(self, landmark_id):
        return next(row for row in self.objects.rows(self.smoother) if row.id == landmark_id)
