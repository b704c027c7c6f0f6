"""Camera pose from matches of map points to features: PnP with RANSAC, then robust Gauss-Newton on pixels and depth."""

from dataclasses import dataclass

import cv2
import numpy as np

from seo_slam import geometry
from seo_slam.backends.visual_features import Features
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

_HUBER = 1.5
_CHI_SQUARE_2_DOF = 9.0
_CHI_SQUARE_1_DOF = 6.6
_ITERATIONS = 8
_ITERATIONS_WITH_ALL = 2
_RANSAC_PX = 4.0
_CLUSTER_COLUMNS, _CLUSTER_ROWS = 8, 6


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """A camera pose measured against the map.

    Attributes:
        T_world_camera: (4, 4).
        covariance: (6, 6), rotation first, right-perturbed.
        inliers: (N,) which of the matches agree.
    """

    T_world_camera: FloatArray
    covariance: FloatArray
    inliers: BoolArray

    @property
    def inlier_count(self) -> int:
        """How many matches agree."""
        return int(np.count_nonzero(self.inliers))


def pnp_ransac(p_world: FloatArray, features: Features, camera: Camera, seed: int) -> tuple[FloatArray, IntArray] | None:
    """Find a pose that many of N matches agree on.

    Args:
        p_world: (N, 3) map points.
        features: N features, row by row.
        camera: its matrix; features are undistorted already.
        seed: the same seed and input give the same pose.

    Returns:
        ``T_world_camera`` and the rows of the inliers, or None.
    """
    if len(p_world) < 6:
        return None
    params = cv2.UsacParams()
    params.randomGeneratorState = seed
    params.threshold = _RANSAC_PX
    params.confidence = 0.999
    params.maxIterations = 300
    params.isParallel = False
    params.score = cv2.SCORE_METHOD_MSAC
    params.loMethod = cv2.LOCAL_OPTIM_NULL  # refine_pose does better what these would do
    params.final_polisher = cv2.NONE_POLISHER
    try:
        found, _, rotation, translation, inliers = cv2.solvePnPRansac(p_world, features.uv_px, camera.matrix, None, params=params)
    except cv2.error:  # degenerate points
        return None
    if not found or inliers is None or not np.isfinite(rotation).all() or not np.isfinite(translation).all():
        return None
    T_camera_world = np.eye(4)
    T_camera_world[:3, :3] = geometry.so3_exp(rotation.ravel())
    T_camera_world[:3, 3] = translation.ravel()
    return geometry.inverse(T_camera_world), inliers.ravel().astype(np.int64)


