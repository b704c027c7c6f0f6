"""Measuring a camera pose against map points: search near a predicted pose first, everywhere when that fails."""

from dataclasses import dataclass

import numpy as np

from seo_slam.backends.visual_features import Features
from seo_slam.backends.visual_local_map import Candidates
from seo_slam.backends.visual_matching import Matches, matches_anywhere, matches_near
from seo_slam.backends.visual_pose import PoseFit, pnp_ransac, refine_pose
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

_SEARCH_RADII_PX = (15.0, 45.0)
_FINAL_RADIUS_PX = 6.0
_MARGIN_PX = 20.0
_MAX_ROUNDS = 4
_GROWTH = 1.3
_GOOD_COUNT = 30
_GOOD_SHARE = 0.15
_ENOUGH_COUNT = 150


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A measured camera pose.

    Attributes:
        T_world_camera: (4, 4).
        covariance: (6, 6), rotation first, right-perturbed.
        points: (F,) map point of each feature, -1 where there is none.
        visible: map points that should be in the image.
    """

    T_world_camera: FloatArray
    covariance: FloatArray
    points: IntArray
    visible: IntArray

    @property
    def found(self) -> IntArray:
        """Map points that agree with the pose."""
        return self.points[self.points >= 0]

    @property
    def is_good(self) -> bool:
        """Whether enough of what should be visible is found; a false pose explains little."""
        return len(self.found) >= min(max(_GOOD_COUNT, _GOOD_SHARE * len(self.visible)), _ENOUGH_COUNT)


@dataclass(frozen=True, slots=True)
class Tracker:
    """Matches features to map points and fits the pose.

    Attributes:
        min_inliers: fewer agreeing matches are no measurement.
        seed: of RANSAC.
    """

    min_inliers: int
    seed: int

    def near(self, candidates: Candidates, features: Features, camera: Camera, T_world_camera: FloatArray) -> Track | None:
        """Track from a predicted pose: in a small search radius, then a larger one, then everywhere, until the fit is good.

        Returns:
            The first good fit, else the one that explains most, else None.
        """
        best: Track | None = None
        for radius_px in (*_SEARCH_RADII_PX, None):
            if radius_px is None:
                track = self.anywhere(candidates, features, camera)
            else:
                matches = _guided(candidates, features, camera, T_world_camera, radius_px)
                track = self._fit(candidates, features, camera, matches)
            if track is not None and (best is None or len(track.found) > len(best.found)):
                best = track
            if best is not None and best.is_good:
                break
        return best

    def anywhere(self, candidates: Candidates, features: Features, camera: Camera) -> Track | None:
        """Track without any idea of the pose, by descriptors alone."""
        feature, candidate = matches_anywhere(features.descriptors, candidates.descriptors)
        return self._fit(candidates, features, camera, (candidate, feature))

    def _fit(self, candidates: Candidates, features: Features, camera: Camera, matches: Matches) -> Track | None:
        """RANSAC and refinement of first matches, then again with all matches near the pose found, while they become more."""
        candidate, feature = matches
        if len(candidate) < self.min_inliers:
            return None
        found = pnp_ransac(candidates.p_world[candidate], features.take(feature), camera, self.seed)
        if found is None or len(found[1]) < self.min_inliers:
            return None
        T_world_camera, agreeing = found
        candidate, feature = candidate[agreeing], feature[agreeing]
        fit = refine_pose(T_world_camera, candidates.p_world[candidate], features.take(feature), camera)
        count = fit.inlier_count
        for _ in range(_MAX_ROUNDS):
            if fit.inlier_count < self.min_inliers:
                return None
            candidate, feature = _guided(candidates, features, camera, fit.T_world_camera, _FINAL_RADIUS_PX)
            fit = refine_pose(fit.T_world_camera, candidates.p_world[candidate], features.take(feature), camera)
            if fit.inlier_count < _GROWTH * count:
                break
            count = fit.inlier_count
        if fit.inlier_count < self.min_inliers:
            return None
        return _track(candidates, len(features), camera, candidate, feature, fit)


def _guided(candidates: Candidates, features: Features, camera: Camera, T_world_camera: FloatArray, radius_px: float) -> Matches:
    rows, uv_px, octaves = candidates.predict(T_world_camera, camera, _MARGIN_PX)
    candidate, feature = matches_near(uv_px, octaves, candidates.descriptors[rows], features, radius_px)
    return rows[candidate], feature


def _track(candidates: Candidates, count: int, camera: Camera, candidate: IntArray, feature: IntArray, fit: PoseFit) -> Track:
    points = np.full(count, -1, dtype=np.int64)
    points[feature[fit.inliers]] = candidates.points[candidate[fit.inliers]]
    visible, _, _ = candidates.predict(fit.T_world_camera, camera, -_MARGIN_PX)
    return Track(fit.T_world_camera, fit.covariance, points, candidates.points[visible])
