"""The joint covariance of the newest pose and all landmarks, carried along beside the smoother.

ISAM2 recovers it by walking its tree, milliseconds a query, dearer for landmarks not seen lately. A Kalman filter's covariance,
predicted with the odometry and updated with the measurements at the smoother's own linearisation point, is the same matrix as long as
those points stay, at a fraction of the cost while the map is small. It is made anew from the smoother now and then, and whenever
factors are taken out.
"""

import numpy as np

from seo_slam.geometry import FloatArray, adjoint, inverse, skew
from seo_slam.types import IntArray


class JointCovariance:
    """Sigma of Eq 4 over (pose, landmarks): pose rotation first and right-perturbed, landmarks in the world frame."""

    def __init__(self, landmark_ids: IntArray, joint: FloatArray) -> None:
        """Begin with landmark ids (N,) and the (6 + 3N, 6 + 3N) covariance in that order."""
        self._slot = {int(i): n for n, i in enumerate(landmark_ids)}
        self._P = joint

    def __len__(self) -> int:
        return len(self._slot)

    def of(self, landmark_ids: IntArray) -> FloatArray:
        """Return the (6 + 3M, 6 + 3M) covariance of the pose and landmarks (M,), in that order."""
        rows = self._rows(landmark_ids)
        return np.asarray(self._P[np.ix_(rows, rows)], dtype=np.float64)

    def predict(self, T_previous_current: FloatArray, covariance: FloatArray) -> None:
        """Move the pose by an uncertain motion."""
        carry = adjoint(inverse(T_previous_current))
        self._P[:6] = carry @ self._P[:6]
        self._P[:, :6] = self._P[:, :6] @ carry.T
        self._P[:6, :6] += covariance

    def add(self, landmark_id: int, p_camera: FloatArray, cov_camera: FloatArray, T_world_camera: FloatArray) -> None:
        """Append a landmark at ``T_world_camera @ p_camera``: known as well as the pose and this one measurement allow."""
        R = T_world_camera[:3, :3]
        J = np.hstack([-R @ skew(p_camera), R])
        cross = J @ self._P[:6]
        own = J @ self._P[:6, :6] @ J.T + R @ cov_camera @ R.T
        self._P = np.block([[self._P, cross.T], [cross, own]])
        self._slot[landmark_id] = len(self._slot)

    def measure(self, landmark_ids: IntArray, p_camera: FloatArray, cov_camera: FloatArray, R_world_camera: FloatArray) -> None:
        """Take in measurements of known landmarks.

        Args:
            landmark_ids: (M,) no id twice.
            p_camera: (M, 3) where the smoother now has them in the camera frame: the linearisation point.
            cov_camera: (M, 3, 3), robust weights taken into account.
            R_world_camera: (3, 3) of the pose.
        """
        m = len(landmark_ids)
        if m == 0:
            return
        rows = self._rows(landmark_ids)
        H = np.zeros((3 * m, len(rows)))
        noise = np.zeros((3 * m, 3 * m))
        for k in range(m):
            part = slice(3 * k, 3 * k + 3)
            H[part, :3], H[part, 3:6] = skew(p_camera[k]), -np.eye(3)
            H[part, 6 + 3 * k : 9 + 3 * k] = R_world_camera.T
            noise[part, part] = cov_camera[k]
        PHt = self._P[:, rows] @ H.T
        S = H @ PHt[rows] + noise
        self._P -= PHt @ np.linalg.solve(S, PHt.T)
        self._P = 0.5 * (self._P + self._P.T)

    def _rows(self, landmark_ids: IntArray) -> IntArray:
        slots = np.array([self._slot[int(i)] for i in landmark_ids], dtype=np.int64)
        return np.concatenate([np.arange(6), (6 + 3 * slots[:, None] + np.arange(3)).ravel()])
