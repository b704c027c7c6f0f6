"""Imperfect sensors: a depth camera with noise, steps and holes, and an odometry that drifts."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import ConfigError
from seo_slam.geometry import exp, inverse, so3_log
from seo_slam.records import Trajectory
from seo_slam.simulation.draws import generator

DEPTH_UNITS_PER_M = 5000.0
"""Depth is rounded to these, as the PNG files of a TUM recording hold it; frames in memory and on disk are then the same."""

_BASELINE_FOCAL_M_PX = 0.075 * 580.0  # of a Kinect v1: depth is this over disparity, whatever the size of the image


def require_level(level: float) -> float:
    """Return ``level``.

    Raises:
        ConfigError: it is below 0, or not finite.
    """
    if not np.isfinite(level) or level < 0:
        raise ConfigError(f"level: got {level}, wanted 0 (perfect) or more; 1 is a poor day")
    return float(level)


@dataclass(frozen=True, slots=True)
class SensorKnobs:
    """How imperfect depth and odometry are.

    Attributes:
        depth_noise: factor on the axial noise ``0.0012 + 0.0019 (z - 0.4)^2`` m (Nguyen, Izadi and Lovell 2012, for a Kinect v1).
        lateral_px: standard deviation of the pixel that a depth really comes from.
        disparity_step_px: depth comes in steps of this much disparity; 0 for none.
        holes: chance that a pixel at a depth edge has no return.
        drift_m, drift_deg: standard deviation, per axis, that a random walk of the odometry gathers on the first metre travelled; it grows
            with the square root of the distance.
        turn_drift_deg: the same for rotation, on the first radian turned; no level sets it.
    """

    depth_noise: float = 0.0
    lateral_px: float = 0.0
    disparity_step_px: float = 0.0
    holes: float = 0.0
    drift_m: float = 0.0
    drift_deg: float = 0.0
    turn_drift_deg: float = 0.0

    @classmethod
    def at_level(cls, level: float) -> Self:
        """Return the knobs of a level: 0 is a perfect sensor, 1 the reference.

        Raises:
            ConfigError: the level is below 0.
        """
        if require_level(level) == 0:
            return cls()
        return cls(
            depth_noise=level,
            lateral_px=0.5,
            disparity_step_px=0.125,
            holes=min(0.35 * level, 0.95),
            drift_m=0.012 * level,
            drift_deg=0.6 * level,
        )


def sense_depth(depth_m: NDArray[np.float32], knobs: SensorKnobs, seed: int, frame_index: int) -> NDArray[np.float32]:
    """Return what a real sensor makes of a perfect depth image.

    Args:
        depth_m: (H, W) metres along z, 0 = nothing there.
        knobs: how imperfect.
        seed: of the draws.
        frame_index: which frame; the other half of the key of the draws.

    Returns:
        (H, W) float32, rounded to ``DEPTH_UNITS_PER_M``; 0 = no return.
    """
    draws = generator(seed, "depth", frame_index)
    out = depth_m.astype(np.float64)
    if knobs.lateral_px:
        out = _from_beside(out, knobs.lateral_px, draws)
    there = out > 0
    if knobs.depth_noise:
        sigma = knobs.depth_noise * axial_sigma_m(out)
        out += sigma * draws.standard_normal(out.shape)
    if knobs.disparity_step_px:
        steps = _BASELINE_FOCAL_M_PX / np.maximum(out, 0.1) / knobs.disparity_step_px
        out = _BASELINE_FOCAL_M_PX / knobs.disparity_step_px / np.maximum(np.round(steps), 1.0)
    if knobs.holes:
        there &= ~(depth_edges(depth_m) & (draws.random(out.shape) < knobs.holes))
    units = np.round(np.clip(out * DEPTH_UNITS_PER_M, 0, np.iinfo(np.uint16).max))
    return np.where(there, units / DEPTH_UNITS_PER_M, 0.0).astype(np.float32)


def axial_sigma_m(depth_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviation of depth along the ray, in metres, at level 1."""
    return 0.0012 + 0.0019 * (depth_m - 0.4) ** 2


def _from_beside(depth_m: NDArray[np.float64], sigma_px: float, draws: np.random.Generator) -> NDArray[np.float64]:
    height, width = depth_m.shape
    v, u = np.indices(depth_m.shape)
    dv, du = np.round(sigma_px * draws.standard_normal((2, height, width))).astype(np.int64)
    beside: NDArray[np.float64] = depth_m[np.clip(v + dv, 0, height - 1), np.clip(u + du, 0, width - 1)]
    return beside


def depth_edges(depth_m: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return (H, W) whether a pixel lies beside a jump in depth of more than 4 % (2 cm at half a metre)."""
    edge = np.zeros(depth_m.shape, dtype=np.bool_)
    across = np.abs(np.diff(depth_m, axis=1)) > 0.04 * np.minimum(depth_m[:, 1:], depth_m[:, :-1])
    down = np.abs(np.diff(depth_m, axis=0)) > 0.04 * np.minimum(depth_m[1:], depth_m[:-1])
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return edge


def drifting_odometry(truth: Trajectory, knobs: SensorKnobs, seed: int) -> Trajectory:
    """Return what a robot's odometry would report: it starts at the first true pose and then adds up noisy steps.

    Each step is perturbed on the right by a random twist whose variance grows with the length of the step (a random walk), and with
    its angle if ``turn_drift_deg`` is set.
    """
    poses = [truth.T_world_camera[0]]
    for index in range(1, len(truth)):
        step = inverse(truth.T_world_camera[index - 1]) @ truth.T_world_camera[index]
        walked_m, turned_rad = (float(np.linalg.norm(v)) for v in (step[:3, 3], so3_log(step[:3, :3])))
        twist = generator(seed, "odometry", index).standard_normal(6)
        twist[:3] *= np.radians(np.hypot(knobs.drift_deg * np.sqrt(walked_m), knobs.turn_drift_deg * np.sqrt(turned_rad)))
        twist[3:] *= knobs.drift_m * np.sqrt(walked_m)
        poses.append(poses[-1] @ step @ exp(twist))
    return Trajectory(truth.timestamps_s.copy(), np.stack(poses))
