"""Trajectories as text, in the format of the TUM RGB-D benchmark: ``t tx ty tz qx qy qz qw``, seconds and metres."""

import logging
from pathlib import Path

import numpy as np

from seo_slam.datasets.text_files import read_numbers
from seo_slam.errors import DatasetError
from seo_slam.geometry import FloatArray, interpolate, quaternion_from_rotation
from seo_slam.records import Trajectory

logger = logging.getLogger(__name__)

ODOMETRY_FILE = "odometry.txt"
GROUNDTRUTH_FILE = "groundtruth.txt"
_NORM_TOLERANCE = 1e-2


def read_trajectory(path: str | Path) -> Trajectory:
    """Read poses ``T_world_camera``.

    A quaternion that is off its unit length by rounding is normalised. Where a stamp repeats (some files of the benchmark do
    that) the first pose counts.

    Raises:
        DatasetError: names file and line of a wrong number of columns, of what is not a finite number, of a quaternion that is
            not a rotation, of a stamp that goes backwards; or the file is missing or holds no pose.
    """
    file = Path(path)
    rows, lines = read_numbers(file, (8,), "timestamp tx ty tz qx qy qz qw")
    if not lines:
        raise DatasetError(f"{file}: holds no poses; wanted lines of timestamp tx ty tz qx qy qz qw")
    norms = np.linalg.norm(rows[:, 4:], axis=1)
    bad = np.flatnonzero(np.abs(norms - 1.0) > _NORM_TOLERANCE)
    if len(bad):
        i = int(bad[0])
        raise DatasetError(
            f"{file}:{lines[i]}: quaternion {rows[i, 4:].tolist()} has norm {norms[i]:.4g}, wanted 1: not a rotation "
            "(the order is qx qy qz qw)"
        )
    steps_s = np.diff(rows[:, 0])
    backwards = np.flatnonzero(steps_s < 0)
    if len(backwards):
        i = int(backwards[0]) + 1
        raise DatasetError(f"{file}:{lines[i]}: time goes backwards, from {rows[i - 1, 0]:.6f} to {rows[i, 0]:.6f} s")
    repeats = np.flatnonzero(steps_s == 0) + 1
    if len(repeats):
        logger.info("%s: %d repeated stamps (first in line %d) are left out", file, len(repeats), lines[int(repeats[0])])
        rows, norms = np.delete(rows, repeats, axis=0), np.delete(norms, repeats)
    T_world_camera = np.tile(np.eye(4), (len(rows), 1, 1))
    T_world_camera[:, :3, :3] = _rotations(rows[:, 4:] / norms[:, None])
    T_world_camera[:, :3, 3] = rows[:, 1:4]
    return Trajectory(timestamps_s=rows[:, 0], T_world_camera=T_world_camera)


def _rotations(q_xyzw: FloatArray) -> FloatArray:
    """(N, 3, 3) rotations of unit quaternions (N, 4)."""
    x, y, z, w = q_xyzw.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def write_trajectory(path: str | Path, trajectory: Trajectory) -> None:
    """Write poses in TUM format; stamps come back exactly, poses to 1e-9.

    Raises:
        DatasetError: the file cannot be written.
    """
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for stamp_s, T in zip(trajectory.timestamps_s, trajectory.T_world_camera, strict=True):
        w, x, y, z = quaternion_from_rotation(T[:3, :3])
        numbers = " ".join(f"{value + 0.0:.9f}" for value in (*T[:3, 3], x, y, z, w))
        lines.append(f"{np.format_float_positional(stamp_s, trim='0')} {numbers}")
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{path}: cannot be written: {error.strerror}") from None


def interpolate_pose(trajectory: Trajectory, timestamp_s: float, max_gap_s: float) -> FloatArray | None:
    """Return ``T_world_camera`` (4, 4) at a time: linear in position, geodesic in rotation.

    Returns:
        None before the first and after the last pose, and between two poses that are more than ``max_gap_s`` apart.
    """
    stamps_s = trajectory.timestamps_s
    after = int(np.searchsorted(stamps_s, timestamp_s))
    if after < len(stamps_s) and stamps_s[after] == timestamp_s:
        return np.array(trajectory.T_world_camera[after])
    if after in (0, len(stamps_s)):
        return None
    gap_s = float(stamps_s[after] - stamps_s[after - 1])
    if gap_s > max_gap_s:
        return None
    share = (timestamp_s - float(stamps_s[after - 1])) / gap_s
    return interpolate(trajectory.T_world_camera[after - 1], trajectory.T_world_camera[after], share)


def usual_max_gap_s(trajectory: Trajectory) -> float:
    """Return the gap up to which poses are interpolated if nothing else is said: 2.5 median periods, but at least 0.25 s.

    A hand-held camera accelerates by some 1 m/s^2; over 0.25 s a straight line is then at most 8 mm off, within the noise that the
    recorded odometry assumes.
    """
    periods_s = np.diff(trajectory.timestamps_s)
    return max(0.25, 2.5 * float(np.median(periods_s))) if len(periods_s) else 0.25


def pick_trajectory(dataset_folder: str | Path, explicit: str | Path | None = None) -> Path | None:
    """Return the file whose poses the recorded odometry replays: ``explicit``, else odometry.txt, else groundtruth.txt, else None.

    Raises:
        DatasetError: the ``explicit`` file does not exist.
    """
    if explicit is not None:
        if not Path(explicit).is_file():
            raise DatasetError(f"{explicit}: no such trajectory file")
        return Path(explicit)
    files = (Path(dataset_folder) / name for name in (ODOMETRY_FILE, GROUNDTRUTH_FILE))
    return next((file for file in files if file.is_file()), None)
