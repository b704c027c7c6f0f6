"""Odometry of a robot that drives as it likes: poses come one by one instead of from a file."""

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray, exp, inverse, so3_log
from seo_slam.simulation.draws import generator
from seo_slam.simulation.sensors import SensorKnobs
from seo_slam.types import Frame, Motion

_SIGMA_M, _SIGMA_RAD = 0.002, np.radians(0.05)  # of a step whose poses are given
_WALK_M, _WALK_RAD = 0.01, np.radians(0.5)  # on the first metre, where they drift


class DrivenOdometry:
    """Reports the motion between frames, exactly, or with a drift that grows as of ``drifting_odometry``."""

    def __init__(self, knobs: SensorKnobs | None = None, key: tuple[int, ...] = ()) -> None:
        """Choose how it drifts.

        Args:
            knobs: their drift; None: the true poses are reported.
            key: of the draws.
        """
        self._knobs = knobs
        self._key = key
        self._true: FloatArray | None = None
        self._reported: dict[float, FloatArray] = {}
        self._newest: FloatArray | None = None
        self._previous: FloatArray | None = None

    def moved_to(self, timestamp_s: float, T_world_camera: FloatArray) -> None:
        """Take the true pose of the next frame; the first one is reported as it is."""
        if self._true is None or self._newest is None or self._knobs is None:
            reported = T_world_camera
        else:
            step = inverse(self._true) @ T_world_camera
            reported = self._newest @ step @ exp(self._slip(step, self._knobs, len(self._reported)))
        self._true, self._newest = T_world_camera, reported
        self._reported[timestamp_s] = reported

    def update(self, frame: Frame) -> Motion:
        """Return the motion from the frame given before to this one; ``T_world_camera`` is the reported pose.

        Raises:
            FrameError: the robot took no such frame.
        """
        if frame.timestamp_s not in self._reported:
            raise FrameError(f"frame {frame.index} (t={frame.timestamp_s}): the robot has reported no pose for it")
        T_world_camera = self._reported[frame.timestamp_s]
        step = inverse(T_world_camera if self._previous is None else self._previous) @ T_world_camera
        self._previous = T_world_camera
        root_m = float(np.sqrt(np.linalg.norm(step[:3, 3]))) if self._knobs else 0.0
        sigma_rad, sigma_m = np.hypot(_SIGMA_RAD, _WALK_RAD * root_m), np.hypot(_SIGMA_M, _WALK_M * root_m)
        return Motion(step, np.diag([sigma_rad**2] * 3 + [sigma_m**2] * 3), T_world_camera=T_world_camera)

    def _slip(self, step: FloatArray, knobs: SensorKnobs, index: int) -> FloatArray:
        walked_m, turned_rad = float(np.linalg.norm(step[:3, 3])), float(np.linalg.norm(so3_log(step[:3, :3])))
        twist = generator("driven odometry", *self._key, index).standard_normal(6)
        twist[:3] *= np.radians(np.hypot(knobs.drift_deg * np.sqrt(walked_m), knobs.turn_drift_deg * np.sqrt(turned_rad)))
        twist[3:] *= knobs.drift_m * np.sqrt(walked_m)
        return np.asarray(twist)
