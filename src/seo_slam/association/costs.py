"""Squared Mahalanobis distances between observations and landmarks (SEO-SLAM Eq 2, 4, 6, 7)."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.perception.cut_boxes import SIZE_SIGMA_SHARE, SLOPE_SIGMA, completed
from seo_slam.types import BoolArray, Estimate, Landmarks, Observations


def predicted_measurements(estimate: Estimate, landmarks: Landmarks) -> tuple[FloatArray, FloatArray]:
    """Predict each landmark in the camera frame, with the uncertainty of pose and map.

    ``h(x) = R^T (l - t)`` (Eq 2); its Jacobian is ``[[p]_x, -I]`` by the pose (rotation first, right-perturbed) and ``R^T`` by
    the landmark.

    Returns:
        ``p_camera`` (N, 3) and ``H Sigma H^T`` (N, 3, 3) of Eq 4, from the joint covariance of the pose and all N landmarks. The
        blocks between pose and landmark matter: without them the gate is 3 to 300 times too wide.
    """
    R = estimate.T_world_camera[:3, :3]
    p_camera = (landmarks.p_world - estimate.T_world_camera[:3, 3]) @ R
    n = len(landmarks)
    if n == 0:
        return p_camera, np.zeros((0, 3, 3))
    joint = estimate.joint_covariance(landmarks.ids)
    pose = joint[:6, :6]
    cross = joint[:6, 6:].reshape(6, n, 3).transpose(1, 0, 2)  # (N, 6, 3)
    blocks = joint[6:, 6:].reshape(n, 3, n, 3)
    own = blocks[np.arange(n), :, np.arange(n), :]  # (N, 3, 3)
    H = np.zeros((n, 3, 6))
    H[:, 0, 1], H[:, 0, 2] = -p_camera[:, 2], p_camera[:, 1]
    H[:, 1, 0], H[:, 1, 2] = p_camera[:, 2], -p_camera[:, 0]
    H[:, 2, 0], H[:, 2, 1] = -p_camera[:, 1], p_camera[:, 0]
    H[:, :, 3:] = -np.eye(3)
    mixed = H @ cross @ R
    cov = H @ pose @ H.transpose(0, 2, 1) + mixed + mixed.transpose(0, 2, 1) + R.T @ own @ R
    return p_camera, np.asarray(0.5 * (cov + cov.transpose(0, 2, 1)), dtype=np.float64)


def mahalanobis(
    observations: Observations, landmarks: Landmarks, predicted: FloatArray, predicted_cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compare every observation with every predicted landmark.

    A box cut by the image border is first completed by the landmark's usual size, see ``perception.cut_boxes``.

    Args:
        observations: K rows.
        landmarks: N rows.
        predicted: (N, 3) camera frame.
        predicted_cov: (N, 3, 3) ``H Sigma H^T``.

    Returns:
        ``D^2`` (K, N) of Eq 7 under ``C = H Sigma H^T + Gamma`` (Eq 4), and ``log |2 pi C|`` (K, N), the normaliser of Eq 6.
    """
    if len(observations) == 0 or len(predicted) == 0:
        empty = np.zeros((len(observations), len(predicted)))
        return empty, empty.copy()
    p_camera, gamma = completed(
        observations.p_camera[:, None],
        observations.cov_camera[:, None],
        observations.size_m[:, None],
        observations.truncated[:, None],
        landmarks.across_m[None],
    )
    C = predicted_cov[None] + gamma
    innovation = p_camera - predicted[None]
    solved = np.linalg.solve(C, innovation[..., None])[..., 0]
    squared = np.einsum("kni,kni->kn", innovation, solved)
    return np.asarray(squared, dtype=np.float64), np.asarray(np.linalg.slogdet(2.0 * np.pi * C)[1], dtype=np.float64)


def within_reach(
    observations: Observations, landmarks: Landmarks, estimate: Estimate, search_distance_m: float, threshold: float
) -> BoolArray:
    """Return (K, N) bool: pairs that could pass the gate; only landmarks in one of them need the dear joint covariance.

    A landmark must lie within the search distance of the camera (III-B), and nearer to the observation than the gate's radius under
    the uncertainties of observation, pose and landmark, each taken in its worst direction and added up.
    """
    if len(observations) == 0 or len(landmarks) == 0:
        return np.zeros((len(observations), len(landmarks)), dtype=np.bool_)
    R = estimate.T_world_camera[:3, :3]
    p_camera = (landmarks.p_world - estimate.T_world_camera[:3, 3]) @ R
    range_m = np.linalg.norm(p_camera, axis=1)
    pose = estimate.covariance
    pose_sigma = _worst_sigma(pose[3:, 3:]) + range_m * _worst_sigma(pose[:3, :3])
    own_sigma = _worst_sigma(observations.cov_camera)
    distance = np.linalg.norm(observations.p_camera[:, None] - p_camera[None], axis=2)
    sigma = own_sigma[:, None] + (pose_sigma + _worst_sigma(landmarks.cov_world))[None]
    cut = np.any(observations.truncated, axis=1, keepdims=True)
    unseen_m = np.where(cut, 0.5 * np.linalg.norm(landmarks.across_m, axis=1)[None], 0.0)  # how far completing a cut box may shift it
    reach = np.sqrt(threshold) * (sigma + (SLOPE_SIGMA + SIZE_SIGMA_SHARE) * unseen_m) + unseen_m
    return np.asarray((range_m < search_distance_m) & (distance < reach), dtype=np.bool_)


def _worst_sigma(covariance: FloatArray) -> FloatArray:
    """Standard deviation in the worst direction of covariances (..., 3, 3)."""
    return np.asarray(np.sqrt(np.linalg.eigvalsh(covariance)[..., -1]), dtype=np.float64)
