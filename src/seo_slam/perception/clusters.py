"""The largest cluster of each of many sets of points, by density (DBSCAN), in a few numpy operations for all of them.

Points are gathered in cells of half the neighbours' distance; each cell then counts as one point, their mean, with the weight of all. Of
these few, all pairs of neighbours are found in a sorted list: those of a cell lie in the cells at most two steps away.
"""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from seo_slam.geometry import FloatArray
from seo_slam.perception.voxels import cell_order, sums_of_groups, voxel_cells, voxel_means
from seo_slam.types import BoolArray, IntArray

_NONE = -1

_STEPS = 2
"""Cells that a neighbour may be away, along each axis."""

_ROWS_AHEAD = [(x, y) for x in range(_STEPS + 1) for y in range(-_STEPS, _STEPS + 1) if (x, y) > (0, 0)]
"""Steps in x and y to half of all rows of cells around one: of each pair of cells one sees the other ahead."""


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Points gathered in cells, by rising owner.

    Attributes:
        cell_of: (M,) the cell of each point.
        means: (C, 3) metres: the weighted mean of each cell's points.
        owners: (C,) whose they are, rising.
        weights: (C,) of all its points.
        neighbours: (P,) and (P,): pairs of cells of one owner, once each, whose means are near enough.
        distances_m: (P,) how near.
    """

    cell_of: IntArray
    means: FloatArray
    owners: IntArray
    weights: FloatArray
    neighbours: tuple[IntArray, IntArray]
    distances_m: FloatArray


def in_largest_cluster(p_m: FloatArray, owners: IntArray, weights: FloatArray, neighbour_m: float, least_weight: float) -> BoolArray:
    """Return (M,) bool: the point belongs to the cluster of its owner that weighs most.

    DBSCAN on the means of ``gathered`` cells. A cell is inside a cluster if the cells within ``neighbour_m`` of it, itself included,
    weigh at least ``least_weight``; inner cells within ``neighbour_m`` of each other are of one cluster, and so is any other cell with the
    inner cell nearest to it, if that is as near. What is left is noise. Of clusters of one weight the one with the first cell is kept, by
    x, then y, then z.

    Args:
        p_m: (M, 3), metres, any frame.
        owners: (M,) at least 0: clusters never hold points of two owners.
        weights: (M,) above 0: as how many points each counts.
        neighbour_m: DBSCAN's eps.
        least_weight: DBSCAN's number of points.
    """
    if not len(p_m):
        return np.zeros(0, dtype=np.bool_)
    cells = gathered(p_m, owners, weights, neighbour_m)
    a, b = cells.neighbours
    C = len(cells.weights)
    around = cells.weights + np.bincount(a, cells.weights[b], minlength=C) + np.bincount(b, cells.weights[a], minlength=C)
    inner = around >= least_weight
    both = inner[a] & inner[b]
    graph = coo_array((np.ones(int(both.sum()), dtype=np.int8), (a[both], b[both])), shape=(C, C))
    cluster = np.where(inner, connected_components(graph, directed=False)[1], _NONE).astype(np.int64)
    outer, nearest = _nearest_inner(cells, inner)
    cluster[outer] = cluster[nearest]
    return _is_in_heaviest(cluster, cells)[cells.cell_of]


def gathered(p_m: FloatArray, owners: IntArray, weights: FloatArray, neighbour_m: float) -> Cells:
    """Gather points in cells with sides of half of ``neighbour_m``, and find the neighbours among those; arguments as above."""
    at = voxel_cells(p_m, neighbour_m / _STEPS)
    order, starts = cell_order(at, owners)
    cell_of = np.empty(len(p_m), dtype=np.int64)
    cell_of[order] = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    first = order[starts]
    means = voxel_means(p_m, order, starts, weights)
    a, b = _pairs_nearby(at[first], owners[first])
    offset = np.take(means, a, axis=0) - np.take(means, b, axis=0)
    distances_m = np.sqrt(np.einsum("ni,ni->n", offset, offset))
    near = distances_m <= neighbour_m
    return Cells(cell_of, means, owners[first], sums_of_groups(weights[order], starts), (a[near], b[near]), distances_m[near])


def _pairs_nearby(at: IntArray, owner: IntArray) -> tuple[IntArray, IntArray]:
    """All pairs of cells (C, 3) of one owner (C,) that are at most ``_STEPS`` apart along each axis; cells are given in order."""
    C = len(at)
    low, spans = at.min(axis=0), at.max(axis=0) - at.min(axis=0) + 1 + _STEPS  # free cells beyond each row: no step leads into the next
    strides = np.array([spans[1] * spans[2], spans[2], 1])
    key = (at - low) @ strides + owner * ((spans[0] + _STEPS) * strides[0])  # rises
    padded = np.concatenate([key, np.full(2 * _STEPS + 1, np.iinfo(np.int64).max)])
    rows = np.arange(C)
    found = []
    for x, y in [(0, 0), *_ROWS_AHEAD]:
        middle = key + x * strides[0] + y * strides[1]
        start = rows + 1 if (x, y) == (0, 0) else np.searchsorted(key, middle - _STEPS)
        last = middle + _STEPS
        for k in range(_STEPS if (x, y) == (0, 0) else 2 * _STEPS + 1):
            hit = np.flatnonzero(padded[start + k] <= last)
            if not len(hit):
                break
            found.append((hit, start[hit] + k))
    if not found:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])


def _nearest_inner(cells: Cells, inner: BoolArray) -> tuple[IntArray, IntArray]:
    """(R,) cells that are not inner but have an inner neighbour, and (R,) the nearest one of each."""
    a, b = np.concatenate(cells.neighbours), np.concatenate(cells.neighbours[::-1])
    pairs = np.flatnonzero(~inner[a] & inner[b])
    pairs = pairs[np.lexsort((b[pairs], np.tile(cells.distances_m, 2)[pairs], a[pairs]))]
    outer, first = np.unique(a[pairs], return_index=True)
    return outer, b[pairs[first]]


def _is_in_heaviest(cluster: IntArray, cells: Cells) -> BoolArray:
    """(C,) bool: the cell is in the heaviest cluster of its owner."""
    member = np.flatnonzero(cluster != _NONE)
    if not len(member):
        return np.zeros(len(cluster), dtype=np.bool_)
    names, first, number = np.unique(cluster[member], return_index=True, return_inverse=True)
    total = np.bincount(number, cells.weights[member])
    owner = cells.owners[member[first]]
    ranked = np.lexsort((first, -total, owner))
    best = ranked[np.concatenate([[True], owner[ranked][1:] != owner[ranked][:-1]])]
    kept = np.zeros(len(names), dtype=np.bool_)
    kept[best] = True
    out = np.zeros(len(cluster), dtype=np.bool_)
    out[member] = kept[number]
    return out
