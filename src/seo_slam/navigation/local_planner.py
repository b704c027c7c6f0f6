"""The local planner: RRT* (Karaman and Frazzoli, "Sampling-based algorithms for optimal motion planning", 2011; DualMap IV-C)."""

import math
from itertools import pairwise

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.navigation.cell_graph import CellGraph
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.path_smoothing import shortened
from seo_slam.navigation.planner_ends import Ends, ends_of
from seo_slam.navigation.search_tree import SearchTree
from seo_slam.settings.planning import PlannerSettings
from seo_slam.types import IntArray

_KEY = 0x5252542A  # of the draws
_SAME_M = 1e-9


class RrtStar:
    """Plans a short way from where the robot is. The same grid, settings, seed and ends give the same way.

    Attributes:
        grid: where to plan.
        tree: of the last search, to look at; None before the first.
    """

    def __init__(self, grid: NavigationGrid, settings: PlannerSettings | None = None, seed: int = 0) -> None:
        """Plan nothing yet."""
        self.grid = grid
        self.settings = settings or PlannerSettings(radius_m=grid.radius_m)
        self.seed = seed
        self.tree: SearchTree | None = None

    def path(self, start_xy: FloatArray, goal_xy: FloatArray) -> FloatArray:
        """Return the best collision-free way after all iterations, with its needless corners left out.

        Args:
            start_xy: (2,) where the robot is, world frame; it may stand a little too near to something, see ``NavigationGrid.way_out``.
            goal_xy: (2,) a free place.

        Returns:
            (N, 2) corners of the way, both ends included.

        Raises:
            FrameError: a point is not two finite numbers.
            NoPathError: no way exists; the message says why and where.
        """
        ends = ends_of(self.grid, start_xy, goal_xy)
        self.tree = tree = SearchTree(ends.start)
        goal = self._grow(tree, ends)
        return np.concatenate([ends.escape, shortened(tree.way_to(goal), self.grid, self.grid.radius_m)])

    def _grow(self, tree: SearchTree, ends: Ends) -> int:
        """Grow the tree through all iterations and return the node of the goal.

        If the goal is not reached in half of them, the shortest way over cells becomes a branch, and the other half makes it better: the
        way round a wall and through a door is rarely hit by chance.
        """
        settings, draws = self.settings, np.random.default_rng([self.seed, _KEY])
        part = self._part_of(ends.start)
        area_m2 = len(part) * self.grid.cell_m**2
        near = part[_from_segment_m(part, ends.start, ends.goal) <= max(settings.rrt_around_m, self.grid.cell_m)]
        goal = self._try_goal(tree, 0, ends.goal)
        for iteration in range(settings.rrt_iterations):
            if goal is None and iteration == settings.rrt_iterations // 2:
                near, goal = part, self._branch_over_cells(tree, ends)
            sample = near[draws.integers(len(near))] + self.grid.cell_m * draws.uniform(-0.5, 0.5, 2)
            if goal is None:
                sample = ends.goal if draws.random() < settings.rrt_goal_share else sample
            elif _through_m(sample, ends) >= tree.cost_m[goal]:
                continue  # no way over there is shorter than the one there is (Gammell et al. 2014)
            added = self._extend(tree, sample, area_m2)
            if added is not None and goal is None:
                goal = self._try_goal(tree, added, ends.goal)
        return self._branch_over_cells(tree, ends) if goal is None else goal

    def _extend(self, tree: SearchTree, sample: FloatArray, area_m2: float) -> int | None:
        """One step: towards a sample, from the best parent, and then to whom it leads more shortly. The new node, or None."""
        away_m = tree.distances_m(sample)
        nearest = int(np.argmin(away_m))
        if away_m[nearest] < _SAME_M:
            return None
        share = min(1.0, self.settings.rrt_step_m / float(away_m[nearest]))
        xy = tree.xy_world[nearest] + share * (sample - tree.xy_world[nearest])
        if not self.grid.is_clear(tree.xy_world[nearest], xy):
            return None
        away_m = tree.distances_m(xy)
        near = np.flatnonzero(away_m <= self._near_m(len(tree), area_m2))
        node = tree.add(xy, self._best_parent(tree, xy, nearest, near, away_m))
        for other in near[tree.cost_m[node] + away_m[near] < tree.cost_m[near] - _SAME_M]:
            # An earlier one of these moves may have made this one cheaper already.
            better = tree.cost_m[node] + away_m[other] < tree.cost_m[other] - _SAME_M
            if better and self.grid.is_clear(xy, tree.xy_world[other]):
                tree.move(int(other), node)
        return node

    def _best_parent(self, tree: SearchTree, xy: FloatArray, nearest: int, near: IntArray, away_m: FloatArray) -> int:
        """The node with the least cost to a new place among the near ones that see it."""
        costs_m = tree.cost_m[near] + away_m[near]
        for index in np.argsort(costs_m, kind="stable"):
            if costs_m[index] >= tree.cost_m[nearest] + away_m[nearest]:
                break
            if self.grid.is_clear(tree.xy_world[near[index]], xy):
                return int(near[index])
        return nearest

    def _try_goal(self, tree: SearchTree, node: int, goal: FloatArray) -> int | None:
        """Add the goal after a node from which it is one step away; it is a node like others then, and finds better parents."""
        xy = tree.xy_world[node]
        apart_m = float(np.hypot(*(goal - xy)))
        if apart_m < _SAME_M:
            return node
        return tree.add(goal, node) if apart_m <= self.settings.rrt_step_m and self.grid.is_clear(xy, goal) else None

    def _near_m(self, nodes: int, area_m2: float) -> float:
        """Radius within which a tree of so many nodes is rewired: shrinks with (log n / n)^(1/2), but at most one step."""
        gamma = 2.0 * math.sqrt(1.5 * area_m2 / math.pi)  # the least that the proof allows, for two dimensions
        return min(1.1 * gamma * math.sqrt(math.log(nodes + 1) / (nodes + 1)), self.settings.rrt_step_m)

    def _branch_over_cells(self, tree: SearchTree, ends: Ends) -> int:
        """Add the shortest way over cells, in edges of at most a step, and return its last node: the goal."""
        node = 0
        for a, b in pairwise(shortened(CellGraph(self.grid).way(ends.start, ends.goal), self.grid, self.grid.radius_m)):
            pieces = math.ceil(float(np.hypot(*(b - a))) / self.settings.rrt_step_m)
            for xy in np.linspace(a, b, pieces + 1)[1:]:
                node = tree.add(xy, node)
        return node

    def _part_of(self, xy: FloatArray) -> FloatArray:
        """(N, 2) middles of the free cells that can be reached from a free place."""
        row, column = self.grid.layout.cells(xy)
        return self.grid.layout.middles(np.argwhere(self.grid.parts == self.grid.parts[row, column]))


def _through_m(sample: FloatArray, ends: Ends) -> float:
    """Length of the shortest imaginable way over a sample."""
    return float(np.hypot(*(sample - ends.start)) + np.hypot(*(ends.goal - sample)))


def _from_segment_m(xy: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance (N,) of points (N, 2) from a segment."""
    along = b - a
    share = np.clip((xy - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(xy - (a + share[:, None] * along), axis=1))
