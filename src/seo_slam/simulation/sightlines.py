"""A quick guess at how well a thing is seen along a path: all things are boxes. What it says is checked with drawn images later."""

from collections.abc import Sequence

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.world import Thing

_MARGIN = 0.04  # share of the image, at each edge, that does not count
_POINTS = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [-0.6, 0.0, 0.0], [0.0, 0.0, 0.6], [0.0, 0.0, -0.6]])  # of half a box
_CLEAR_POINTS = 3


class Sightlines:
    """Lines from sampled poses of a path to the places of things."""

    def __init__(self, halves: Sequence[FloatArray]) -> None:
        """Take the poses (N, 4, 4), ``T_world_camera``, of each part of a path."""
        camera = simulated_camera()
        self._halves = [np.asarray(poses) for poses in halves]
        self._eyes = np.concatenate([poses[:, :2, 3] for poses in self._halves])
        self._slope = np.array([camera.width / 2.0 / camera.fx, camera.height / 2.0 / camera.fy]) * (1.0 - 2.0 * _MARGIN)

    def share(self, thing: Thing, others: Sequence[Thing]) -> float:
        """Return the share of poses, in the worse half, that see most of a thing."""
        low, high = thing.bounds_world
        points = (low + high) / 2.0 + _POINTS * (high - low) / 2.0
        boxes = np.array([other.bounds_world for other in others]).reshape(-1, 2, 3)
        return min(float((self._seen(poses, points, boxes) >= _CLEAR_POINTS).mean()) for poses in self._halves)

    def clearance_m(self, low: FloatArray, high: FloatArray) -> float:
        """Return how near the poses come to a box with corners (3,), in the plane."""
        return float(np.linalg.norm(np.maximum(np.maximum(low[:2] - self._eyes, self._eyes - high[:2]), 0.0), axis=1).min())

    def _seen(self, poses: FloatArray, points: FloatArray, boxes: FloatArray) -> FloatArray:
        """How many of the points (P, 3) each pose (N, 4, 4) sees past boxes (M, 2, 3)."""
        eyes = poses[:, :3, 3]
        lines = points[None, :, :] - eyes[:, None, :]  # (N, P, 3)
        p_camera = np.einsum("npi,nij->npj", lines, poses[:, :3, :3])
        in_view = (np.abs(p_camera[..., :2]) <= self._slope * p_camera[..., 2:]).all(axis=-1)
        if len(boxes):
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = 1.0 / lines[:, :, None, :]
                a = (boxes[None, None, :, 0] - eyes[:, None, None, :]) * inverse
                b = (boxes[None, None, :, 1] - eyes[:, None, None, :]) * inverse
            enter, leave = np.fmin(a, b).max(axis=-1), np.fmax(a, b).min(axis=-1)
            in_view &= ~((enter < leave) & (leave > 0.0) & (enter < 1.0)).any(axis=-1)
        return np.asarray(in_view.sum(axis=1))
