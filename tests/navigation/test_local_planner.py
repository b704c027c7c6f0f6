"""RRT*: costs that hold after rewiring, edges that touch nothing, ways that get better."""

import numpy as np
import pytest
from grid_worlds import along, distance_to_blocked_m, layout_from, random_layout
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.errors import FrameError, NoPathError
from seo_slam.navigation.cell_graph import CellGraph
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.local_planner import RrtStar
from seo_slam.navigation.motion import path_length_m
from seo_slam.navigation.search_tree import SearchTree
from seo_slam.settings.planning import PlannerSettings

WALLED, OPEN = "#" + "." * 14 + "#" + "." * 14 + "#", "#" + "." * 29 + "#"
BEHIND_A_WALL = "\n".join(["#" * 31, *[WALLED] * 12, *[OPEN] * 8, "#" * 31])
START, GOAL = np.array([1.15, 1.7]), np.array([1.95, 1.7])


def sums_of_edges(tree):
    """Cost of each node, added up edge by edge from the root."""
    costs = []
    for node in range(len(tree)):
        cost, here = 0.0, node
        while (before := tree.parent[here]) >= 0:
            cost += np.linalg.norm(tree.xy_world[here] - tree.xy_world[before])
            here = before
        costs.append(cost)
    return np.array(costs)


@pytest.fixture(scope="module")
def grid():
    return NavigationGrid(layout_from(BEHIND_A_WALL), 0.18)


@pytest.mark.parametrize("seed", range(3))
def test_every_cost_is_the_sum_of_its_edges_and_every_edge_is_clear(grid, seed):
    planner = RrtStar(grid, PlannerSettings(rrt_iterations=400), seed)
    planner.path(START, GOAL)
    tree = planner.tree
    assert len(tree) > 100
    np.testing.assert_allclose(tree.cost_m, sums_of_edges(tree), atol=1e-9)
    for node in range(1, len(tree)):
        assert grid.is_clear(tree.xy_world[tree.parent[node]], tree.xy_world[node])


def test_nodes_were_rewired_and_what_is_after_them_followed():
    """A node is moved to a shorter way: its subtree gets cheaper by as much."""
    tree = SearchTree(np.zeros(2))
    detour = tree.add(np.array([0.0, 1.0]), 0)
    moved = tree.add(np.array([1.0, 1.0]), detour)
    after = tree.add(np.array([2.0, 1.0]), moved)
    last = tree.add(np.array([2.0, 2.0]), after)
    assert tree.cost_m[last] == pytest.approx(4.0)
    tree.move(moved, 0)
    assert tree.cost_m[[moved, after, last]] == pytest.approx(np.sqrt(2.0) + np.arange(3))
    np.testing.assert_allclose(tree.way_to(last), [[0, 0], [1, 1], [2, 1], [2, 2]])
    tree.move(after, detour)
    np.testing.assert_allclose(tree.cost_m, sums_of_edges(tree))


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_costs_hold_whatever_is_moved(seed):
    draws = np.random.default_rng(seed)
    tree = SearchTree(draws.random(2))
    for _ in range(25):
        tree.add(draws.random(2), int(draws.integers(len(tree))))
    for _ in range(20):
        node, parent = (int(k) for k in draws.integers(1, 26, 2))
        above = parent
        while above > 0 and above != node:
            above = int(tree.parent[above])
        if above != node:  # else a loop
            tree.move(node, parent)
    np.testing.assert_allclose(tree.cost_m, sums_of_edges(tree), atol=1e-9)


def test_more_iterations_make_better_ways_close_to_the_best(grid):
    best = path_length_m(CellGraph(grid).way(START, GOAL))
    means = []
    for iterations in (150, 400, 1000):
        costs = []
        for seed in range(6):
            planner = RrtStar(grid, PlannerSettings(rrt_iterations=iterations), seed)
            planner.path(START, GOAL)
            goal = int(np.argmin(planner.tree.distances_m(GOAL)))
            costs.append(planner.tree.cost_m[goal])
        means.append(np.mean(costs))
    assert means[0] > means[1] > means[2]
    assert means[2] < best


@pytest.mark.parametrize("seed", range(3))
def test_ways_touch_nothing(seed):
    grid = NavigationGrid(random_layout(seed, share=0.05), 0.12)
    draws = np.random.default_rng(seed)
    found = 0
    for _ in range(10):
        a, b = grid.layout.middles(grid.free_cells[draws.integers(len(grid.free_cells), size=2)])
        if grid.same_part(a, b) and np.linalg.norm(a - b) < 2.0:
            path = RrtStar(grid, seed=seed).path(a, b)
            assert np.array_equal(path[[0, -1]], [a, b])
            assert distance_to_blocked_m(grid.layout, along(path, 0.02)).min() >= 0.12 - 1e-6
            found += 1
    assert found


def test_a_way_is_found_wherever_one_exists_however_few_the_samples(grid):
    for iterations in (1, 2, 30):
        planner = RrtStar(grid, PlannerSettings(rrt_iterations=iterations, rrt_step_m=0.2))
        path = planner.path(START, GOAL)
        assert np.array_equal(path[[0, -1]], [START, GOAL])
        assert distance_to_blocked_m(grid.layout, along(path)).min() >= 0.18 - 1e-6
        np.testing.assert_allclose(planner.tree.cost_m, sums_of_edges(planner.tree), atol=1e-9)


def test_the_same_seed_gives_the_same_way(grid):
    first, again, other = (RrtStar(grid, seed=seed).path(START, GOAL) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_in_the_open_the_way_is_straight(grid):
    a, b = np.array([0.5, 0.4]), np.array([2.6, 0.5])
    assert np.array_equal(RrtStar(grid).path(a, b), [a, b])
    assert np.array_equal(RrtStar(grid).path(a, a), [a, a])


def test_a_robot_inside_the_margin_may_leave(grid):
    start = np.array([0.15, 0.5])  # 5 cm from the wall
    path = RrtStar(grid).path(start, np.array([1.0, 1.0]))
    assert np.array_equal(path[0], start)
    assert grid.is_free(path[1:]).all()


def test_no_way_is_an_error_that_says_which(grid):
    with pytest.raises(NoPathError, match=r"goal .*not on the free floor"):
        RrtStar(grid).path(START, np.array([1.55, 1.5]))
    shut = NavigationGrid(layout_from("\n".join(["#" * 31, *[WALLED] * 20, "#" * 31])), 0.18)
    with pytest.raises(NoPathError, match="interrupted"):
        RrtStar(shut).path(START, GOAL)
    with pytest.raises(FrameError, match="start"):
        RrtStar(grid).path(np.array([np.inf, 0.0]), GOAL)
