"""The global planner: along the lines that are as far from walls as can be (DualMap IV-C, "a Voronoi-based planner").

The lines are the skeleton of the free cells. It keeps the connections of the free floor, so a way is found wherever one exists.
"""

import math
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from seo_slam.geometry import FloatArray
from seo_slam.navigation.cell_graph import CellGraph
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.path_smoothing import shortened
from seo_slam.navigation.planner_ends import ends_of
from seo_slam.navigation.skeleton_graph import skeleton_graph
from seo_slam.registry import missing
from seo_slam.settings.planning import PlannerSettings
from seo_slam.types import BoolArray, IntArray

try:
    import networkx
    from skimage.morphology import skeletonize
except ModuleNotFoundError as error:
    raise missing("the global planner", error) from error

_NEAREST = 16
"""So many nodes are tried for a straight line to an end of a way."""


class VoronoiPlanner:
    """Plans over one grid. The graph is built once; a query then takes a few milliseconds.

    Attributes:
        grid: where to plan.
        skeleton: (R, C) the free cells in the middle between what is around them.
        graph: of the skeleton; see ``skeleton_graph``.
        joined_by_grid: how many ends so far saw no node of the skeleton and were led to it cell by cell.
        found_by_grid: how many ways so far were searched cell by cell, since their part of the floor has no skeleton.
    """

    def __init__(self, grid: NavigationGrid, settings: PlannerSettings | None = None) -> None:
        """Build the graph."""
        self.grid = grid
        self.settings = settings or PlannerSettings(radius_m=grid.radius_m)
        self.joined_by_grid = 0
        self.found_by_grid = 0
        self.skeleton: BoolArray = np.asarray(skeletonize(grid.free), dtype=np.bool_)
        self.graph = skeleton_graph(self.skeleton, grid.layout)
        self._places: dict[int, list[float]] = {node: kept["xy"] for node, kept in self.graph.nodes.items()}
        self._nodes = list(self._places)
        self._xy: FloatArray = np.array(list(self._places.values()), dtype=np.float64).reshape(-1, 2)
        self._tree = cKDTree(self._xy)

    def path(self, start_xy: FloatArray, goal_xy: FloatArray) -> FloatArray:
        """Return a collision-free way.

        Args:
            start_xy: (2,) where the robot is, world frame. It may stand a little too near to something (see ``NavigationGrid.way_out``):
                then the first stretch leads out of there.
            goal_xy: (2,) a free place; see ``NavigationGrid.nearest_free``.

        Returns:
            (N, 2) corners of the way, both ends included.

        Raises:
            FrameError: a point is not two finite numbers.
            NoPathError: no way exists; the message says why and where.
        """
        ends = ends_of(self.grid, start_xy, goal_xy)
        way = shortened(self._along_skeleton(ends.start, ends.goal), self.grid, self.settings.comfort_m)
        return np.concatenate([ends.escape, way])

    @cached_property
    def _cells(self) -> CellGraph:
        return CellGraph(self.grid)

    @cached_property
    def _ways_to_skeleton(self) -> IntArray:
        nodes = np.zeros(self.grid.free.size, dtype=np.bool_)
        nodes[self._nodes] = True
        return self._cells.ways_to(nodes)

    def _along_skeleton(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """A clear way through many points, before any short cut."""
        if np.linalg.norm(goal - start) <= self.settings.comfort_m and self.grid.is_clear(start, goal):
            return np.stack([start, goal])
        first, last = self._joined(start), self._joined(goal)
        if first is None or last is None:
            self.found_by_grid += 1
            return self._cells.way(start, goal)
        (lead_in, node_in), (lead_out, node_out) = first, last
        nodes = networkx.astar_path(self.graph, node_in, node_out, heuristic=self._straight_m, weight="length")
        return np.concatenate([lead_in, self._over_cells(nodes), lead_out[::-1]])

    def _over_cells(self, nodes: list[int]) -> FloatArray:
        """All cells (N, 2) that a way over nodes runs over."""
        cells = nodes[:1]
        for a, b in pairwise(nodes):
            between: list[int] = self.graph.edges[a, b]["cells"]
            cells += between[1:] if between[0] == a else between[-2::-1]
        return self.grid.layout.middles(np.stack(np.unravel_index(cells, self.grid.free.shape), axis=-1))

    def _joined(self, xy: FloatArray) -> tuple[FloatArray, int] | None:
        """A clear way (N, 2) from a free point to a node, and that node: straight where one is seen, else cell by cell."""
        if not len(self._nodes):
            return None
        for index in np.atleast_1d(self._tree.query(xy, k=min(_NEAREST, len(self._nodes)))[1]):
            if self.grid.is_clear(xy, self._xy[index]):
                return xy[None], self._nodes[index]
        way, node = self._cells.follow(self._ways_to_skeleton, xy)
        if node not in self._places:
            return None
        self.joined_by_grid += 1
        return way, node

    def _straight_m(self, a: int, b: int) -> float:
        (xa, ya), (xb, yb) = self._places[a], self._places[b]
        return math.hypot(xa - xb, ya - yb)
