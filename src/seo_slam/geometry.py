"""SE(3) on 4x4 arrays.

``T_a_b`` maps b-coordinates to a: ``p_a = T_a_b @ p_b``. A tangent vector ``xi`` has its rotation first (``[omega, v]``) and
acts on the right (``T @ exp(xi)``), as in GTSAM. Sources: Barfoot, "State Estimation for Robotics", ch. 7; GTSAM's Pose3.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from seo_slam.errors import FrameError

FloatArray = NDArray[np.float64]
AnyArray = NDArray[Any]

_SMALL_ANGLE_RAD = 1e-8


def skew(v: ArrayLike) -> FloatArray:
    """Return the (3, 3) matrix with ``skew(v) @ w == cross(v, w)``."""
    x, y, z = np.asarray(v, dtype=np.float64)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def so3_exp(omega: ArrayLike) -> FloatArray:
    """Return the rotation matrix of the rotation vector ``omega`` (3,), in radians."""
    w = np.asarray(omega, dtype=np.float64)
    angle = float(np.linalg.norm(w))
    K = skew(w)
    if angle < _SMALL_ANGLE_RAD:
        return np.eye(3) + K + 0.5 * K @ K
    a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    return np.asarray(np.eye(3) + a * K + b * (K @ K), dtype=np.float64)


def so3_log(R: ArrayLike) -> FloatArray:
    """Return the rotation vector (3,) of a rotation matrix, its angle in [0, pi]."""
    w, x, y, z = quaternion_from_rotation(R)
    v = np.array([x, y, z])
    s = float(np.linalg.norm(v))
    if s < _SMALL_ANGLE_RAD:
        return np.asarray(2.0 * v / w, dtype=np.float64)
    return np.asarray(2.0 * np.arctan2(s, w) / s * v, dtype=np.float64)


def _left_jacobian(omega: FloatArray) -> FloatArray:
    angle = float(np.linalg.norm(omega))
    K = skew(omega)
    if angle < 1e-5:
        return np.eye(3) + 0.5 * K + K @ K / 6.0
    return np.asarray(
        np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * K + (angle - np.sin(angle)) / angle**3 * (K @ K),
        dtype=np.float64,
    )


def exp(xi: ArrayLike) -> FloatArray:
    """Return the (4, 4) transform of a tangent vector ``xi`` (6,), rotation first."""
    v = np.asarray(xi, dtype=np.float64)
    T = np.eye(4)
    T[:3, :3] = so3_exp(v[:3])
    T[:3, 3] = _left_jacobian(v[:3]) @ v[3:]
    return T


def log(T: ArrayLike) -> FloatArray:
    """Return the tangent vector (6,), rotation first, of a (4, 4) transform."""
    M = np.asarray(T, dtype=np.float64)
    omega = so3_log(M[:3, :3])
    return np.concatenate([omega, np.linalg.solve(_left_jacobian(omega), M[:3, 3])])


def inverse(T: ArrayLike) -> FloatArray:
    """Return the inverse of a (4, 4) rigid transform."""
    M = np.asarray(T, dtype=np.float64)
    out = np.eye(4)
    out[:3, :3] = M[:3, :3].T
    out[:3, 3] = -M[:3, :3].T @ M[:3, 3]
    return out


def adjoint(T: ArrayLike) -> FloatArray:
    """Return the (6, 6) adjoint: ``T @ exp(xi) == exp(adjoint(T) @ xi) @ T``."""
    M = np.asarray(T, dtype=np.float64)
    R = M[:3, :3]
    out = np.zeros((6, 6))
    out[:3, :3] = R
    out[3:, 3:] = R
    out[3:, :3] = skew(M[:3, 3]) @ R
    return out


def transform_points(T_a_b: ArrayLike, p_b: ArrayLike) -> FloatArray:
    """Return ``p_b`` (..., 3) in frame a, in metres."""
    M = np.asarray(T_a_b, dtype=np.float64)
    return np.asarray(np.asarray(p_b, dtype=np.float64) @ M[:3, :3].T + M[:3, 3], dtype=np.float64)


def compose_motion(T_a_b: FloatArray, cov_ab: FloatArray, T_b_c: FloatArray, cov_bc: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Chain two uncertain motions, each with a right-perturbed (6, 6) covariance.

    Returns:
        ``T_a_c`` and its covariance: ``Ad(T_c_b) cov_ab Ad(T_c_b)^T + cov_bc`` (Barfoot, section 7.3, first order).
    """
    Ad = adjoint(inverse(T_b_c))
    return T_a_b @ T_b_c, Ad @ cov_ab @ Ad.T + cov_bc


