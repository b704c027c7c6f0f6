"""The planning grid: what is free, exact tests of segments, ways out."""

from dataclasses import replace

import numpy as np
import pytest
from grid_worlds import along, distance_to_blocked_m, layout_from, layout_of_cells, random_layout
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.errors import ConfigError
from seo_slam.navigation.grid import NavigationGrid

ROOM = "\n".join(["#" * 20, *["#" + "." * 18 + "#"] * 10, "#" * 20])


@pytest.mark.parametrize("radius_m", [0.05, 0.18, 0.33])
def test_wherever_in_a_free_cell_the_robot_is_it_touches_nothing(radius_m):
    layout = random_layout(seed=1)
    grid = NavigationGrid(layout, radius_m)
    draws = np.random.default_rng(0)
    inside = layout.middles(grid.free_cells).repeat(5, axis=0) + layout.cell_m * draws.uniform(-0.5, 0.5, (5 * len(grid.free_cells), 2))
    assert len(inside) > 50
    assert distance_to_blocked_m(layout, inside).min() >= radius_m - 1e-9


def test_a_cell_is_free_as_soon_as_it_is_safe():
    layout = random_layout(seed=2)
    grid = NavigationGrid(layout, 0.18)
    corners = np.array([(x, y) for x in (-0.5, 0.5) for y in (-0.5, 0.5)]) * layout.cell_m * (1 - 1e-9)
    cells = np.argwhere(layout.floor & ~grid.free)
    least = np.min([distance_to_blocked_m(layout, layout.middles(cells) + corner) for corner in corners], axis=0)
    assert (least < 0.18 + 1e-6).all()


def test_what_was_never_seen_and_what_lies_outside_is_not_free():
    grid = NavigationGrid(layout_from(ROOM.replace("..", ". ", 3)), 0.05)
    assert not grid.is_free(grid.layout.middles(np.argwhere(~grid.layout.floor))).any()
    assert not grid.is_free(np.array([[-0.5, 0.5], [0.5, 99.0], [2.0, 0.55]])).any()


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 3), st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4))
def test_a_clear_segment_is_free_all_along_and_another_is_not(seed, shares):
    layout = random_layout(seed, share=0.03)
    grid = NavigationGrid(layout, 0.1)
    size = np.array(layout.floor.shape[::-1]) * layout.cell_m
    a, b = (layout.corner_world + np.array(pair) * size * 0.999 for pair in (shares[:2], shares[2:]))
    points = along([a, b], 0.001)
    if grid.is_clear(a, b):
        assert distance_to_blocked_m(layout, points[::7]).min() >= 0.1 - 1e-6
    else:
        beside = [points + offset for offset in np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]) * 1e-3]
        assert not all(grid.is_free(shifted).all() for shifted in beside)


def test_a_segment_may_pass_between_two_free_cells_at_their_corner():
    floor = np.zeros((9, 9), dtype=np.bool_)
    floor[1:5, 1:5] = floor[3:8, 3:8] = True
    grid = NavigationGrid(layout_of_cells(~floor, floor), 0.1)
    a, b = grid.layout.middles(np.array([[2, 2], [5, 5]]))
    assert grid.free[[2, 5], [2, 5]].all()
    assert grid.same_part(a, b) == grid.is_clear(a, b)


def test_segments_with_an_end_outside_the_grid_are_not_clear():
    grid = NavigationGrid(layout_from(ROOM), 0.1)
    assert not grid.is_clear(np.array([1.0, 0.6]), np.array([5.0, 0.6]))
    assert not grid.is_clear(np.array([-1.0, 0.6]), np.array([1.0, 0.6]))
    assert grid.is_clear(np.array([0.5, 0.6]), np.array([1.0, 0.6]))


def test_a_segment_keeps_the_distance_asked_for():
    grid = NavigationGrid(layout_from(ROOM), 0.1)
    a, b = np.array([0.5, 0.35]), np.array([1.5, 0.35])
    assert grid.is_clear(a, b)
    assert grid.is_clear(a, b, 0.2)
    assert not grid.is_clear(a, b, 0.3)


def test_the_nearest_free_place():
    grid = NavigationGrid(layout_from(ROOM), 0.18)
    inside = np.array([1.0, 0.6])
    assert np.array_equal(grid.nearest_free(inside, 0.0), inside)
    in_wall = np.array([1.03, 0.02])
    found = grid.nearest_free(in_wall, 1.0)
    assert grid.is_free(found[None])[0]
    assert np.linalg.norm(found - in_wall) == pytest.approx(np.linalg.norm(grid.layout.middles(grid.free_cells) - in_wall, axis=1).min())
    assert grid.nearest_free(in_wall, 0.1) is None


def test_parts_of_the_floor():
    grid = NavigationGrid(layout_from("\n".join(["#" * 21, *["#" + "." * 9 + "#" + "." * 9 + "#"] * 9, "#" * 21])), 0.15)
    left, right = np.array([0.5, 0.5]), np.array([1.6, 0.5])
    assert grid.same_part(left, left + 0.05)
    assert not grid.same_part(left, right)
    assert not grid.same_part(left, np.array([0.0, 0.0]))


