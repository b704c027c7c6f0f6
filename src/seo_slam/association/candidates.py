"""Which pairs of observation and landmark could pass the gate: few of a large map, found before anything dear is computed.

Three steps, each looking closer at what the one before left: landmarks near the camera, landmarks within reach of an observation by the
uncertainties that are at hand, and, once the joint covariance of those is known, pairs. A pair is left out only if the gate of Eq 7
would refuse it: ``D^2 >= |innovation|^2 / (largest eigenvalue of C)``, and all that is known from above of that eigenvalue will do.
"""

import math

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.perception.cut_boxes import SIZE_SIGMA_SHARE, SLOPE_SIGMA
from seo_slam.types import BoolArray, Estimate, IntArray, Landmarks, Observations

_ROUNDING = 1.0 + 1e-6
"""Makes good what is lost to rounding where almost equal numbers are subtracted."""


def near_camera(p_world: FloatArray, T_world_camera: FloatArray, search_distance_m: float) -> IntArray:
    """Return the rows of positions (N, 3) that lie within the search distance of the camera (III-B), rising.

    A scan, one axis first: it takes 0.05 ms for 10 000 landmarks. A search tree would have to learn which landmarks the smoother
    has moved, which takes as long, and would be one more thing that can be out of date.
    """
    camera = T_world_camera[:3, 3]
    rows = (np.abs(p_world[:, 0] - camera[0]) < search_distance_m).nonzero()[0]
    offset = p_world[rows] - camera
    return np.asarray(rows[np.einsum("ni,ni->n", offset, offset) < search_distance_m**2], dtype=np.int64)


def candidate_rows(
    observations: Observations, landmarks: Landmarks, estimate: Estimate, search_distance_m: float, threshold: float
) -> IntArray:
    """Return the rows of landmarks, rising, that could pass the gate of any observation: only they need the joint covariance.

    A landmark must lie within the search distance of the camera, and nearer to an observation than the gate's radius under the
    uncertainties of observation, pose and landmark, each taken in its worst direction and added up: so it holds whatever their
    correlation is.

    Args:
        observations: K rows.
        landmarks: N rows, the whole map.
        estimate: the predicted camera pose.
        search_distance_m: metres from the camera.
        threshold: of the squared Mahalanobis distance.
    """
    rows = near_camera(landmarks.p_world, estimate.T_world_camera, search_distance_m)
    if not len(observations) or not len(rows):
        return np.zeros(0, dtype=np.int64)
    R, camera, pose = estimate.T_world_camera[:3, :3], estimate.T_world_camera[:3, 3], estimate.covariance
    p_world, K = landmarks.p_world[rows], len(observations)
    covariances = np.concatenate([pose[None, :3, :3], pose[None, 3:, 3:], observations.cov_camera, landmarks.cov_world[rows]])
    sigma = np.sqrt(_variance_bound(covariances))
    turn_sigma, shift_sigma, own_sigma, map_sigma = sigma[0], sigma[1], sigma[2 : 2 + K], sigma[2 + K :]
    offset = p_world - camera
    range_m = np.sqrt(np.einsum("ni,ni->n", offset, offset))
    total = own_sigma[:, None] + (map_sigma + shift_sigma + range_m * turn_sigma)
    reach_m = _reach_m(total, observations.truncated, landmarks.across_m[rows], threshold)
    seen_world = observations.p_camera @ R.T + camera
    return rows[(_squared_distances(seen_world, p_world) < reach_m * reach_m).any(axis=0)]


def possible_pairs(
    observations: Observations, landmarks: Landmarks, predicted: FloatArray, predicted_cov: FloatArray, threshold: float
) -> tuple[IntArray, IntArray]:
    """Return (P,) rows of observations and (P,) of landmarks: the pairs that could pass the gate, now that ``H Sigma H^T`` is known.

    Args:
        observations: K rows.
        landmarks: N rows.
        predicted: (N, 3) camera frame.
        predicted_cov: (N, 3, 3) ``H Sigma H^T``.
        threshold: of the squared Mahalanobis distance.
    """
    K = len(observations)
    variance = _variance_bound(np.concatenate([observations.cov_camera, predicted_cov]))
    reach_m = _reach_m(np.sqrt(variance[:K, None] + variance[K:]), observations.truncated, landmarks.across_m, threshold)
    rows, columns = np.nonzero(_squared_distances(observations.p_camera, predicted) < reach_m * reach_m)
    return rows, columns


def _reach_m(sigma: FloatArray, truncated: BoolArray, across_m: FloatArray, threshold: float) -> FloatArray:
    """(K, N) how far apart a pair can be and still pass, from sigma (K, N) in the worst direction, truncated (K, 4), across (N, 2)."""
    reach_m = math.sqrt(threshold) * sigma
    cut = truncated.any(axis=1)
    if cut.any():  # completing a cut box may shift it by half the size, and that is less certain
        unseen_m = 0.5 * np.sqrt(np.einsum("ni,ni->n", across_m, across_m))
        reach_m[cut] += (math.sqrt(threshold) * (SLOPE_SIGMA + SIZE_SIGMA_SHARE) + 1.0) * unseen_m
    return reach_m


def _squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """(K, N) between points (K, 3) and (N, 3); axis by axis is three times as fast as all at once."""
    apart = a[:, None, 0] - b[:, 0]
    squared = apart * apart
    for axis in (1, 2):
        apart = a[:, None, axis] - b[:, axis]
        squared += apart * apart
    return squared


def _variance_bound(covariance: FloatArray) -> FloatArray:
    """(N,) what the largest eigenvalues of covariances (N, 3, 3) cannot exceed, 4/3 of them at most, and a tenth of their cost.

    The eigenvalues of a symmetric 3 x 3 matrix are ``q + 2 p cos(phi)`` with ``q`` their mean and ``6 p^2`` the sum of their squared
    deviations from it; this takes 1 for the cosine. It is exact for a ball and for a needle.
    """
    flat = covariance.reshape(len(covariance), 9)
    q = (flat[:, 0] + flat[:, 4] + flat[:, 8]) / 3.0
    squared_deviations = np.einsum("ni,ni->n", flat, flat) - 3.0 * q * q
    return np.asarray((q + 2.0 * np.sqrt(np.maximum(squared_deviations, 0.0) / 6.0)) * _ROUNDING, dtype=np.float64)
