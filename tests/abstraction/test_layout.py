"""The layout from the scene cloud: walls as in the paper, obstacles and floor for a robot."""

import numpy as np
import pytest

from seo_slam.abstraction.floor_height import floor_height_m, floor_plane, heights_above
from seo_slam.abstraction.layout import layout_of, walls_of
from seo_slam.abstraction.voxels import KnownVoxels, Voxels
from seo_slam.geometry import exp, transform_points
from seo_slam.settings.planning import LayoutSettings

NO_WAY = np.zeros((0, 3))


def plane(low, high, z, step=0.02):
    """Points on a level rectangle."""
    x, y = np.meshgrid(np.arange(low[0] + step / 2, high[0], step), np.arange(low[1] + step / 2, high[1], step))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def wall(a, b, z=(0.0, 2.5), step=0.02):
    """Points on an upright rectangle from a to b."""
    share, height = np.meshgrid(np.arange(0, 1, step / np.linalg.norm(np.subtract(b, a))), np.arange(z[0] + step / 2, z[1], step))
    along = np.asarray(a) + share.reshape(-1, 1) * np.subtract(b, a)
    return np.column_stack([along, height.ravel()])


def room(z_floor=0.0, noise_m=0.0, seed=0):
    """4 x 3 m with a table of 1 x 1 m, a beam across it at 2 m, and a bump of 3 cm."""
    parts = [
        plane((0, 0), (4, 3), 0.0),
        *(wall(a, b) for a, b in [((0, 0), (4, 0)), ((4, 0), (4, 3)), ((4, 3), (0, 3)), ((0, 3), (0, 0))]),
        plane((1, 1), (2, 2), 0.72),
        plane((3.0, 0.5), (3.2, 2.5), 2.0),
        plane((2.5, 2.5), (2.8, 2.8), 0.03),
        plane((0, 0), (4, 3), 2.5),
    ]
    points = np.concatenate(parts) + np.array([0.0, 0.0, z_floor])
    return points + noise_m * np.random.default_rng(seed).standard_normal(points.shape)


def cells_of(layout, low, high):
    """A window of the grid, world frame, without the cells at its edge."""
    (row, column), (last_row, last_column) = layout.cells(np.array([np.add(low, 0.1), np.subtract(high, 0.1)]))
    return slice(row, last_row), slice(column, last_column)


@pytest.mark.parametrize("z_floor", [0.0, -1.37, 12.034])
@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_floor_and_obstacles_wherever_the_floor_is(z_floor, noise_m):
    layout = layout_of(Voxels.of(room(z_floor, noise_m), 0.05), NO_WAY, LayoutSettings())
    table = cells_of(layout, (1, 1), (2, 2))
    assert layout.obstacles[table].all()
    assert not layout.floor[table].any()
    for low, high in [((0, 0), (1, 3)), ((2.5, 2.5), (2.8, 2.8)), ((3.0, 0.5), (3.2, 2.5))]:  # free, the bump, under the beam
        window = cells_of(layout, low, high)
        assert layout.floor[window].all()
        assert not layout.obstacles[window].any()
    assert not (layout.floor & layout.obstacles).any()
    assert layout.walls[:, layout.cells(np.array([[0.02, 1.5]]))[0, 1]].mean() > 0.9


@pytest.mark.parametrize("degrees", [-1.5, 1.0])
def test_a_floor_that_leans_since_the_poses_drifted_is_still_floor(degrees):
    """The bump of 3 cm and the noise stay below what a robot steps over, although one side of the room is 10 cm higher."""
    leaning = transform_points(exp([0.0, np.radians(degrees), 0.0, 0.0, 0.0, 0.3]), room(noise_m=0.005))
    layout = layout_of(Voxels.of(leaning, 0.05), NO_WAY, LayoutSettings())
    for low, high in [((0, 0), (1, 3)), ((2, 0), (4, 1)), ((2, 2), (4, 3))]:
        assert layout.floor[cells_of(layout, low, high)].all()
        assert not layout.obstacles[cells_of(layout, low, high)].any()
    assert layout.obstacles[cells_of(layout, (1, 1), (2, 2))].all()


