"""Squared Mahalanobis distances between observations and landmarks (SEO-SLAM Eq 2, 4, 6, 7)."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.perception.cut_boxes import completed
from seo_slam.types import Estimate, IntArray, Landmarks, Observations


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
    index = np.empty((n, 9), dtype=np.int64)  # of the pose and one landmark each
    index[:, :6], index[:, 6:] = np.arange(6), 6 + 3 * np.arange(n)[:, None] + np.arange(3)
    sigma = joint[index[:, :, None], index[:, None, :]]
    H = np.zeros((n, 3, 9))
    H[:, 0, 1], H[:, 0, 2] = -p_camera[:, 2], p_camera[:, 1]
    H[:, 1, 0], H[:, 1, 2] = p_camera[:, 2], -p_camera[:, 0]
    H[:, 2, 0], H[:, 2, 1] = -p_camera[:, 1], p_camera[:, 0]
    H[:, :, 3:6], H[:, :, 6:] = -np.eye(3), R.T
    cov = H @ sigma @ H.transpose(0, 2, 1)
    return p_camera, np.asarray(0.5 * (cov + cov.transpose(0, 2, 1)), dtype=np.float64)


def mahalanobis(
    observations: Observations, landmarks: Landmarks, predicted: FloatArray, predicted_cov: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compare every observation with every predicted landmark; ``mahalanobis_of_pairs`` is for chosen ones.

    Args:
        observations: K rows.
        landmarks: N rows.
        predicted: (N, 3) camera frame.
        predicted_cov: (N, 3, 3) ``H Sigma H^T``.

    Returns:
        ``D^2`` (K, N) of Eq 7 under ``C = H Sigma H^T + Gamma`` (Eq 4), and ``log |2 pi C|`` (K, N), the normaliser of Eq 6.
    """
    shape = len(observations), len(predicted)
    rows, columns = np.indices(shape).reshape(2, -1)
    squared, log_det = mahalanobis_of_pairs(observations, landmarks, predicted, predicted_cov, rows, columns)
    return squared.reshape(shape), log_det.reshape(shape)


def mahalanobis_of_pairs(
    observations: Observations,
    landmarks: Landmarks,
    predicted: FloatArray,
    predicted_cov: FloatArray,
    rows: IntArray,
    columns: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Compare observations with predicted landmarks, pair by pair.

    A box cut by the image border is first completed by the landmark's usual size, see ``perception.cut_boxes``.

    Args:
        observations: K rows.
        landmarks: N rows.
        predicted: (N, 3) camera frame.
        predicted_cov: (N, 3, 3) ``H Sigma H^T``.
        rows: (P,) the observation of each pair.
        columns: (P,) its landmark.

    Returns:
        ``D^2`` (P,) and ``log |2 pi C|`` (P,), as of ``mahalanobis``.
    """
    p_camera, gamma = observations.p_camera[rows], observations.cov_camera[rows]
    cut = np.any(observations.truncated, axis=1)[rows]
    if cut.any():
        k, n = rows[cut], columns[cut]
        p_camera[cut], gamma[cut] = completed(
            p_camera[cut], gamma[cut], observations.size_m[k], observations.truncated[k], landmarks.across_m[n]
        )
    C = predicted_cov[columns] + gamma
    innovation = p_camera - predicted[columns]
    solved = np.linalg.solve(C, innovation[:, :, None])[:, :, 0]
    squared = np.einsum("pi,pi->p", innovation, solved)
    return np.asarray(squared, dtype=np.float64), np.asarray(np.linalg.slogdet(2.0 * np.pi * C)[1], dtype=np.float64)
