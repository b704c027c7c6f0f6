"""Floor that was not seen when the map was made, and is seen on the way."""

import numpy as np

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.looking import places_near
from seo_slam.navigation.ways import Ways


def layout(corner, shape, floor=(), obstacles=(), walls=()):
    grids = [np.zeros(shape, dtype=np.bool_) for _ in range(3)]
    for grid, windows in zip(grids, (floor, obstacles, walls), strict=True):
        for rows, columns in windows:
            grid[rows, columns] = True
    return Layout(np.array(corner), 0.1, grids[2], grids[1], grids[0], np.zeros(shape, dtype=np.int16))


ALL = slice(None)


def test_ways_plan_anew_only_where_something_new_was_seen():
    made = []

    def plan(floor):
        made.append(floor)
        return NavigationGrid(floor, 0.1), None, None

    known = layout((0.0, 0.0), (10, 20), floor=[(ALL, slice(0, 10))])
    ways = Ways(known, *plan(known), floor=known, plan=plan)
    assert not ways.grow(known)
    assert not ways.grid.is_free(np.array([[1.5, 0.5]]))[0]
    assert ways.grow(layout((0.0, 0.0), (10, 20), floor=[(ALL, ALL)]))
    assert ways.grid.is_free(np.array([[1.5, 0.5]]))[0]
    assert len(made) == 2
    assert not Ways(known, None, None, None).grow(known)


def test_a_tall_thing_does_not_hide_its_own_middle():
    """A refrigerator's faces are walls to look past; the place before its door is still nearer than one from which its side is missed."""
    tall = (slice(10, 20), slice(10, 20))
    room = layout(
        (0.0, 0.0), (40, 40), floor=[(ALL, ALL)], obstacles=[tall], walls=[(slice(10, 20), slice(18, 20)), (slice(10, 12), slice(10, 20))]
    )
    grid = NavigationGrid(room, 0.1)
    target, here = np.array([1.5, 1.5]), np.array([3.0, 1.5])
    box = np.array([1.0, 1.0]), np.array([2.0, 2.0])
    best = places_near(target, 1.5, here, grid, room, box)[0]
    assert best[0] > 2.0
    assert np.linalg.norm(best - target) < 0.8