def diagonal_blocks(joint: FloatArray) -> FloatArray:
    """Return the (N, 3, 3) symmetric blocks on the diagonal of a (3N, 3N) matrix."""
    n = joint.shape[0] // 3
    blocks = joint.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :]
    return np.asarray(0.5 * (blocks + blocks.transpose(0, 2, 1)), dtype=np.float64)


def quaternion_from_rotation(R: ArrayLike) -> FloatArray:
    """Return the unit quaternion ``[w, x, y, z]``, w >= 0, of a rotation matrix (Shepperd's method)."""
    M = np.asarray(R, dtype=np.float64)
    t = float(np.trace(M))
    candidates = np.array([t, M[0, 0], M[1, 1], M[2, 2]])
    i = int(np.argmax(candidates))
    if i == 0:
        q = np.array([1.0 + t, M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])
    elif i == 1:
        q = np.array([M[2, 1] - M[1, 2], 1.0 + 2.0 * M[0, 0] - t, M[0, 1] + M[1, 0], M[0, 2] + M[2, 0]])
    elif i == 2:
        q = np.array([M[0, 2] - M[2, 0], M[0, 1] + M[1, 0], 1.0 + 2.0 * M[1, 1] - t, M[1, 2] + M[2, 1]])
    else:
        q = np.array([M[1, 0] - M[0, 1], M[0, 2] + M[2, 0], M[1, 2] + M[2, 1], 1.0 + 2.0 * M[2, 2] - t])
    q /= np.linalg.norm(q)
    return np.asarray(-q if q[0] < 0 else q, dtype=np.float64)


def rotation_from_quaternion(q_wxyz: ArrayLike) -> FloatArray:
    """Return the rotation matrix of a quaternion ``[w, x, y, z]`` of any positive norm.

    Raises:
        FrameError: the quaternion is not finite or has no length.
    """
    q = np.asarray(q_wxyz, dtype=np.float64)
    n = float(np.linalg.norm(q))
    if q.shape != (4,) or not np.isfinite(n) or n < 1e-9:
        raise FrameError(f"quaternion [w, x, y, z]: got {q.tolist()}, wanted four finite numbers with a norm above 0")
    w, x, y, z = q / n
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def interpolate(T_world_a: FloatArray, T_world_b: FloatArray, share: float) -> FloatArray:
    """Return the pose a ``share`` (0..1) of the way from a to b: linear in position, geodesic in rotation."""
    out = np.eye(4)
    out[:3, :3] = T_world_a[:3, :3] @ so3_exp(share * so3_log(T_world_a[:3, :3].T @ T_world_b[:3, :3]))
    out[:3, 3] = (1.0 - share) * T_world_a[:3, 3] + share * T_world_b[:3, 3]
    return out


def require_transform(T: ArrayLike, name: str, tolerance: float = 1e-3) -> FloatArray:
    """Return ``T`` as a (4, 4) float64 transform whose rotation is exactly orthonormal.

    A rotation that is off by rounding (up to ``tolerance`` in any entry of R^T R) is projected to the nearest one (SVD); GTSAM
    ends the process on worse ones, so they must not reach it.

    Raises:
        FrameError: wrong shape, not finite, not a rotation, or a mirrored one.
    """
    M = np.asarray(T, dtype=np.float64)
    if M.shape != (4, 4):
        raise FrameError(f"{name}: got shape {M.shape}, wanted a (4, 4) transform")
    if not np.isfinite(M).all():
        raise FrameError(f"{name}: got NaN or infinity, wanted a finite (4, 4) transform")
    R = M[:3, :3]
    error = float(np.abs(R.T @ R - np.eye(3)).max())
    if error > tolerance or np.linalg.det(R) < 0 or np.abs(M[3] - [0, 0, 0, 1]).max() > tolerance:
        raise FrameError(
            f"{name}: not a rigid transform (largest entry of R^T R - I is {error:.3g}, det R is {np.linalg.det(R):.3g}, "
            f"last row {M[3].tolist()}); wanted a rotation and the last row [0, 0, 0, 1]"
        )
    U, _, Vt = np.linalg.svd(R)
    out = np.eye(4)
    out[:3, :3] = U @ Vt
    out[:3, 3] = M[:3, 3]
    return out
