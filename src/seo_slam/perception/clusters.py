"""The largest cluster of each of many sets of points, by density (DBSCAN), in a few numpy operations for all of them.

Points are gathered in cells so small that all of two cells that share a face are neighbours. Each cell then counts as one point, their
mean, with the weight of all. Most cells are settled without a distance: with enough weight in the cells around it, a cell is inside a
cluster, and cells side by side are of one cluster. Trees are built only for those that are left open.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from seo_slam.geometry import FloatArray
from seo_slam.perception.voxels import cell_order, voxel_cells, voxel_means
from seo_slam.types import BoolArray, IntArray

_NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Points gathered in cells, by rising owner.

    Attributes:
        cell_of: (M,) the cell of each point.
        means: (C, 3) metres: the weighted mean of each cell's points.
        owners: (C,) whose they are, rising.
        weights: (C,) of all its points.
        touching: (P,) and (P,) cells of one owner that share a face.
    """

    cell_of: IntArray
    means: FloatArray
    owners: IntArray
    weights: FloatArray
    touching: tuple[IntArray, IntArray]


def in_largest_cluster(p_m: FloatArray, owners: IntArray, weights: FloatArray, neighbour_m: float, least_weight: float) -> BoolArray:
    """Return (M,) bool: the point belongs to the cluster of its owner that weighs most.

    DBSCAN on the means of ``gathered`` cells, sides of two fifths of ``neighbour_m``. A cell is inside a cluster if the cells within
    ``neighbour_m`` of it, itself included, weigh at least ``least_weight``; inner cells within ``neighbour_m`` of each other are of one
    cluster, and so is any other cell with the inner cell nearest to it, if that is as near. What is left is noise. Of clusters of one
    weight the one with the lowest x is kept, of its first cell, then y, then z.

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
    a, b = cells.touching
    C = len(cells.weights)
    around = cells.weights + np.bincount(a, cells.weights[b], minlength=C) + np.bincount(b, cells.weights[a], minlength=C)
    inner = around >= least_weight
    trees = _Trees(cells, neighbour_m)
    for owner, rows in _by_owner(np.flatnonzero(~inner), cells.owners):
        inner[rows] = trees.weight_around(owner, rows) >= least_weight
    cluster = np.where(inner, _clusters_of_inner(cells, inner, trees), _NONE)
    for owner, rows in _by_owner(np.flatnonzero(~inner), cells.owners):
        cluster[rows] = trees.cluster_of_nearest(owner, rows, cluster)
    return _is_in_heaviest(cluster, cells)[cells.cell_of]


def gathered(p_m: FloatArray, owners: IntArray, weights: FloatArray, neighbour_m: float) -> Cells:
    """Gather points in cells such that any two points in cells that share a face are within ``neighbour_m``; else as above."""
    side_m = neighbour_m / math.sqrt(6.0) * (1.0 - 1e-9)
    at = voxel_cells(p_m, side_m)
    order, starts = cell_order(at, owners)
    cell_of = np.empty(len(p_m), dtype=np.int64)
    cell_of[order] = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    first = order[starts]
    means = voxel_means(p_m, order, starts, weights)
    return Cells(cell_of, means, owners[first], np.add.reduceat(weights[order], starts), _touching(at[first], owners[first]))


def _touching(at: IntArray, owner: IntArray) -> tuple[IntArray, IntArray]:
    low = at.min(axis=0)
    spans = at.max(axis=0) - low + 2  # one free cell beyond each row, so that a step never leads into the next row
    strides = np.array([spans[1] * spans[2], spans[2], 1])
    key = (at - low) @ strides + owner * (spans[0] * strides[0])  # rises, as the cells are in that order
    a, b = [], []
    for stride in strides:
        other = np.searchsorted(key, key + stride)
        found = np.flatnonzero(key[np.minimum(other, len(key) - 1)] == key + stride)
        a.append(found)
        b.append(other[found])
    return np.concatenate(a), np.concatenate(b)


def _clusters_of_inner(cells: Cells, inner: BoolArray, trees: "_Trees") -> IntArray:
    """(C,) the cluster of each inner cell; meaningless for others."""
    a, b = cells.touching
    both = inner[a] & inner[b]
    part = _components(len(inner), a[both], b[both])  # within a part everything is connected; parts may be as well
    links_a, links_b = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for _, rows in _by_owner(np.flatnonzero(inner), cells.owners):
        if (part[rows] != part[rows[0]]).any():
            links = trees.links(rows, part)
            links_a.append(links[0])
            links_b.append(links[1])
    return _components(len(inner), np.concatenate(links_a), np.concatenate(links_b))[part]


def _components(count: int, a: IntArray, b: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


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


def _by_owner(rows: IntArray, owners: IntArray) -> list[tuple[int, IntArray]]:
    """Rows, rising, parted by owner."""
    if not len(rows):
        return []
    owner = owners[rows]
    cuts = np.flatnonzero(owner[1:] != owner[:-1]) + 1
    return [(int(owners[part[0]]), part) for part in np.split(rows, cuts)]


class _Trees:
    """Distances among the cells of one owner, for what touching cells leave open."""

    def __init__(self, cells: Cells, neighbour_m: float) -> None:
        self._cells, self._neighbour_m = cells, neighbour_m
        self._reach_m = float(np.nextafter(neighbour_m, np.inf))  # scipy's bound is exclusive
        self._starts = np.searchsorted(cells.owners, np.arange(int(cells.owners[-1]) + 2))

    def weight_around(self, owner: int, rows: IntArray) -> FloatArray:
        """(R,) the weight of the owner's cells within reach of each of its rows, itself included."""
        near, offset = self._tree(np.arange(self._starts[owner], self._starts[owner + 1])), self._starts[owner]
        pairs = self._tree(rows).sparse_distance_matrix(near, self._neighbour_m, output_type="ndarray")
        return np.bincount(pairs["i"], self._cells.weights[offset + pairs["j"]], minlength=len(rows)).astype(np.float64)

    def links(self, rows: IntArray, part: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs (P,), (P,) of parts within reach of each other, enough to connect what is connected; rows: one owner's inner cells."""
        names, sizes = np.unique(part[rows], return_counts=True)
        biggest = names[np.argmax(sizes)]
        is_small = part[rows] != biggest
        small, big = rows[is_small], rows[~is_small]
        distance_m, _ = self._tree(big).query(self._cells.means[small], distance_upper_bound=self._reach_m)
        joined = np.unique(part[small[np.isfinite(distance_m)]])
        apart = small[~np.isin(part[small], joined)]  # only these need a link to another small part
        pairs = self._tree(apart).sparse_distance_matrix(self._tree(small), self._neighbour_m, output_type="ndarray")
        a, b = part[apart[pairs["i"]]], part[small[pairs["j"]]]
        other = a != b
        return np.concatenate([joined, a[other]]), np.concatenate([np.full(len(joined), biggest), b[other]])

    def cluster_of_nearest(self, owner: int, rows: IntArray, cluster: IntArray) -> IntArray:
        """(R,) the cluster (C,) of the clustered cell of the owner nearest to each row, if within reach."""
        clustered = self._starts[owner] + np.flatnonzero(cluster[self._starts[owner] : self._starts[owner + 1]] != _NONE)
        if not len(clustered):
            return np.full(len(rows), _NONE, dtype=np.int64)
        _, nearest = self._tree(clustered).query(self._cells.means[rows], distance_upper_bound=self._reach_m)
        return np.concatenate([cluster[clustered], [_NONE]])[nearest]

    def _tree(self, rows: IntArray) -> cKDTree:
        return cKDTree(self._cells.means[rows], balanced_tree=False, compact_nodes=False)  # built for one question: faster to build
