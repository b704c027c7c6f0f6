"""Points averaged in cubes, and which cubes are well known."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

_BITS = 21  # of the number of a cube along an axis: 2 million cubes of 5 cm are 100 km
_MIDDLE = 1 << (_BITS - 1)


@dataclass(frozen=True, slots=True, eq=False)
class Voxels:
    """One point for each cube in which something is.

    Attributes:
        p_world: (N, 3) the mean of its points, in the frame they came in.
        counts: (N,) how many they are.
    """

    p_world: FloatArray
    counts: IntArray

    @classmethod
    def of(cls, p_world: FloatArray, side_m: float, counts: IntArray | None = None) -> Self:
        """Average points (M, 3) in cubes, in order of place.

        Args:
            p_world: the points.
            side_m: of a cube.
            counts: (M,) how many each of them stands for; None: one.
        """
        _, inverse = np.unique(voxel_keys(p_world, side_m), return_inverse=True)
        weights = np.ones(len(p_world)) if counts is None else counts.astype(np.float64)
        total = np.bincount(inverse, weights)
        sums = np.stack([np.bincount(inverse, weights * p_world[:, axis]) for axis in range(3)], axis=1)
        return cls(sums / total[:, None], total.astype(np.int64))


class KnownVoxels:
    """How often points fell into each cube, in memory that grows with the cubes only."""

    def __init__(self, side_m: float, enough: int) -> None:
        """Know nothing; a cube is known from so many points on."""
        self._side_m = side_m
        self._enough = enough
        self._keys: IntArray = np.zeros(0, dtype=np.int64)
        self._counts: IntArray = np.zeros(0, dtype=np.int64)

    def __len__(self) -> int:
        return len(self._keys)

    def share_of_new(self, p_world: FloatArray) -> float:
        """Return which share of points (N, 3), N > 0, is in cubes that are not known yet."""
        if not len(self._keys):
            return 1.0
        keys = voxel_keys(p_world, self._side_m)
        at = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
        known = (self._keys[at] == keys) & (self._counts[at] >= self._enough)
        return float(1.0 - known.mean())

    def add(self, p_world: FloatArray) -> None:
        """Count points (N, 3)."""
        keys, counts = np.unique(voxel_keys(p_world, self._side_m), return_counts=True)
        self._keys, inverse = np.unique(np.concatenate([self._keys, keys]), return_inverse=True)
        added = np.bincount(inverse, np.concatenate([self._counts, counts]), len(self._keys))
        self._counts = np.minimum(added.astype(np.int64), self._enough)


def voxel_keys(p_world: FloatArray, side_m: float) -> IntArray:
    """Return (N,) one number for the cube of each point (N, 3)."""
    index = np.floor(p_world / side_m).astype(np.int64) + _MIDDLE
    return np.asarray((index[:, 0] << 2 * _BITS) | (index[:, 1] << _BITS) | index[:, 2])
