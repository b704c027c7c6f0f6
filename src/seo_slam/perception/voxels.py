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
    low, spans = zip(*(_range(cells[:, axis]) for axis in range(3)), strict=True)
    bits = M.bit_length()
    if math.prod(spans) * (int(owners.max()) + 1 if owners is not None else 1) >= 2 ** (63 - bits):  # metres in cells of a micrometre
        return _order_of_columns(cells, owners)
    x, y, z = (cells[:, axis] - low[axis] for axis in range(3))
    key = (x * spans[1] + y) * spans[2] + z
    if owners is not None:
        key += owners * math.prod(spans)
    # The row is the last digits of the number: sorting it is several times faster than sorting rows by it, and stable as well.
    key <<= bits
    key |= np.arange(M)
    key.sort()
    order = key & ((1 << bits) - 1)
    key >>= bits
    return order, _starts(key[1:] != key[:-1])


def voxel_means(p_m: FloatArray, order: IntArray, starts: IntArray, weights: FloatArray | None = None) -> FloatArray:
    """Return (V, 3) the mean of the points (M, 3) of each group of ``cell_order``, weighted by (M,) if given."""
    rows = np.take(p_m, order, axis=0)
    sizes = np.diff(starts, append=len(order))
    out, share = np.empty((len(starts), 3)), None if weights is None else np.take(weights, order)
    total = sizes.astype(np.float64) if share is None else sums_of_groups(share, starts)
    for axis in range(3):  # a column at a time: numpy adds up long rows fast, and many short ones slowly
        column = np.ascontiguousarray(rows[:, axis]) if share is None else rows[:, axis] * share
        out[:, axis] = sums_of_groups(column, starts) / total
    return out


def sums_of_groups(ordered: FloatArray, starts: IntArray) -> FloatArray:
    """Return (V,) the sum of each group of values (M,) that are in the order of ``cell_order``."""
    return np.add.reduceat(ordered, starts) if len(starts) else np.zeros(0)


def _range(column: IntArray) -> tuple[int, int]:
    """Least value, and how many values there may be from it to the largest."""
    least = int(column.min())
    return least, int(column.max()) - least + 1


def _order_of_columns(cells: IntArray, owners: IntArray | None) -> tuple[IntArray, IntArray]:
    columns = cells if owners is None else np.column_stack([owners, cells])
    order = np.lexsort(columns.T[::-1])
    ordered = columns[order]
    return order.astype(np.int64), _starts((ordered[1:] != ordered[:-1]).any(axis=1))


def _starts(changes: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> IntArray:
    return np.concatenate([np.zeros(1, dtype=np.int64), np.flatnonzero(changes) + 1])
