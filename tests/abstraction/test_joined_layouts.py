"""Two layouts become one over the ground of both."""

import numpy as np

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.abstraction.joined_layouts import joined


def layout(corner, floor, obstacles=(), walls=()):
    shape = np.shape(floor)
    grids = [np.zeros(shape, dtype=np.bool_) for _ in range(2)]
    for grid, cells in zip(grids, (obstacles, walls), strict=True):
        for cell in cells:
            grid[cell] = True
    return Layout(np.array(corner), 0.1, grids[1], grids[0], np.array(floor, dtype=np.bool_), np.ones(shape, dtype=np.int16))


def floor_at(made, x, y):
    row, column = made.cells(np.array([[x, y]]))[0]
    return bool(made.floor[row, column])


def test_the_ground_of_both_in_the_cells_of_the_first():
    known = layout((0.0, 0.0), np.ones((4, 6)), obstacles=[(0, 0)])
    seen = layout((0.43, -0.28), np.ones((5, 8)), obstacles=[(4, 7)], walls=[(0, 0)])
    both = joined(known, seen)
    np.testing.assert_allclose(both.corner_world, [0.0, -0.3], atol=1e-12)
    assert both.floor.shape == (7, 12)
    assert floor_at(both, 0.05, 0.05)
    assert floor_at(both, 1.1, -0.2)
    assert not floor_at(both, 0.05, -0.2)
    for point, grid in (((0.05, 0.05), both.obstacles), ((1.18, 0.17), both.obstacles), ((0.48, -0.23), both.walls)):
        row, column = both.cells(np.array([point]))[0]
        assert grid[row, column], point
    assert both.obstacles.sum() == 2
    assert both.walls.sum() == 1
    assert both.rooms.sum() == known.rooms.sum()  # what was added is of no room yet


def test_the_same_again_changes_nothing_but_rooms():
    known = layout((0.3, -0.7), np.eye(5), obstacles=[(1, 2)])
    again = joined(known, known)
    for name in ("floor", "obstacles", "walls"):
        np.testing.assert_array_equal(getattr(again, name), getattr(known, name))
    np.testing.assert_allclose(again.corner_world, known.corner_world)


def test_far_apart():
    both = joined(layout((0.0, 0.0), np.ones((2, 2))), layout((20.0, 5.0), np.ones((3, 3))))
    assert both.floor.sum() == 13
    assert both.floor.shape == (53, 203)


def test_too_far_apart_for_one_grid():
    told = []
    known = layout((0.0, 0.0), np.ones((2, 2)))
    same = joined(known, layout((20.0, 5.0), np.ones((3, 3))), told.append, 53 * 203 - 1)
    assert same is known
    assert len(told) == 1
    assert joined(known, known, told.append, 1).floor.shape == (2, 2)
    assert len(told) == 1
