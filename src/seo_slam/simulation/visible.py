"""What a detector can know of a frame: how well, and from which side, a thing is seen."""

from dataclasses import dataclass

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.world import Thing, World


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """All that the simulated detector knows about a frame.

    Attributes:
        index: number of the frame, key of its draws.
        world, camera: what there is, and with what it is seen.
        T_world_camera: (4, 4) true pose.
        rendered: instance image and depth of the perfect camera.
    """

    index: int
    world: World
    camera: Camera
    T_world_camera: FloatArray
    rendered: Rendered


def visibility(thing: Thing, view: View, visible_px: int, smallest_px: float) -> float:
    """Return how easily a thing is seen, in 0..1: from its visible area, the share that is not hidden, and the share inside the image."""
    area = 1.0 - float(np.exp(-visible_px / (4.0 * max(smallest_px, 1.0))))
    free = visible_px / max(view.rendered.covered_px.get(thing.id, visible_px), visible_px)
    uv = view.camera.project(transform_points(inverse(view.T_world_camera), thing.corners_world()))
    if not np.isfinite(uv).all():
        return area * _ramp(free, 0.1, 0.5)
    low, high = uv.min(axis=0), uv.max(axis=0)
    inside = np.clip(np.minimum(high, [view.camera.width, view.camera.height]) - np.maximum(low, 0.0), 0.0, None)
    return area * _ramp(free, 0.1, 0.5) * _ramp(float(np.prod(inside) / np.prod(high - low)), 0.1, 0.6)


def octant(thing: Thing, view: View) -> int:
    """Return which of a thing's eight sides (45 degrees each, around its own vertical) the camera is on; it turns with the thing."""
    return octant_of(thing.T_world_thing[:3, :3].T @ (view.T_world_camera[:3, 3] - thing.p_world))


def octant_of(offset: FloatArray) -> int:
    """Return which of eight directions around z (45 degrees each) an offset (3,) points in."""
    return int(np.floor(np.arctan2(offset[1], offset[0]) / (np.pi / 4.0))) % 8


def _ramp(value: float, low: float, high: float) -> float:
    s = min(max((value - low) / (high - low), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)
