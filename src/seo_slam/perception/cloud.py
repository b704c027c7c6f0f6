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
        if not len(self.p_world):
            return np.full(3, np.nan), np.full(3, np.nan)
        return self.p_world.min(axis=0), self.p_world.max(axis=0)

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
