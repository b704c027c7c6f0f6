"""Which points share a voxel: one sort for all points of all owners, always in the same order."""

import math

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray


def voxel_cells(p_m: FloatArray, voxel_m: float) -> IntArray:
    """Return (M, 3): the cell of each point (M, 3) in a grid of cubes of this side that has a corner at the origin."""
    return np.floor(np.asarray(p_m, dtype=np.float64) * (1.0 / voxel_m)).astype(np.int64)


def cell_order(cells: IntArray, owners: IntArray | None = None) -> tuple[IntArray, IntArray]:
    """Sort points by owner, then cell.

    Args:
        cells: (M, 3).
        owners: (M,) at least 0: points of different owners are never in one group. None: all have one owner.

    Returns:
        (M,) the rows of the points such that those of one group follow each other, in the order in which they were given, and (V,) where
        each group starts. Groups are ordered by owner, x, y and z.
    """
    M = len(cells)
    if not M:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    low = cells.min(axis=0)
    spans = [int(owners.max()) + 1 if owners is not None else 1, *(int(s) for s in cells.max(axis=0) - low + 1)]
    if math.prod(spans) * M >= 2**63:  # too wide for one number: metres of noise at a millimetre, say
        return _order_of_columns(cells, owners)
    x, y, z = (cells[:, axis] - low[axis] for axis in range(3))
    key = (x * spans[2] + y) * spans[3] + z
    if owners is not None:
        key += owners * math.prod(spans[1:])
    # The row is the last digit of the number: sorting it is several times faster than sorting the rows by it, and stable as well.
    key *= M
    key += np.arange(M)
    key.sort()
    group, order = np.divmod(key, M)
    return order, _starts(group[1:] != group[:-1])


def voxel_means(p_m: FloatArray, order: IntArray, starts: IntArray, weights: FloatArray | None = None) -> FloatArray:
    """Return (V, 3) the mean of the points (M, 3) of each group of ``cell_order``, weighted by (M,) if given."""
    if not len(starts):
        return np.zeros((0, 3))
    rows = p_m[order]
    if weights is None:
        counts = np.diff(starts, append=len(order)).astype(np.float64)
        return np.asarray(np.add.reduceat(rows, starts, axis=0) / counts[:, None], dtype=np.float64)
    share = weights[order].astype(np.float64)
    total = np.add.reduceat(share, starts)
    return np.asarray(np.add.reduceat(rows * share[:, None], starts, axis=0) / total[:, None], dtype=np.float64)


def _order_of_columns(cells: IntArray, owners: IntArray | None) -> tuple[IntArray, IntArray]:
    columns = cells if owners is None else np.column_stack([owners, cells])
    order = np.lexsort(columns.T[::-1])
    ordered = columns[order]
    return order.astype(np.int64), _starts((ordered[1:] != ordered[:-1]).any(axis=1))


def _starts(changes: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> IntArray:
    return np.concatenate([np.zeros(1, dtype=np.int64), np.flatnonzero(changes) + 1])
