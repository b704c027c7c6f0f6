"""Camera paths: smooth, seeded, gravity known."""

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.simulation.draws import generator


def look_at(p_world_eye: FloatArray, p_world_target: FloatArray) -> FloatArray:
    """Return ``T_world_camera`` (4, 4) of a level camera at one point (3,) that looks at another.

    Raises:
        ConfigError: the points coincide, or one is straight above the other.
    """
    forward = np.asarray(p_world_target, dtype=np.float64) - p_world_eye
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9:
        raise ConfigError(f"look_at: got eye {p_world_eye} and target {p_world_target}, wanted a line of sight that is not vertical")
    z, x = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    T[:3, 3] = p_world_eye
    return T


def swaying_arc(
    p_world_target: FloatArray,
    frames: int,
    seed: int = 0,
    rate_hz: float = 15.0,
    radius_m: tuple[float, float] = (1.25, 1.7),
    height_m: tuple[float, float] = (0.45, 0.8),
    span_rad: float = 1.6,
) -> Trajectory:
    """Walk an arc in front of a target (on its -y side), looking at it, with the sway of a hand.

    Args:
        p_world_target: (3,) what is looked at.
        frames: how many poses.
        seed: of the sway.
        rate_hz: frames a second; the first stamp is 0.
        radius_m: horizontal distance, least and most.
        height_m: height above the target, least and most.
        span_rad: angle of the arc, its middle at -y.

    Raises:
        ConfigError: fewer than two frames.
    """
    if frames < 2:
        raise ConfigError(f"frames: got {frames}, wanted at least 2")
    share = np.linspace(0.0, 1.0, frames)
    draws = generator(seed, "trajectory")
    sway = np.stack([_sway(share, draws) for _ in range(5)])
    ahead = float(draws.choice((-1.0, 1.0)))
    # The arc is walked with the gentle start and stop of a half cosine.
    azimuth = ahead * span_rad / 2.0 * -np.cos(np.pi * share) + 0.03 * sway[0] - np.pi / 2.0
    radius = np.mean(radius_m) + 0.5 * np.ptp(radius_m) * sway[1]
    height = np.mean(height_m) + 0.5 * np.ptp(height_m) * sway[2]
    eyes = p_world_target + np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)
    across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(frames)], axis=-1)
    targets = p_world_target + 0.18 * sway[3, :, None] * across + 0.05 * sway[4, :, None] * np.array([0.0, 0.0, 1.0])
    poses = np.stack([look_at(eye, target) for eye, target in zip(eyes, targets, strict=True)])
    return Trajectory(np.round(np.arange(frames) / rate_hz, 6), poses)


def _sway(share: FloatArray, draws: np.random.Generator) -> FloatArray:
    """A smooth curve in -1..1: three slow sines."""
    curve = np.zeros_like(share)
    for cycles, weight in ((0.7, 0.55), (1.6, 0.3), (2.7, 0.15)):
        curve += weight * np.sin(2.0 * np.pi * (cycles * float(draws.uniform(0.8, 1.2)) * share + float(draws.uniform())))
    return curve