def test_a_ramp_is_no_lean_of_the_whole_floor():
    ramp = transform_points(exp([0.0, np.radians(-8.0), 0.0, 0.0, 0.0, 0.0]), plane((2.0, 0.0), (4.0, 3.0), 0.28))
    points = np.concatenate([plane((0, 0), (2, 3), 0.0), ramp])
    assert np.abs(points[:, 2] - heights_above(floor_plane(points, NO_WAY), points)).max() < 0.02


def test_what_was_not_seen_is_no_floor():
    points = room()
    seen = points[(points[:, 0] < 2.2) | (points[:, 1] > 1.0)]
    layout = layout_of(Voxels.of(seen, 0.05), NO_WAY, LayoutSettings())
    hidden = cells_of(layout, (2.2, 0.0), (4.0, 1.0))
    assert not layout.floor[hidden].any()


def test_small_gaps_between_points_are_floor():
    points = plane((0, 0), (2, 2), 0.0)
    holed = points[(np.abs(points[:, :2] - 1.0) > 0.07).any(axis=1)]
    layout = layout_of(Voxels.of(holed, 0.05), NO_WAY, LayoutSettings())
    assert layout.floor.all()
    bare = layout_of(Voxels.of(holed, 0.05), NO_WAY, LayoutSettings(floor_gap_cells=0))
    assert not bare.floor.all()


def test_where_the_camera_went_is_floor_but_not_through_what_was_seen_to_stand_there():
    points = np.concatenate([plane((0, 0), (1, 3), 0.0), plane((1.6, 1.4), (1.8, 1.6), 0.5), wall((3, 0), (3, 3))])
    way = np.column_stack([np.arange(0.5, 2.5, 0.1), np.full(20, 1.5), np.full(20, 1.2)])
    layout = layout_of(Voxels.of(points, 0.05), way, LayoutSettings(path_radius_m=0.2))
    on_way = layout.cells(np.array([[1.3, 1.5], [1.3, 1.65], [1.3, 2.0], [1.7, 1.5]]))
    assert layout.floor[tuple(on_way.T)].tolist() == [True, True, False, False]
    assert layout.obstacles[tuple(on_way.T)].tolist() == [False, False, False, True]


def test_a_few_stray_points_are_no_obstacle():
    strays = np.column_stack([np.random.default_rng(0).uniform(0, 3, (60, 2)), np.full(60, 0.3)])
    points = np.concatenate([plane((0, 0), (3, 3), 0.0), strays])
    layout = layout_of(Voxels.of(points, 0.05), NO_WAY, LayoutSettings())
    assert not layout.obstacles.any()


def test_the_lowest_large_level_is_the_floor():
    table, floor, few = plane((0, 0), (1.5, 1.5), 0.75), plane((0, 0), (2, 1.5), 0.1), plane((0, 0), (0.2, 0.2), -0.6)
    below = np.concatenate([table, floor, few])
    assert floor_height_m(below, NO_WAY) == pytest.approx(0.1, abs=1e-6)
    ceiling = plane((0, 0), (6, 6), 2.6)
    camera = np.array([[1.0, 1.0, 1.3]])
    assert floor_height_m(np.concatenate([plane((0, 0), (1, 1), 0.1), ceiling]), camera) == pytest.approx(0.1, abs=1e-6)


def test_walls_are_the_bins_with_more_points_than_nine_of_ten():
    counts = np.full((12, 30), 2.0)
    counts[0] = np.linspace(30.0, 40.0, 30)
    counts[5, 5] = counts[8, 20] = 50.0  # single bins
    counts[0, 10] = 2.0  # a gap in the wall
    walls = walls_of(counts, LayoutSettings())
    assert walls[0].all()
    assert not walls[1:].any()
    assert not walls_of(np.zeros((4, 4)), LayoutSettings()).any()


