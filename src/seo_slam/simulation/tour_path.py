"""Ways over the free floor: the shortest that keeps its distance from walls, and a smooth line along it."""

from typing import Any

import numpy as np
from scipy import sparse
from scipy.interpolate import CubicSpline
from scipy.sparse import csgraph

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.free_space import FreeSpace
from seo_slam.types import IntArray

PATH_CLEARANCE_M = 0.25
"""A tour keeps at least this far from everything."""

_KEPT_M = PATH_CLEARANCE_M + 0.035  # of the points that are smoothed: the line between them may come a little nearer
_COMFORT_M = 0.55  # ways with less room than this cost more
_STEP_M = 0.05
_ROUNDS = 120
_NEIGHBOURS = ((0, 1, 1.0), (1, 0, 1.0), (1, 1, 2.0**0.5), (1, -1, 2.0**0.5))


class Ways:
    """Shortest ways between the cells of a floor."""

    def __init__(self, free: FreeSpace, clearance_m: float = _KEPT_M) -> None:
        """Join neighbouring cells with enough clearance; narrow places cost up to three times their length."""
        self.free = free
        inside = free.main_part(clearance_m)
        self._number = np.full(inside.shape, -1, dtype=np.int64)
        self._number[inside] = np.arange(int(inside.sum()))
        self._cells = np.argwhere(inside)
        toll = 1.0 + 2.0 * np.clip(1.0 - free.clearance_m / _COMFORT_M, 0.0, 1.0)
        rows, columns, costs = [], [], []
        for down, right, length in _NEIGHBOURS:
            here, beside = _neighbours(inside.shape, down, right)
            a, b = self._number[here], self._number[beside]
            joined = (a >= 0) & (b >= 0)
            rows.append(a[joined])
            columns.append(b[joined])
            costs.append((length * free.cell_m * (toll[here] + toll[beside]) / 2.0)[joined])
        count = len(self._cells)
        ends: tuple[IntArray, IntArray] = (np.concatenate(rows), np.concatenate(columns))
        self._graph: Any = sparse.csr_matrix((np.concatenate(costs), ends), shape=(count, count))

    def nodes(self, xy_world: FloatArray) -> IntArray:
        """Return (N,) the nodes nearest to points (N, 2).

        Raises:
            ConfigError: there is no free floor.
        """
        if not len(self._cells):
            raise ConfigError("tour: got a floor on which nobody can walk")
        middles = self.free.middles(self._cells)
        return np.array([int(np.argmin(np.square(middles - xy).sum(axis=1))) for xy in xy_world], dtype=np.int64)

    def between(self, nodes: IntArray) -> tuple[FloatArray, IntArray]:
        """Return costs (N, N) between nodes, and for each the predecessor of every cell on the way from it."""
        costs, previous = csgraph.dijkstra(self._graph, directed=False, indices=nodes, return_predecessors=True)
        return np.asarray(costs[:, nodes]), np.asarray(previous, dtype=np.int64)

    def way(self, previous: IntArray, start: int, end: int) -> FloatArray:
        """Return the points (M, 2) from node to node; ``previous`` is the row of the start."""
        nodes = [end]
        while nodes[-1] != start:
            nodes.append(int(previous[nodes[-1]]))
        return self.free.middles(self._cells[nodes[::-1]])


def _neighbours(shape: tuple[int, ...], down: int, right: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Windows of a grid: every cell, and beside it its neighbour ``down`` rows and ``right`` columns on."""
    height, width = shape
    here = slice(0, height - down), slice(max(-right, 0), width - max(right, 0))
    return here, (slice(down, height), slice(max(right, 0), width - max(-right, 0)))


def visiting_order(costs: FloatArray) -> list[int]:
    """Return an order of all points, beginning with the first: nearest next, then improved by turning stretches round (2-opt)."""
    left, order = set(range(1, len(costs))), [0]
    while left:
        order.append(min(left, key=lambda k: (costs[order[-1], k], k)))
        left.remove(order[-1])
    improved = True
    while improved:
        improved = False
        for i in range(1, len(order) - 1):
            for j in range(i + 1, len(order)):
                a, b, c = order[i - 1], order[i], order[j]
                d = order[j + 1] if j + 1 < len(order) else None
                after = 0.0 if d is None else costs[b, d] - costs[c, d]
                if costs[a, c] - costs[a, b] + after < -1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    return order


def smoothed(points: FloatArray, free: FreeSpace) -> FloatArray:
    """Return a smooth line (N, 2), a point every 5 cm, along a line of cells (M, 2).

    Each point is drawn towards the middle of its neighbours as long as it keeps its clearance.
    """
    line = resampled(points, _STEP_M)
    for _ in range(_ROUNDS):
        for parity in (0, 1):
            middle = line.copy()
            middle[1:-1] = 0.5 * (line[:-2] + line[2:])
            moved = line + 0.8 * (middle - line)
            allowed = free.clearance_at(moved) >= np.minimum(_KEPT_M, free.clearance_at(line))
            allowed[parity::2] = False
            line[allowed] = moved[allowed]
    return resampled(line, _STEP_M)


def resampled(points: FloatArray, step_m: float) -> FloatArray:
    """Return points evenly spaced along a line (M, 2)."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    kept = np.concatenate([[True], np.diff(lengths) > 1e-9])
    lengths, points = lengths[kept], points[kept]
    count = max(round(lengths[-1] / step_m), 1) + 1
    at = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(at, lengths, points[:, k]) for k in range(2)], axis=-1)


class Line:
    """A twice differentiable curve through evenly spaced points, by the length walked."""

    def __init__(self, points: FloatArray) -> None:
        """Lay the curve through points (N, 2)."""
        lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        self.length_m = float(lengths[-1])
        self._curve = CubicSpline(lengths, points)

    def at(self, walked_m: FloatArray) -> FloatArray:
        """Return points (N, 2)."""
        return np.asarray(self._curve(np.clip(walked_m, 0.0, self.length_m)))
