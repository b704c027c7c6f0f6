"""The free cells of a grid as a graph: shortest ways cell by cell, for where nothing better leads."""

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from seo_slam.geometry import FloatArray
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.types import BoolArray, IntArray

HALF_OF_EIGHT = ((0, 1), (1, 0), (1, 1), (1, -1))
"""Rows down and columns right to four neighbours of a cell; the other four are these turned round."""


def neighbour_pairs(cells: BoolArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return all pairs of neighbouring cells that are set, as two arrays (E,) of flat indices, and their distances (E,) in cells."""
    rows, columns = cells.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    ones, others, lengths = [], [], []
    for down, right in HALF_OF_EIGHT:
        here = slice(0, rows - down), slice(max(-right, 0), columns - max(right, 0))
        there = slice(down, rows), slice(max(right, 0), columns - max(-right, 0))
        both = cells[here] & cells[there]
        ones.append(index[here][both])
        others.append(index[there][both])
        lengths.append(np.full(int(both.sum()), np.hypot(down, right)))
    return np.concatenate(ones), np.concatenate(others), np.concatenate(lengths)


class CellGraph:
    """Dijkstra's algorithm over free cells. Two cells that meet at a corner are joined, as in ``NavigationGrid.parts``."""

    def __init__(self, grid: NavigationGrid) -> None:
        """Join the cells."""
        self._grid = grid
        ones, others, lengths = neighbour_pairs(grid.free)
        size = grid.free.size
        self._edges: Any = sparse.csr_matrix((lengths * grid.cell_m, (ones, others)), shape=(size, size))

    def way(self, start_xy: FloatArray, goal_xy: FloatArray) -> FloatArray:
        """Return a clear way (N, 2) between two points (2,) of one part of the free floor, over the middles of cells."""
        before = self._ways_from([self._index(start_xy)])
        cells = _chain(before, self._index(goal_xy))[::-1]
        return np.concatenate([start_xy[None], self._middles(cells), goal_xy[None]])

    def ways_to(self, targets: BoolArray) -> IntArray:
        """Return for each cell, by flat index, the next one on the way to the nearest cell of ``targets``; below 0: none, or it is one."""
        return self._ways_from(np.flatnonzero(targets).tolist())

    def follow(self, ways: IntArray, xy_world: FloatArray) -> tuple[FloatArray, int]:
        """Return the way (N, 2) from a point (2,) along ``ways_to``, and the flat index of the cell at its end."""
        cells = _chain(ways, self._index(xy_world))
        return np.concatenate([np.asarray(xy_world)[None], self._middles(cells)]), cells[-1]

    def _ways_from(self, cells: list[int]) -> IntArray:
        found: Any = csgraph.dijkstra(self._edges, directed=False, indices=cells, min_only=True, return_predecessors=True)
        return np.asarray(found[1], dtype=np.int64)

    def _index(self, xy_world: FloatArray) -> int:
        row, column = self._grid.layout.cells(xy_world)
        return int(row * self._grid.free.shape[1] + column)

    def _middles(self, cells: list[int]) -> FloatArray:
        return self._grid.layout.middles(np.stack(np.unravel_index(cells, self._grid.free.shape), axis=-1))


def _chain(following: IntArray, first: int) -> list[int]:
    """The cells from one on, each followed by what is written for it, to the end."""
    chain = [first]
    while (after := int(following[chain[-1]])) >= 0:
        chain.append(after)
    return chain
