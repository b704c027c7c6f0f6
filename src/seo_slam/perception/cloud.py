"""A cloud of points with what is asked of it again and again: its box, and a tree for nearest points."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from seo_slam.geometry import FloatArray


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of one landmark; the tree is built when first asked for, so keep the object as long as the points hold.

    Attributes:
        p_world: (M, 3) float64, metres.
    """

    p_world: FloatArray

    def __len__(self) -> int:
        return len(self.p_world)

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (3,) of its box; NaN if it is empty."""
        return bounds_of(self.p_world)

    @cached_property
    def inner_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (3,) of the box without the outermost hundredth of the points on each side; NaN if it is empty."""
        M = len(self.p_world)
        cut = M // 100
        if not cut:
            return self.bounds
        ordered = np.partition(self.p_world, (cut, M - 1 - cut), axis=0)
        return ordered[cut], ordered[M - 1 - cut]

    @cached_property
    def tree(self) -> cKDTree:
        """For nearest points."""
        return cKDTree(self.p_world)


MOST_STEPS = 60
"""A side of a box is cut into no more steps than that."""


def box_surface(size_m: FloatArray, step_m: float) -> FloatArray:
    """Points (N, 3) on a box around the origin, no farther apart than ``step_m`` unless that takes more than ``MOST_STEPS`` a side."""
    steps = np.clip(np.ceil(size_m / step_m), 1, MOST_STEPS).astype(np.int64)
    grid = np.stack(np.meshgrid(*(np.linspace(-0.5, 0.5, n + 1) for n in steps), indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(grid[np.abs(grid).max(axis=1) >= 0.5 - 1e-9] * size_m)


def bounds_of(p_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Low and high corner (3,) of the box of points (M, 3); NaN if there are none."""
    if not len(p_m):
        return np.full(3, np.nan), np.full(3, np.nan)
    columns = [p_m[:, axis] for axis in range(3)]  # numpy takes the minimum of a long column several times faster than of many rows
    return np.array([column.min() for column in columns]), np.array([column.max() for column in columns])