def test_a_robot_a_little_too_near_to_a_wall_can_leave_but_not_through_it():
    grid = NavigationGrid(layout_from("\n".join(["#" * 21, *["#" + "." * 9 + "#" + "." * 9 + "#"] * 9, "#" * 21])), 0.15)
    near = np.array([0.99, 0.52])  # left of the wall in the middle
    assert not grid.is_free(near[None])[0]
    out = grid.way_out(near)
    assert grid.is_free(out[None])[0]
    assert out[0] < 1.0
    assert grid.way_out(np.array([1.05, 0.5])) is None  # inside the wall
    assert grid.way_out(np.array([-3.0, 0.5])) is None


def test_a_layout_without_floor():
    grid = NavigationGrid(layout_from("##\n##"), 0.1)
    assert grid.free_share == 0.0
    assert grid.nearest_free(np.zeros(2), 10.0) is None
    assert grid.way_out(np.zeros(2)) is None


@pytest.mark.parametrize("radius_m", [0.0, -1.0, np.nan, np.inf])
def test_a_bad_radius(radius_m):
    with pytest.raises(ConfigError, match="radius_m"):
        NavigationGrid(layout_from(ROOM), radius_m)


def test_a_way_in_over_unknown_floor_leads_past_no_obstacle():
    """The nearest free floor lies behind a wall; what can be come to is farther off."""
    unknown = "?" * 21
    grid = NavigationGrid(layout_from("\n".join([*["." * 9 + "#" + "?" * 3 + "." * 8] * 9, unknown])), 0.1)
    stands = np.array([1.05, 0.5])
    assert grid.nearest_free(stands, 1.0)[0] < 1.0
    out = grid.way_in(stands, 1.0)
    assert grid.is_free(out[None])[0]
    assert out[0] > 1.3
    assert grid.way_in(stands, 0.1) is None


def test_an_island_of_floor_is_left_for_the_large_part():
    rows = ["." * 5 + " " * 3 + "." * 12] * 9
    grid = NavigationGrid(layout_from("\n".join(rows)), 0.1)
    island, shore = np.array([0.25, 0.45]), np.array([1.5, 0.45])
    assert grid.is_free(island[None])[0]
    found = grid.way_in(island, 1.0)
    assert found[0] > 0.8
    assert not grid.same_part(island, found)
    assert np.array_equal(grid.way_in(shore, 1.0), shore)
    assert np.array_equal(grid.way_in(island, 0.3), island)  # too far off
    walled = NavigationGrid(layout_from("\n".join(["." * 5 + " # " + "." * 12] * 9)), 0.1)
    assert np.array_equal(walled.way_in(island, 1.0), island)


def test_a_way_in_keeps_off_what_was_seen_where_it_can():
    """The nearest floor is round the corner of a chest; a little farther off is some to which the robot comes without touching it."""
    rows = ["#" * 12 + " " * 20] * 16 + ["." * 18 + " " * 14] * 12
    grid = NavigationGrid(layout_from("\n".join(rows), cell_m=0.05), 0.18)
    stands, corner = np.array([1.05, 0.9]), np.array([0.6, 0.6])
    nearest, found = grid.nearest_free(stands, 1.0), grid.way_in(stands, 1.0)
    off_m = [np.linalg.norm(np.linspace(stands, place, 200) - corner, axis=1).min() for place in (nearest, found)]
    assert off_m[1] > max(0.2, off_m[0] + 0.02)  # cells are told apart on the safe side
    assert grid.is_free(found[None])[0]


def test_a_robot_in_what_the_map_holds_for_solid_comes_out_of_it_but_through_no_wall():
    """A table that was carried away since stands at the wall; on the other side of the wall there is floor as well."""
    drawn = layout_from("\n".join(["." * 6 + "####" + "." * 10] * 9))
    walls = np.zeros_like(drawn.floor)
    walls[:, 6] = True
    grid = NavigationGrid(replace(drawn, walls=walls), 0.1)
    in_table = np.array([0.75, 0.45])
    assert grid.nearest_free(in_table, 1.0)[0] < 0.6
    assert grid.way_in(in_table, 1.0)[0] > 1.0
    deep = NavigationGrid(layout_from("\n".join(["#" * 12 + "." * 8] * 9)), 0.1)
    assert deep.way_in(np.array([0.15, 0.45]), 3.0) is None
    assert deep.way_in(np.array([1.05, 0.45]), 3.0)[0] > 1.2


def test_a_robot_beside_the_mapped_ground_comes_onto_it():
    grid = NavigationGrid(layout_from("\n".join(["." * 20] * 9)), 0.1)
    assert grid.way_in(np.array([-0.2, 0.45]), 1.0)[0] > 0.0
    shut = NavigationGrid(layout_from("\n".join(["#" + "." * 19] * 9)), 0.1)
    assert shut.way_in(np.array([-0.2, 0.45]), 1.0) is None
