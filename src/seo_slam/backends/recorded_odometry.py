"""Odometry that replays recorded poses: ground truth, or what the robot reported."""

from pathlib import Path

import numpy as np

from seo_slam.datasets.trajectory_files import interpolate_pose, read_trajectory, usual_max_gap_s
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray, inverse
from seo_slam.records import Trajectory
from seo_slam.types import Frame, Motion


class RecordedOdometry:
    """Interpolates a trajectory at the stamps of the frames.

    Where the trajectory has no pose, the status is "lost": the camera is taken to stand at the last pose known (before the first
    one: at the first). The motion after a gap starts from that guess, so that the chain of all motions is exact again.
    """

    def __init__(
        self,
        trajectory: Trajectory | str | Path,
        sigma_m: float = 0.002,
        sigma_deg: float = 0.05,
        walk_m: float = 0.01,
        walk_deg: float = 0.5,
        max_gap_s: float | None = None,
        lost_sigma_m: float = 0.5,
        lost_sigma_deg: float = 30.0,
    ) -> None:
        """Take poses, or read them from a TUM file.

        The noise is a random walk: the variance of a step is that of its two poses, and grows with the distance travelled. The defaults
        are those of a fair robot, 1 cm and half a degree on the first metre.

        Args:
            trajectory: poses ``T_world_camera``, or their file.
            sigma_m: metres a step, along each axis.
            sigma_deg: degrees a step, about each axis.
            walk_m: metres a root metre travelled.
            walk_deg: degrees a root metre travelled.
            max_gap_s: poses farther apart are not interpolated; None: ``usual_max_gap_s``.
            lost_sigma_m: metres, of the guess while lost.
            lost_sigma_deg: degrees, of the guess while lost.

        Raises:
            DatasetError: the file cannot be read.
            ConfigError: a noise that is not above 0, a walk below 0, an empty trajectory.
        """
        for name, value in (
            ("sigma_m", sigma_m),
            ("sigma_deg", sigma_deg),
            ("lost_sigma_m", lost_sigma_m),
            ("lost_sigma_deg", lost_sigma_deg),
            ("max_gap_s", 1.0 if max_gap_s is None else max_gap_s),
        ):
            if not value > 0:
                raise ConfigError(f"recorded odometry: {name}: got {value}, wanted above 0")
        if not (walk_m >= 0 and walk_deg >= 0):
            raise ConfigError(f"recorded odometry: got walk_m {walk_m} and walk_deg {walk_deg}, wanted 0 or more")
        self.trajectory = trajectory if isinstance(trajectory, Trajectory) else read_trajectory(trajectory)
        if not len(self.trajectory):
            raise ConfigError("recorded odometry: the trajectory holds no poses")
        self.max_gap_s = usual_max_gap_s(self.trajectory) if max_gap_s is None else max_gap_s
        self._sigma_m, self._walk_m = sigma_m, walk_m
        self._sigma_rad, self._walk_rad = np.radians(sigma_deg), np.radians(walk_deg)
        self._lost = _covariance(np.radians(lost_sigma_deg), lost_sigma_m)
        self._T_world_previous: FloatArray | None = None

    def update(self, frame: Frame) -> Motion:
        """Return the motion from the frame given before to this one; ``T_world_camera`` is the pose itself."""
        T_world_camera = interpolate_pose(self.trajectory, frame.timestamp_s, self.max_gap_s)
        if T_world_camera is None:
            return self._lost_at(frame.timestamp_s)
        previous = T_world_camera if self._T_world_previous is None else self._T_world_previous
        self._T_world_previous = T_world_camera
        T_previous_current = inverse(previous) @ T_world_camera
        step_m = float(np.linalg.norm(T_previous_current[:3, 3]))
        root_m = float(np.sqrt(step_m))
        covariance = _covariance(
            float(np.hypot(self._sigma_rad, self._walk_rad * root_m)), float(np.hypot(self._sigma_m, self._walk_m * root_m))
        )
        return Motion(T_previous_current, covariance, T_world_camera=T_world_camera)

    def _lost_at(self, timestamp_s: float) -> Motion:
        stamps_s = self.trajectory.timestamps_s
        after = int(np.searchsorted(stamps_s, timestamp_s))
        if self._T_world_previous is None:  # nothing known yet: stand where the trajectory is nearest
            self._T_world_previous = np.array(self.trajectory.T_world_camera[max(0, after - 1)])
        # The same words for all frames of a gap, so that a run counts them as one warning.
        if after == 0:
            why = f"the first one is at {stamps_s[0]:.3f} s"
        elif after == len(stamps_s):
            why = f"the last one is at {stamps_s[-1]:.3f} s"
        else:
            gap_s = stamps_s[after] - stamps_s[after - 1]
            why = (
                f"those at {stamps_s[after - 1]:.3f} and {stamps_s[after]:.3f} s are {gap_s:.3f} s apart, more than {self.max_gap_s:.3f} s"
            )
        return Motion(
            T_previous_current=np.eye(4),
            covariance=self._lost.copy(),
            status="lost",
            message=f"no recorded pose here: {why}",
            T_world_camera=self._T_world_previous,
        )


def _covariance(sigma_rad: float, sigma_m: float) -> FloatArray:
    return np.diag([sigma_rad**2] * 3 + [sigma_m**2] * 3)
