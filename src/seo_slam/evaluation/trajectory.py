"""How far an estimated trajectory is from the true one: protocols ``ape/1`` and ``rpe/1``.

Sources: Sturm et al., "A Benchmark for the Evaluation of RGB-D SLAM Systems" (IROS 2012), section IV; Umeyama, "Least-squares
estimation of transformation parameters between two point patterns" (PAMI 1991), with the scale held at 1.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from seo_slam.errors import EvaluationError
from seo_slam.geometry import FloatArray, interpolate, inverse, so3_log, transform_points
from seo_slam.records import Trajectory
from seo_slam.types import IntArray

APE_PROTOCOL = "ape/1"
RPE_PROTOCOL = "rpe/1"
ASSOCIATION_S = 0.02
"""A pose is compared only if a true stamp lies this near, seconds."""
_STAMP_RESOLUTION_S = 1e-6  # a float64 of seconds since 1970 resolves 0.2 us
_MIN_POSES = 3
_MIN_SPREAD_M = 1e-4
_MIN_SPREAD_SHARE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class PosePairs:
    """Estimated poses and the true ones at the same moments.

    Attributes:
        timestamps_s: (M,) stamps of the estimate.
        rows: (M,) rows of the estimated trajectory that they come from.
        T_estimate: (M, 4, 4) estimated poses, in the estimate's own world.
        T_truth: (M, 4, 4) interpolated true poses, in the truth's world.
    """

    timestamps_s: FloatArray
    rows: IntArray
    T_estimate: FloatArray
    T_truth: FloatArray

    def __len__(self) -> int:
        return len(self.timestamps_s)


@dataclass(frozen=True, slots=True, eq=False)
class ApeResult:
    """Absolute pose error, translation part, after SE(3) alignment.

    Attributes:
        protocol: "ape/1".
        estimates: poses in the estimated trajectory.
        compared: how many of them the truth covers.
        max_m, mean_m, median_m, rmse_m: of the distances between aligned and true positions.
        association_s: how near a true stamp had to be.
        spread_m: (3,) standard deviation of the compared true positions along their principal axes, largest first. A small
            second value means that the path was nearly a line, and the rotation about it is poorly known.
        T_truth_estimate: (4, 4) the alignment.
        timestamps_s: (M,) stamps compared.
        errors_m: (M,) the distance at each.
    """

    protocol: str
    estimates: int
    compared: int
    max_m: float
    mean_m: float
    median_m: float
    rmse_m: float
    association_s: float
    spread_m: FloatArray
    T_truth_estimate: FloatArray
    timestamps_s: FloatArray
    errors_m: FloatArray

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON types, without the error of each pose."""
        return {
            "protocol": self.protocol,
            "alignment": "SE(3) without scale",
            "association_s": self.association_s,
            "estimates": self.estimates,
            "compared": self.compared,
            "rmse_m": self.rmse_m,
            "mean_m": self.mean_m,
            "median_m": self.median_m,
            "max_m": self.max_m,
            "spread_m": self.spread_m.tolist(),
            "T_truth_estimate": self.T_truth_estimate.tolist(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class RpeResult:
    """Relative pose error: how wrong the motion over a fixed step is.

    Attributes:
        protocol: "rpe/1".
        step: the step in words, for example "1 s" or "10 frames".
        compared: how many steps.
        rmse_m, max_m: of the translation of the error.
        rmse_deg, max_deg: of its rotation angle.
    """

    protocol: str
    step: str
    compared: int
    rmse_m: float
    max_m: float
    rmse_deg: float
    max_deg: float

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON types."""
        return {name: getattr(self, name) for name in self.__slots__}


def associate_poses(estimate: Trajectory, truth: Trajectory, association_s: float = ASSOCIATION_S) -> PosePairs:
    """Pair every estimated pose with the true pose at its stamp.

    A pose is paired if its stamp lies inside the truth's time range and the nearest true stamp is at most ``association_s``
    away. The true pose is interpolated between the true poses before and after (linear in position, geodesic in rotation), so
    that the truth's period adds no error of its own.

    Raises:
        EvaluationError: nothing can be paired; the message gives both time ranges.
    """
    t, stamps = estimate.timestamps_s, truth.timestamps_s
    if not len(t) or not len(stamps):
        raise EvaluationError(f"got {len(t)} estimated and {len(stamps)} true poses; wanted some of each")
    after = np.clip(np.searchsorted(stamps, t, side="left"), 1, max(len(stamps) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(stamps) - 1)
    nearest_s = np.minimum(np.abs(t - stamps[before]), np.abs(t - stamps[after]))
    rows = np.flatnonzero((t >= stamps[0]) & (t <= stamps[-1]) & (nearest_s <= association_s + _STAMP_RESOLUTION_S))
    if not len(rows):
        raise EvaluationError(
            f"no estimated pose has a true pose within {association_s * 1e3:g} ms: the estimate covers "
            f"{t[0]:.3f}..{t[-1]:.3f} s, the truth {stamps[0]:.3f}..{stamps[-1]:.3f} s; wanted stamps of the same clock"
        )
    T_truth = np.array([_pose_at(truth, int(before[row]), int(after[row]), float(t[row])) for row in rows])
    return PosePairs(t[rows], rows.astype(np.int64), estimate.T_world_camera[rows], T_truth)


def _pose_at(truth: Trajectory, before: int, after: int, timestamp_s: float) -> FloatArray:
    start, end = truth.timestamps_s[before], truth.timestamps_s[after]
    share = float((timestamp_s - start) / (end - start)) if end > start else 0.0
    return interpolate(truth.T_world_camera[before], truth.T_world_camera[after], share)


def align_points(p_estimate: FloatArray, p_truth: FloatArray) -> FloatArray:
    """Return the rigid (4, 4) ``T_truth_estimate`` that brings points (M, 3) nearest to others (least squares, no scale).

    Raises:
        EvaluationError: fewer than three points, or they lie on a line (or in one point), so that no rotation is determined.
    """
    if len(p_estimate) < _MIN_POSES:
        raise EvaluationError(f"cannot align {len(p_estimate)} poses; wanted at least {_MIN_POSES} that match in time")
    for name, points in (("estimated", p_estimate), ("true", p_truth)):
        spread = spread_m(points)
        if spread[1] < max(_MIN_SPREAD_M, _MIN_SPREAD_SHARE * spread[0]):
            raise EvaluationError(
                f"cannot align: the {len(points)} {name} positions lie on a line or in a point (standard deviations "
                f"{spread[0]:.2g}, {spread[1]:.2g}, {spread[2]:.2g} m along their axes), which leaves a rotation open"
            )
    mean_estimate, mean_truth = p_estimate.mean(axis=0), p_truth.mean(axis=0)
    U, _, Vt = np.linalg.svd((p_truth - mean_truth).T @ (p_estimate - mean_estimate))
    mirror = np.diag([1.0, 1.0, float(np.sign(np.linalg.det(U) * np.linalg.det(Vt)))])
    T = np.eye(4)
    T[:3, :3] = U @ mirror @ Vt
    T[:3, 3] = mean_truth - T[:3, :3] @ mean_estimate
    return T


def spread_m(points: FloatArray) -> FloatArray:
    """Standard deviations (3,) of points (M, 3) along their principal axes, largest first."""
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / np.sqrt(len(points))
    return np.pad(values, (0, 3 - len(values)))


def align(estimate: Trajectory, truth: Trajectory, association_s: float = ASSOCIATION_S) -> FloatArray:
    """Return the (4, 4) ``T_truth_estimate`` that brings the estimated positions nearest to the true ones.

    Raises:
        EvaluationError: fewer than three poses match in time, or they lie on a line.
    """
    pairs = associate_poses(estimate, truth, association_s)
    return align_points(pairs.T_estimate[:, :3, 3], pairs.T_truth[:, :3, 3])


def ape(estimate: Trajectory, truth: Trajectory, association_s: float = ASSOCIATION_S) -> ApeResult:
    """Absolute pose error of a trajectory, protocol ``ape/1``.

    Args:
        estimate: poses in any world of their own.
        truth: poses in the true world.
        association_s: see ``associate_poses``.

    Raises:
        EvaluationError: fewer than three poses match in time, or they lie on a line.
    """
    pairs = associate_poses(estimate, truth, association_s)
    p_estimate, p_truth = pairs.T_estimate[:, :3, 3], pairs.T_truth[:, :3, 3]
    T_truth_estimate = align_points(p_estimate, p_truth)
    errors_m = np.linalg.norm(transform_points(T_truth_estimate, p_estimate) - p_truth, axis=1)
    return ApeResult(
        protocol=APE_PROTOCOL,
        estimates=len(estimate),
        compared=len(pairs),
        max_m=float(errors_m.max()),
        mean_m=float(errors_m.mean()),
        median_m=float(np.median(errors_m)),
        rmse_m=_rms(errors_m),
        association_s=association_s,
        spread_m=spread_m(p_truth),
        T_truth_estimate=T_truth_estimate,
        timestamps_s=pairs.timestamps_s,
        errors_m=errors_m,
    )


def rpe(
    estimate: Trajectory,
    truth: Trajectory,
    *,
    step_s: float | None = None,
    step_frames: int | None = None,
    association_s: float = ASSOCIATION_S,
) -> RpeResult:
    """Relative pose error over a fixed step, protocol ``rpe/1``. No alignment is needed: only motions are compared.

    Args:
        estimate: poses in any world of their own.
        truth: poses in the true world.
        step_s: compare motions over this many seconds (the pose nearest to it in time, within ``association_s``); or
        step_frames: over this many poses of the estimate. Give one of the two.
        association_s: see ``associate_poses``.

    Raises:
        EvaluationError: not exactly one positive step was given, or no step of that length is covered by both.
    """
    if (step_s is None) == (step_frames is None) or (step_s or step_frames or 0) <= 0:
        raise EvaluationError(f"rpe: got step_s={step_s}, step_frames={step_frames}; wanted one of them, above 0")
    pairs = associate_poses(estimate, truth, association_s)
    if step_s is not None:
        step = f"{step_s:g} s"
        starts, ends = _steps(pairs.timestamps_s, step_s, association_s + _STAMP_RESOLUTION_S)
    else:
        step = f"{step_frames} frames"
        starts, ends = _steps(pairs.rows.astype(np.float64), float(step_frames or 0), 0.0)
    if not len(starts):
        raise EvaluationError(f"rpe: no step of {step} is covered by both trajectories ({len(pairs)} poses match in time)")
    moved_m, turned_deg = np.transpose([_motion_error(pairs, int(i), int(j)) for i, j in zip(starts, ends, strict=True)])
    return RpeResult(
        protocol=RPE_PROTOCOL,
        step=step,
        compared=len(starts),
        rmse_m=_rms(moved_m),
        max_m=float(moved_m.max()),
        rmse_deg=_rms(turned_deg),
        max_deg=float(turned_deg.max()),
    )


def _steps(positions: FloatArray, step: float, tolerance: float) -> tuple[IntArray, IntArray]:
    """Rows (i, j) whose ``positions`` (rising) differ by ``step`` within ``tolerance``, at most one j for an i."""
    wanted = positions + step
    right = np.clip(np.searchsorted(positions, wanted), 1, max(len(positions) - 1, 1))
    right = np.minimum(right, len(positions) - 1)
    left = np.maximum(right - 1, 0)
    ends = np.where(np.abs(positions[left] - wanted) < np.abs(positions[right] - wanted), left, right)
    starts = np.flatnonzero((np.abs(positions[ends] - wanted) <= tolerance) & (ends > np.arange(len(positions))))
    return starts.astype(np.int64), ends[starts].astype(np.int64)


def _motion_error(pairs: PosePairs, start: int, end: int) -> tuple[float, float]:
    estimated = inverse(pairs.T_estimate[start]) @ pairs.T_estimate[end]
    true = inverse(pairs.T_truth[start]) @ pairs.T_truth[end]
    error = inverse(true) @ estimated
    return float(np.linalg.norm(error[:3, 3])), float(np.degrees(np.linalg.norm(so3_log(error[:3, :3]))))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
