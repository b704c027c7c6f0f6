"""The shortest way over a free floor, to hold a robot's way against."""

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from seo_slam.geometry import FloatArray
from seo_slam.simulation.free_space import ROBOT_RADIUS_M, FreeSpace
from seo_slam.types import BoolArray, IntArray

# Straight, diagonal and knight's moves: with sixteen directions a way comes out at most 2.7 % longer than it is. Each with the cells
# that must be free besides its ends.
_MOVES: tuple[tuple[int, int, tuple[tuple[int, int], ...]], ...] = (
    (0, 1, ()),
    (1, 0, ()),
    (1, 1, ((0, 1), (1, 0))),
    (1, -1, ((0, -1), (1, 0))),
    (1, 2, ((0, 1), (1, 1))),
    (1, -2, ((0, -1), (1, -1))),
    (2, 1, ((1, 0), (1, 1))),
    (2, -1, ((1, 0), (1, -1))),
)


class ShortestWays:
    """Lengths of shortest ways of a robot over one floor."""

    def __init__(self, free: FreeSpace, radius_m: float = ROBOT_RADIUS_M) -> None:
        """Join the cells in which the middle of a robot of that radius may be."""
        self._free = free
        self._standing = free.standing(radius_m)
        self._number = np.full(self._standing.shape, -1, dtype=np.int64)
        self._number[self._standing] = np.arange(int(self._standing.sum()))
        ends: list[IntArray] = []
        lengths: list[FloatArray] = []
        for down, right, between in _MOVES:
            fits = self._standing & _beside(self._standing, down, right)
            for row, column in between:
                fits &= _beside(self._standing, row, column)
            cells = np.argwhere(fits)
            ends.append(np.stack([self._number[fits], self._number[cells[:, 0] + down, cells[:, 1] + right]]))
            lengths.append(np.full(len(cells), np.hypot(down, right) * free.cell_m))
        rows, columns = np.concatenate(ends, axis=1)
        count = int(self._standing.sum())
        self._graph = sparse.csr_matrix((np.concatenate(lengths), (rows, columns)), shape=(count, count))

    def lengths_m(self, start_xy: FloatArray) -> FloatArray:
        """Return (rows, columns) how long the way is from a point (2,) to each cell; infinity where none leads.

        The start counts as the nearest cell in which a robot can stand.
        """
        out = np.full(self._standing.shape, np.inf)
        cells = np.argwhere(self._standing)
        if len(cells):
            nearest = int(np.argmin(np.linalg.norm(self._free.middles(cells) - np.asarray(start_xy)[:2], axis=1)))
            out[self._standing] = csgraph.dijkstra(self._graph, directed=False, indices=[nearest])[0]
        return out

    def within(self, xy_world: FloatArray, radius_m: float) -> BoolArray:
        """Return (rows, columns) the cells in which a robot can stand and whose middle is within a distance of a point (2,)."""
        cells = np.argwhere(self._standing)
        near = np.linalg.norm(self._free.middles(cells) - np.asarray(xy_world)[:2], axis=1) <= radius_m
        out = np.zeros_like(self._standing)
        out[tuple(cells[near].T)] = True
        return out


def _beside(cells: BoolArray, down: int, right: int) -> BoolArray:
    """Whether the cell so many rows and columns on is set; outside none is."""
    height, width = cells.shape
    out = np.zeros_like(cells)
    out[: height - down, max(-right, 0) : width - max(right, 0)] = cells[down:, max(right, 0) : width - max(-right, 0)]
    return out
