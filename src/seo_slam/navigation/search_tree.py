"""The tree of a sampling planner: places, who leads to whom, and what the way from the root costs."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

_ROOM = 256


class SearchTree:
    """Nodes 0 (the root), 1, 2, …; a node's cost is always the sum of the edges from the root to it."""

    def __init__(self, root_xy: FloatArray) -> None:
        """Plant the root."""
        self._xy: FloatArray = np.zeros((_ROOM, 2))
        self._cost_m: FloatArray = np.zeros(_ROOM)
        self._parent: list[int] = [-1]
        self._children: list[list[int]] = [[]]
        self._xy[0] = root_xy

    def __len__(self) -> int:
        return len(self._parent)

    @property
    def xy_world(self) -> FloatArray:
        """(N, 2) places."""
        return self._xy[: len(self)]

    @property
    def cost_m(self) -> FloatArray:
        """(N,) length of the way from the root."""
        return self._cost_m[: len(self)]

    @property
    def parent(self) -> IntArray:
        """(N,) the node before; -1 for the root."""
        return np.array(self._parent, dtype=np.int64)

    def distances_m(self, xy: FloatArray) -> FloatArray:
        """Return (N,) distances of all nodes from a point (2,)."""
        apart = self.xy_world - xy
        return np.asarray(np.sqrt(np.einsum("ij,ij->i", apart, apart)))

    def add(self, xy: FloatArray, parent: int) -> int:
        """Add a node after another, and return it."""
        node = len(self)
        if node == len(self._cost_m):  # full: room for twice as many
            self._xy, self._cost_m = np.tile(self._xy, (2, 1)), np.tile(self._cost_m, 2)
        self._xy[node] = xy
        self._parent.append(parent)
        self._children.append([])
        self._children[parent].append(node)
        self._cost_m[node] = self._cost_m[parent] + self._edge_m(parent, node)
        return node

    def move(self, node: int, parent: int) -> None:
        """Let another node lead to a node; the costs of all that comes after it follow."""
        self._children[self._parent[node]].remove(node)
        self._children[parent].append(node)
        self._parent[node] = parent
        waiting = [node]
        while waiting:
            here = waiting.pop()
            before = self._parent[here]
            self._cost_m[here] = self._cost_m[before] + self._edge_m(before, here)
            waiting += self._children[here]

    def way_to(self, node: int) -> FloatArray:
        """Return (N, 2) the way from the root."""
        nodes = [node]
        while (before := self._parent[nodes[-1]]) >= 0:
            nodes.append(before)
        return np.asarray(self._xy[nodes[::-1]])

    def _edge_m(self, a: int, b: int) -> float:
        return float(np.hypot(*(self._xy[a] - self._xy[b])))