def test_an_empty_cloud_gives_an_empty_layout():
    layout = layout_of(Voxels(np.zeros((0, 3)), np.zeros(0, dtype=np.int64)), NO_WAY, LayoutSettings())
    assert not layout.floor.any()
    assert not layout.walls.any()


def test_what_lies_so_far_off_that_the_grid_would_be_too_large_is_left_out():
    """One frame with a pose that jumped; a room of two parts, which has room in the grid, stays whole."""
    near = np.concatenate([room(), room() + np.array([9.0, 0.0, 0.0])])
    far = plane((300.0, -500.0), (301.0, -499.0), 40.0)
    way = np.array([[0.5, 0.5, 1.2], [300.5, -499.5, 41.2]])
    told = []
    small = {"warn": told.append, "most_cells": 30_000}
    layout = layout_of(Voxels.of(np.concatenate([near, far]), 0.05), way, LayoutSettings(), **small)
    assert len(told) == 1
    assert "400 of " in told[0]
    alone = layout_of(Voxels.of(near, 0.05), way[:1], LayoutSettings(), **small)
    assert len(told) == 1
    for name in ("corner_world", "walls", "obstacles", "floor"):
        np.testing.assert_array_equal(getattr(layout, name), getattr(alone, name))


@pytest.mark.parametrize("turned", [False, True])
def test_one_piece_that_is_too_large_is_cut(turned):
    hall = plane((0, 0), (40, 3), 0.0)
    hall = hall[:, [1, 0, 2]] if turned else hall
    told = []
    layout = layout_of(Voxels.of(hall, 0.05), NO_WAY, LayoutSettings(), warn=told.append, most_cells=20_000)
    assert len(told) == 1
    assert 18_000 < layout.floor.size <= 20_000
    assert layout.floor.mean() > 0.9
    middle = 0.5 * (layout.middles(np.array([[0, 0]])) + layout.middles(np.array([layout.floor.shape]) - 1))[0]
    np.testing.assert_allclose(middle, (1.5, 20.0) if turned else (20.0, 1.5), atol=0.2)


def test_the_grid_is_aligned_so_that_layouts_can_be_laid_over_each_other():
    a = layout_of(Voxels.of(room(), 0.05), NO_WAY, LayoutSettings())
    b = layout_of(Voxels.of(room()[::3] + np.array([0.73, -2.11, 0.0]), 0.05), NO_WAY, LayoutSettings())
    cells = (a.corner_world - b.corner_world) / a.cell_m
    np.testing.assert_allclose(cells, np.round(cells), atol=1e-6)


def test_voxels_are_means_and_do_not_depend_on_the_order_of_the_points():
    draws = np.random.default_rng(0)
    points = draws.uniform(-1, 1, (500, 3))
    voxels = Voxels.of(points, 0.5)
    assert voxels.counts.sum() == 500
    np.testing.assert_allclose((voxels.p_world * voxels.counts[:, None]).sum(axis=0), points.sum(axis=0))
    other = Voxels.of(points[draws.permutation(500)], 0.5)
    np.testing.assert_allclose(voxels.p_world, other.p_world)
    again = Voxels.of(voxels.p_world, 0.5, voxels.counts)
    np.testing.assert_allclose(again.p_world, voxels.p_world)
    assert np.array_equal(again.counts, voxels.counts)


def test_known_cubes():
    known = KnownVoxels(0.1, 3)
    here, there = np.full((2, 3), 0.05), np.full((2, 3), -0.55)
    assert known.share_of_new(here) == 1.0
    known.add(here)
    assert known.share_of_new(here) == 1.0
    known.add(here)
    assert known.share_of_new(here) == 0.0
    assert known.share_of_new(np.concatenate([here, there])) == 0.5
    assert len(known) == 1
