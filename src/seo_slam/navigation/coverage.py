"""How much of each anchor's top was seen on the way: what need not be looked at again, and where something may still be."""

from collections.abc import Sequence

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.types import BoolArray, Frame, IntArray

_POINTS = 24  # of a top
_ABOVE_M = 0.03  # over the supporting plane
_BEHIND_M = 0.15  # depth that ends so far before a point does not hide it: noise, and things that lie there
_TOO_NEAR_M = 0.2


class Coverage:
    """Counts for a few points on each anchor's top the keyframes in which they were in view, near enough and not hidden."""

    def __init__(self, range_m: float, keyframes: int) -> None:
        """Take the distance up to which something small is recognised, and how many keyframes make a point seen."""
        self._range_m = range_m
        self._keyframes = keyframes
        self._points: dict[int, FloatArray] = {}
        self._counts: dict[int, IntArray] = {}

    def restart(self, anchors: Sequence[Anchor]) -> None:
        """Forget what was seen."""
        self._points = {anchor.id: _top(anchor) for anchor in anchors}
        self._counts = {id: np.zeros(len(points), dtype=np.int64) for id, points in self._points.items()}

    def follow(self, anchors: Sequence[Anchor]) -> None:
        """Take a map that was updated on the way: what is new in it has been seen, else it were not there."""
        for anchor in anchors:
            if anchor.id not in self._points:
                self._points[anchor.id] = _top(anchor)
                self._counts[anchor.id] = np.full(len(self._points[anchor.id]), self._keyframes)

    def add(self, frame: Frame, T_world_camera: FloatArray) -> None:
        """Count a keyframe taken from a pose (4, 4)."""
        if not self._points:
            return
        seen = _in_view(np.concatenate(list(self._points.values())), frame, T_world_camera, self._range_m)
        first = 0
        for counts in self._counts.values():
            counts += seen[first : first + len(counts)]
            first += len(counts)

    def seen_share(self, anchor_id: int) -> float:
        """Return the share of an anchor's top that was seen; 0 for one that is not known."""
        counts = self._counts.get(anchor_id)
        return 0.0 if counts is None else float((counts >= self._keyframes).mean())


def _top(anchor: Anchor) -> FloatArray:
    """(M, 3) points over the footprint, at the height at which things stand on it."""
    rows = np.unique(np.linspace(0, len(anchor.footprint_world) - 1, _POINTS).round().astype(np.int64))
    xy = anchor.footprint_world[rows]
    return np.column_stack([xy, np.full(len(xy), anchor.support_z_m + _ABOVE_M)])


def _in_view(p_world: FloatArray, frame: Frame, T_world_camera: FloatArray, range_m: float) -> BoolArray:
    """(N,) which points (N, 3) a frame shows."""
    p_camera = transform_points(inverse(T_world_camera), p_world)
    seen = (p_camera[:, 2] > _TOO_NEAR_M) & (np.linalg.norm(p_camera, axis=1) < range_m)
    uv = np.full((len(p_world), 2), -1.0)
    uv[seen] = frame.camera.project(p_camera[seen])
    columns, rows = np.round(uv).astype(np.int64).T
    seen &= (columns >= 0) & (columns < frame.camera.width) & (rows >= 0) & (rows < frame.camera.height)
    depth_m = frame.depth_m[rows[seen], columns[seen]]
    seen[seen] = (depth_m > 0) & (depth_m > p_camera[seen, 2] - _BEHIND_M)
    return np.asarray(seen)
