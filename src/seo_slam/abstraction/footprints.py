"""Clouds seen from above: footprints as points, and the area they cover."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from scipy.ndimage import binary_closing, binary_fill_holes
from scipy.spatial import ConvexHull, QhullError, cKDTree

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

_CLOSED_M = 0.15
"""Gaps so wide are closed: what stands on a table hides the table behind it."""
_DENSE_SHARE = 0.25
_CONVEX_SHARE = 0.6
"""A footprint that fills this share of its convex hull is taken for the hull: most furniture is convex, its far side often unseen."""


def footprint(p_world: FloatArray, voxel_m: float) -> FloatArray:
    """Return (M, 2) points (N, 2 or 3), world frame, seen from above: one, the mean, a square of a grid. Sorted by square."""
    xy = np.asarray(p_world, dtype=np.float64)[:, :2]
    if not len(xy):
        return np.zeros((0, 2))
    which = squares(xy, voxel_m)
    counts = np.bincount(which)
    return np.stack([np.bincount(which, xy[:, axis]) / counts for axis in range(2)], axis=-1)


def squares(p_world: FloatArray, voxel_m: float) -> IntArray:
    """Return (N,) the number of the square of a grid over which each point (N, 2 or 3) lies; those that hold a point are counted from 0."""
    index = np.floor(np.asarray(p_world)[:, :2] / voxel_m).astype(np.int64)
    index -= index.min(axis=0)
    # One number a square: pairs would be sorted ten times slower.
    return np.asarray(np.unique(index[:, 0] * (int(index[:, 1].max()) + 1) + index[:, 1], return_inverse=True)[1].reshape(-1))


def without_stray(p_world: FloatArray, voxel_m: float) -> FloatArray:
    """Return the points (N, 3) of a cloud without those that seem to trail off its edges, in the order given.

    Masks reach over edges, and depth between near and far is neither: single points in a line away from the thing. Seen from above, a
    square of the grid counts if it holds a quarter of what half of them hold.
    """
    if not len(p_world):
        return p_world
    which = squares(p_world, voxel_m)
    counts = np.bincount(which)
    return np.asarray(p_world[counts[which] >= _DENSE_SHARE * np.median(counts)])


@dataclass(frozen=True, eq=False)
class Region:
    """The area that a footprint covers, holes closed, as cells: rows along y, columns along x.

    Attributes:
        corner_world: (2,) low corner.
        cell_m: side of a cell.
        mask: (R, C) the cells it covers.
    """

    corner_world: FloatArray
    cell_m: float
    mask: BoolArray

    @classmethod
    def of(cls, xy_world: FloatArray, cell_m: float) -> Self:
        """Return the area of points (N, 2), world frame: gaps closed, holes filled, and the convex hull where they fill most of it."""
        if not len(xy_world):
            return cls(np.zeros(2), cell_m, np.zeros((0, 0), dtype=np.bool_))
        reach = int(np.ceil(_CLOSED_M / cell_m))
        first = np.floor(xy_world.min(axis=0) / cell_m).astype(np.int64) - reach
        index = np.floor(xy_world / cell_m).astype(np.int64) - first
        columns, rows = index.max(axis=0) + 1 + reach
        mask = np.zeros((rows, columns), dtype=np.bool_)
        mask[index[:, 1], index[:, 0]] = True
        mask = binary_fill_holes(binary_closing(mask, _disc(reach)))
        region = cls(first * cell_m, cell_m, mask)
        hull = region._hull(xy_world)
        return cls(region.corner_world, cell_m, mask | hull) if mask.sum() >= _CONVEX_SHARE * hull.sum() else region

    def contains(self, xy_world: FloatArray) -> BoolArray:
        """Return (N,) whether points (N, 2), world frame, lie in it."""
        index = np.floor((xy_world - self.corner_world) / self.cell_m).astype(np.int64)
        rows, columns = self.mask.shape
        inside = (index >= 0).all(axis=-1) & (index[:, 1] < rows) & (index[:, 0] < columns)
        out = np.zeros(len(xy_world), dtype=np.bool_)
        out[inside] = self.mask[index[inside, 1], index[inside, 0]]
        return out

    @property
    def area_m2(self) -> float:
        """Its area."""
        return float(self.mask.sum()) * self.cell_m**2

    @cached_property
    def bounds_world(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (2,) of the cells it covers, world frame; infinity and minus infinity if it has none."""
        if not self.mask.any():
            return np.full(2, np.inf), np.full(2, -np.inf)
        cells = np.argwhere(self.mask)[:, ::-1]
        return self.corner_world + self.cell_m * cells.min(axis=0), self.corner_world + self.cell_m * (cells.max(axis=0) + 1)

    @cached_property
    def middles_world(self) -> FloatArray:
        """(N, 2) middles of its cells, world frame."""
        return np.asarray(self.corner_world + self.cell_m * (np.argwhere(self.mask)[:, ::-1] + 0.5))

    def share_in(self, other: "Region") -> float:
        """Return the share of its cells that lie in another region; 0 if it has none."""
        return float(other.contains(self.middles_world).mean()) if len(self.middles_world) else 0.0

    def gap_m(self, xy_world: FloatArray) -> float:
        """Return the least distance to points (N, 2), world frame; 0 if one lies in it, infinity if either is empty."""
        if not len(xy_world) or not len(self.middles_world):
            return float("inf")
        if self.contains(xy_world).any():
            return 0.0
        nearest, _ = self._tree.query(xy_world)
        return max(0.0, float(np.min(nearest)) - 0.5 * self.cell_m)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.middles_world)

    def _hull(self, xy_world: FloatArray) -> BoolArray:
        """Cells whose middle lies in the convex hull of points; none if these lie on a line."""
        try:
            hull = ConvexHull(xy_world)
        except (QhullError, ValueError):  # on a line, or fewer than three
            return np.zeros_like(self.mask)
        rows, columns = np.indices(self.mask.shape)
        middles = self.corner_world + self.cell_m * (np.stack([columns.ravel(), rows.ravel()], axis=-1) + 0.5)
        inside = (middles @ hull.equations[:, :2].T + hull.equations[:, 2] <= 1e-9).all(axis=1)
        return np.asarray(inside.reshape(self.mask.shape))


def box_share(a_world: FloatArray, b_world: FloatArray, voxel_m: float) -> float:
    """Return the share of the box of points (N, 2) that lies in the box of others (M, 2), world frame; N and M are at least 1.

    A side counts as at least ``voxel_m`` long, so that a footprint of one row of points has an area too.
    """
    (a_low, a_high), (b_low, b_high) = _box(a_world, voxel_m), _box(b_world, voxel_m)
    shared = np.maximum(np.minimum(a_high, b_high) - np.maximum(a_low, b_low), 0.0)
    return float(np.prod(shared) / np.prod(a_high - a_low))


def _box(xy_world: FloatArray, least_m: float) -> tuple[FloatArray, FloatArray]:
    low, high = xy_world.min(axis=0), xy_world.max(axis=0)
    wider_m = np.maximum(least_m - (high - low), 0.0) / 2.0
    return low - wider_m, high + wider_m


def _disc(radius: int) -> BoolArray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(x * x + y * y <= radius * radius)
