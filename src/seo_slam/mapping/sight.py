"""What a depth image says about the places of landmarks: seen, hidden, or seen through (SEO-SLAM III-C, and its other half).

The paper projects a landmark where ``z_C < z_D``. Here every landmark brings a sample of its own surface, since the depth behind the
centre alone misses thin and flat things; each point is seen, behind something nearer, or no longer there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse
from seo_slam.types import BoolArray

MARGIN_SHARE = 0.05
"""Share of the image at its border where a thing may be cut and a detector may well miss it."""

LEAST_INSIDE = 0.9
"""Share of a landmark's surface that must be in the image."""

TOLERANCE_M = 0.03
"""How far a surface may lie from where it was seen and still be that surface: shape, pose, calibration."""

TOLERANCE_SIGMAS = 3.0
"""Added to it: standard deviations of the sensor's noise at that depth."""

SLACK_M = 0.02
"""Sideways error granted: a point is only seen through where all pixels around it are."""

_VGA_PX = 640 * 480
_OFFSETS = np.array([[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class DepthView:
    """A depth image and where it was taken.

    Attributes:
        camera: of the image.
        depth_m: (H, W) metres along z, 0 = no return.
        T_world_camera: (4, 4).
        timestamp_s: when.
    """

    camera: Camera
    depth_m: NDArray[np.float32]
    T_world_camera: FloatArray
    timestamp_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What a view shows of N landmarks.

    Attributes:
        in_view: (N,) inside the image by a margin, in range, and with enough depth to tell.
        hidden: (N,) share of the surface behind something that is nearer than the whole thing; 0 for what is not in the image.
        through: (N,) share of what is not hidden where the camera sees farther than the surface: it is not there; 0 as well.
        area_px: (N,) pixels of its box, scaled to an image of 640x480.
    """

    in_view: BoolArray
    hidden: FloatArray
    through: FloatArray
    area_px: FloatArray


def look(surfaces_world: Sequence[FloatArray], view: DepthView, max_depth_m: float, depth_noise_at_1m_m: float) -> Sight:
    """Compare surfaces with a depth image.

    Args:
        surfaces_world: N arrays (M, 3), the same M for all: points of each landmark's surface.
        view: the image.
        max_depth_m: farther things are not in range.
        depth_noise_at_1m_m: the sensor's noise is this times depth squared.
    """
    n = len(surfaces_world)
    if n == 0:
        none = np.zeros(0)
        return Sight(np.zeros(0, dtype=np.bool_), none, none.copy(), none.copy())
    T_camera_world = inverse(view.T_world_camera)
    points = np.stack(surfaces_world)
    p_camera = points @ T_camera_world[:3, :3].T + T_camera_world[:3, 3]
    z = p_camera[..., 2]
    front = z.min(axis=1) > 0.1
    uv = view.camera.project(np.where(front[:, None, None], p_camera, [0.0, 0.0, 1.0]).reshape(-1, 3)).reshape(n, -1, 2)
    size = np.array([view.camera.width, view.camera.height])
    inside = np.asarray(((uv >= 0) & (uv <= size - 1)).all(axis=2), dtype=np.bool_)
    border = MARGIN_SHARE * size
    middle = np.median(uv, axis=1)
    central = ((middle >= border) & (middle <= size - 1 - border)).all(axis=1)
    may_be_seen = front & central & (inside.mean(axis=1) >= LEAST_INSIDE) & (z.max(axis=1) <= max_depth_m)
    low, high = np.zeros(z.shape), np.zeros(z.shape)
    low[may_be_seen], high[may_be_seen] = _depth_around(view, uv[may_be_seen], z[may_be_seen], inside[may_be_seen])
    known = inside & (high > 0)
    tolerance = TOLERANCE_M + TOLERANCE_SIGMAS * depth_noise_at_1m_m * z * z
    through = known & (low > z + tolerance)
    hidden = known & (high < z.min(axis=1)[:, None] - tolerance)
    total = np.maximum(known.sum(axis=1), 1)
    open_ = np.maximum(total - hidden.sum(axis=1), 1)
    extent = np.ptp(uv, axis=1).prod(axis=1)
    return Sight(
        in_view=np.asarray(may_be_seen & (known.mean(axis=1) >= 0.5), dtype=np.bool_),
        hidden=hidden.sum(axis=1) / total,
        through=through.sum(axis=1) / open_,
        area_px=np.asarray(extent * (_VGA_PX / float(size.prod())), dtype=np.float64),
    )


def _depth_around(view: DepthView, uv: FloatArray, z: FloatArray, inside: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Nearest and farthest depth (N, M) in a small cross around each pixel; infinity and 0 where none is known."""
    reach_px = np.maximum(SLACK_M * view.camera.fx / np.maximum(z, 0.1), 1.0)
    at = np.where(inside[..., None], uv, 0.0)[:, :, None, :] + reach_px[..., None, None] * _OFFSETS
    column = np.clip(np.round(at[..., 0]), 0, view.camera.width - 1).astype(np.int64)
    row = np.clip(np.round(at[..., 1]), 0, view.camera.height - 1).astype(np.int64)
    depth = view.depth_m[row, column].astype(np.float64)
    return np.where(depth > 0, depth, np.inf).min(axis=-1), depth.max(axis=-1)