def residuals(T_world_camera: FloatArray, p_world: FloatArray, features: Features, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals (N, 3) of u, v and inverse depth, and the points (N, 3) in the camera frame.

    A feature without depth has a third residual of 0.
    """
    p = geometry.transform_points(geometry.inverse(T_world_camera), p_world)
    w = 1.0 / np.maximum(p[:, 2], 1e-3)
    r = np.empty((len(p), 3))
    r[:, 0] = (camera.fx * p[:, 0] * w + camera.cx - features.uv_px[:, 0]) / features.sigma_px
    r[:, 1] = (camera.fy * p[:, 1] * w + camera.cy - features.uv_px[:, 1]) / features.sigma_px
    r[:, 2] = (w - features.inverse_depth) * features.depth_weight
    return r, p


def jacobians(p_camera: FloatArray, features: Features, camera: Camera) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the residuals: (N, 3, 6) by a right perturbation of ``T_world_camera``, (N, 3, 3) by the point.

    The point is that in the camera frame; a perturbation [omega, v] of the pose moves it by p x omega - v.
    """
    w = 1.0 / np.maximum(p_camera[:, 2], 1e-3)
    x, y = p_camera[:, 0] * w, p_camera[:, 1] * w
    gain_u, gain_v, gain_w = camera.fx / features.sigma_px, camera.fy / features.sigma_px, features.depth_weight * w
    pose = np.zeros((len(w), 3, 6))
    pose[:, 0, 0], pose[:, 0, 1], pose[:, 0, 2] = gain_u * x * y, -gain_u * (1.0 + x * x), gain_u * y
    pose[:, 1, 0], pose[:, 1, 1], pose[:, 1, 2] = gain_v * (1.0 + y * y), -gain_v * x * y, -gain_v * x
    pose[:, 2, 0], pose[:, 2, 1] = gain_w * y, -gain_w * x
    pose[:, 0, 3], pose[:, 0, 5] = -gain_u * w, gain_u * x * w
    pose[:, 1, 4], pose[:, 1, 5] = -gain_v * w, gain_v * y * w
    pose[:, 2, 5] = gain_w * w
    return pose, -pose[:, :, 3:]


def robust_weights(r: FloatArray) -> FloatArray:
    """(N, 3) Huber weights: one for u and v together, one for inverse depth."""
    pixel = np.sqrt(r[:, 0] ** 2 + r[:, 1] ** 2)
    weights = np.empty_like(r)
    weights[:, :2] = np.minimum(1.0, _HUBER / np.maximum(pixel, 1e-12))[:, None]
    weights[:, 2] = np.minimum(1.0, _HUBER / np.maximum(np.abs(r[:, 2]), 1e-12))
    return weights


def agreeing(r: FloatArray, p_camera: FloatArray) -> BoolArray:
    """(N,) which residuals pass the chi-square test and lie before the camera. A bad depth alone does not spoil a match
    unless it is far off, since depth at edges is.
    """
    return (p_camera[:, 2] > 0.05) & (r[:, 0] ** 2 + r[:, 1] ** 2 < _CHI_SQUARE_2_DOF) & (r[:, 2] ** 2 < 4 * _CHI_SQUARE_1_DOF)


def refine_pose(T_world_camera: FloatArray, p_world: FloatArray, features: Features, camera: Camera) -> PoseFit:
    """Minimise reprojection and inverse-depth residuals over the pose by iteratively reweighted Gauss-Newton.

    The covariance is the mean of two estimates: the inverse Hessian scaled by the residuals' spread, and the sandwich
    ``H^-1 (sum_c g_c g_c^T) H^-1`` over image cells c (Liang and Zeger 1986), since neighbouring residuals share their error.
    """
    T = T_world_camera
    for iteration in range(_ITERATIONS):
        r, p = residuals(T, p_world, features, camera)
        if iteration == _ITERATIONS_WITH_ALL:
            features = features.with_depth_noise(_spread_of_depth(r, features))
            r, p = residuals(T, p_world, features, camera)
        weights = robust_weights(r)
        if iteration >= _ITERATIONS_WITH_ALL:
            weights *= agreeing(r, p)[:, None]
        J = jacobians(p, features, camera)[0].reshape(-1, 6)
        JW = J * weights.reshape(-1, 1)
        step = -np.linalg.solve(JW.T @ J + 1e-9 * np.eye(6), JW.T @ r.reshape(-1))
        T = T @ geometry.exp(step)
        if iteration > _ITERATIONS_WITH_ALL and float(np.abs(step).max()) < 1e-5:
            break
    r, p = residuals(T, p_world, features, camera)
    inliers = agreeing(r, p)
    J = jacobians(p, features, camera)[0]
    return PoseFit(T, _covariance(r[inliers], J[inliers], features.uv_px[inliers], camera), inliers)


def _spread_of_depth(r: FloatArray, features: Features) -> float:
    """How much larger than the sensor's noise the depth residuals are (median), at least 1: colour and depth of a moving
    camera are not of the same moment.
    """
    depth = np.abs(r[features.has_depth, 2])
    return max(1.0, 1.4826 * float(np.median(depth))) if len(depth) else 1.0


def _covariance(r: FloatArray, J: FloatArray, uv_px: FloatArray, camera: Camera) -> FloatArray:
    weights = robust_weights(r)
    flat, flat_w = J.reshape(-1, 6), weights.reshape(-1, 1)
    H_inverse = np.linalg.inv((flat * flat_w).T @ flat + 1e-6 * np.eye(6))
    g = (J * (weights * r)[:, :, None]).sum(axis=1)
    column = np.clip(uv_px[:, 0] * _CLUSTER_COLUMNS / camera.width, 0, _CLUSTER_COLUMNS - 1).astype(np.int64)
    row = np.clip(uv_px[:, 1] * _CLUSTER_ROWS / camera.height, 0, _CLUSTER_ROWS - 1).astype(np.int64)
    sums = np.zeros((_CLUSTER_COLUMNS * _CLUSTER_ROWS, 6))
    np.add.at(sums, row * _CLUSTER_COLUMNS + column, g)
    spread = float((weights * r * r).sum()) / max(2 * len(r) - 6, 1)
    sandwich = H_inverse @ (sums.T @ sums) @ H_inverse
    return np.asarray(0.5 * (sandwich + max(spread, 0.25) * H_inverse), dtype=np.float64)
