"""The planner over the skeleton of the free floor."""

import numpy as np
import pytest
from grid_worlds import along, distance_to_blocked_m, layout_from, random_layout

from seo_slam.errors import FrameError, NoPathError
from seo_slam.navigation.cell_graph import CellGraph
from seo_slam.navigation.global_planner import VoronoiPlanner
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.motion import path_length_m
from seo_slam.navigation.path_smoothing import shortened
from seo_slam.settings.planning import PlannerSettings

WALLED, OPEN = "#" + "." * 19 + "#" + "." * 19 + "#", "#" + "." * 39 + "#"
TWO_ROOMS = "\n".join(["#" * 41, *[WALLED] * 8, *[OPEN] * 9, *[WALLED] * 8, "#" * 41])


@pytest.fixture
def rooms():
    return VoronoiPlanner(NavigationGrid(layout_from(TWO_ROOMS), 0.18))


def pairs(grid, count, seed=0):
    draws = np.random.default_rng(seed)
    for _ in range(count):
        cells = grid.free_cells[draws.integers(len(grid.free_cells), size=2)]
        yield grid.layout.middles(cells) + grid.cell_m * draws.uniform(-0.5, 0.5, (2, 2))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("radius_m", [0.05, 0.12, 0.25])
def test_a_way_wherever_one_exists_and_never_a_collision(seed, radius_m):
    grid = NavigationGrid(random_layout(seed, share=0.08), radius_m)
    planner = VoronoiPlanner(grid)
    found = 0
    for a, b in pairs(grid, 60, seed):
        if not grid.same_part(a, b):
            with pytest.raises(NoPathError):
                planner.path(a, b)
            continue
        path = planner.path(a, b)
        found += 1
        assert np.array_equal(path[0], a)
        assert np.array_equal(path[-1], b)
        assert distance_to_blocked_m(grid.layout, along(path, 0.02)).min() >= radius_m - 1e-6
    assert found


def test_ways_are_found_where_the_skeleton_has_nothing():
    """A passage in which one row of cells is free, and a free patch so small that thinning leaves nothing of it."""
    drawing = "\n".join(["#" * 16, "#.....####.....#", *["#..............#"] * 3, "#.....####.....#", "#" * 16])
    narrow = VoronoiPlanner(NavigationGrid(layout_from(drawing), 0.09))
    a, b = np.array([0.35, 0.35]), np.array([1.25, 0.35])
    assert narrow.grid.free[:, 8].sum() == 1
    assert np.array_equal(narrow.path(a, b)[[0, -1]], [a, b])
    tiny = NavigationGrid(layout_from("\n".join(["#" * 6, *["#....#"] * 4, "#" * 6])), 0.1)
    assert tiny.free.sum() == 4
    planner = VoronoiPlanner(tiny, PlannerSettings(radius_m=0.1, comfort_m=0.01))
    cells = tiny.layout.middles(tiny.free_cells)
    assert np.array_equal(planner.path(cells[0], cells[-1])[[0, -1]], cells[[0, -1]])


def test_an_end_that_sees_no_node_is_led_to_one_cell_by_cell():
    planner = VoronoiPlanner(NavigationGrid(layout_from(TWO_ROOMS), 0.18))
    planner.grid.is_clear = lambda *_: False  # type: ignore[method-assign]  # as behind a corner
    way, node = planner._joined(np.array([0.35, 0.35]))
    assert planner.joined_by_grid == 1
    assert len(way) > 1
    assert node in planner.graph


def test_the_way_goes_through_the_door_and_keeps_away_from_walls(rooms):
    path = rooms.path(np.array([0.4, 2.2]), np.array([3.7, 0.4]))
    at_door = along(path)[np.abs(along(path)[:, 0] - 2.05) < 0.05]
    assert (np.abs(at_door[:, 1] - 1.35) < 0.45 - 0.18).all()
    middle = along(path)[50:-50]
    assert distance_to_blocked_m(rooms.grid.layout, middle).min() >= 0.3


def test_ways_are_not_much_longer_than_the_shortest(rooms):
    cells = CellGraph(rooms.grid)
    ratios = [
        path_length_m(rooms.path(a, b)) / path_length_m(cells.way(a, b)) for a, b in pairs(rooms.grid, 80) if np.linalg.norm(a - b) > 0.5
    ]
    assert np.mean(ratios) < 1.15


def test_the_same_question_has_the_same_answer_whatever_was_asked_before(rooms):
    a, b = np.array([0.4, 2.2]), np.array([3.7, 0.4])
    first = rooms.path(a, b)
    for c, d in pairs(rooms.grid, 10):
        rooms.path(c, d)
    assert np.array_equal(rooms.path(a, b), first)


def test_both_ends_in_one_place(rooms):
    a = np.array([0.5, 0.5])
    assert np.array_equal(rooms.path(a, a), [a, a])


def test_a_robot_inside_the_margin_may_leave(rooms):
    start = np.array([1.92, 0.4])  # 8 cm from the wall
    path = rooms.path(start, np.array([0.5, 2.0]))
    assert np.array_equal(path[0], start)
    assert rooms.grid.is_free(path[1:]).all()


def test_clear_errors_say_what_and_where(rooms):
    good = np.array([0.5, 0.5])
    with pytest.raises(NoPathError, match=r"start \(2\.05, 0\.25\): not on the free floor; the nearest free cell is 0\.\d+ m away"):
        rooms.path(np.array([2.05, 0.25]), good)
    with pytest.raises(NoPathError, match=r"goal \(9\.00, 9\.00\): not on the free floor"):
        rooms.path(good, np.array([9.0, 9.0]))
    with pytest.raises(FrameError, match="goal"):
        rooms.path(good, np.array([np.nan, 0.0]))
    with pytest.raises(FrameError, match="start"):
        rooms.path(np.zeros((2, 2)), good)
    apart = VoronoiPlanner(NavigationGrid(layout_from("\n".join(["#" * 21, *["#" + "." * 9 + "#" + "." * 9 + "#"] * 9, "#" * 21])), 0.15))
    with pytest.raises(NoPathError, match=r"no way from \(0\.50, 0\.50\) to \(1\.60, 0\.50\).*interrupted"):
        apart.path(np.array([0.5, 0.5]), np.array([1.6, 0.5]))


def test_a_layout_without_floor():
    planner = VoronoiPlanner(NavigationGrid(layout_from("##\n##"), 0.1))
    with pytest.raises(NoPathError, match="without any free floor"):
        planner.path(np.zeros(2), np.ones(2))


def test_short_cuts_keep_the_clearance_of_what_they_replace(rooms):
    corridor = np.array([[0.5, 1.3], [1.0, 1.35], [2.0, 1.35], [3.0, 1.35], [3.5, 1.3]])
    short = shortened(corridor, rooms.grid, 0.3)
    assert len(short) < len(corridor)
    assert np.array_equal(short[[0, -1]], corridor[[0, -1]])
    assert rooms.grid.clearance_along(along(short)).min() >= 0.29
