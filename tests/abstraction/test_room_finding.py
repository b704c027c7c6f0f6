"""Which room something is in, by one rule."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Room
from seo_slam.abstraction.describing import describe, room_id_of
from seo_slam.abstraction.room_finding import room_of, room_of_box
from seo_slam.navigation.query import candidates

KITCHEN, STUDY = 1, 2


def two_rooms():
    """4 x 2 m in cells of 10 cm: the kitchen left of x = 2, the study right of x = 2.2, a wall between them."""
    rooms = np.zeros((20, 40), dtype=np.int16)
    rooms[:, :20], rooms[:, 22:] = KITCHEN, STUDY
    grid = rooms > 0
    return Layout(np.zeros(2), 0.1, ~grid, ~grid, grid, rooms)


def points(x0, x1, y0=0.5, y1=1.0):
    x, y = np.meshgrid(np.arange(x0, x1, 0.1), np.arange(y0, y1, 0.1))
    return np.column_stack([x.ravel(), y.ravel()])


@pytest.mark.parametrize(
    ("footprint", "room"),
    [
        (points(0.55, 1.5), KITCHEN),
        (points(1.75, 2.15), KITCHEN),  # most of its points are on the wall, no others than the kitchen's in a room
        (points(1.85, 3.0), STUDY),
        (points(2.05, 2.2), KITCHEN),  # in the wall, both beside it: the larger room
        (points(4.25, 4.5), STUDY),  # outside the grid, beside the study
        (points(9.0, 9.5), 0),
    ],
)
def test_where_most_points_are_or_right_beside_them(footprint, room):
    assert room_of(two_rooms(), footprint) == room


def test_a_footprint_round_a_corner_is_where_its_points_are_and_not_where_its_box_is():
    corner = np.concatenate([points(1.05, 1.95, 0.5, 1.9), points(1.05, 3.45, 1.85, 1.9)])
    corner = corner[(corner[:, 0] < 1.3) | (corner[:, 1] > 1.8)]
    layout = two_rooms()
    layout.rooms[:19, 13:20] = 0
    layout.rooms[19, 22:34] = 0
    assert room_of(layout, corner) == KITCHEN
    assert room_of_box(layout, corner.min(axis=0), corner.max(axis=0)) == STUDY


def test_descriptions_and_queries_agree():
    """A desk at the study's wall, its floor unseen: both say study."""
    layout = two_rooms()
    layout.rooms[:, 22:28] = 0
    desk = Anchor(1, "desk", np.ones(3), points(2.35, 2.7), 9, (0.0, 0.8), 0.8)
    home = AbstractMap((desk,), layout, (Room(KITCHEN, "kitchen", 4.0), Room(STUDY, "study", 3.0)))
    assert room_id_of(home, desk) == STUDY
    assert describe(home).splitlines() == ["kitchen (4.0 m2)", "study (3.0 m2)", "  1 desk at 2.5, 0.7"]
    assert [row.anchor_id for row in candidates(home, np.ones(3), room="study")] == [1]
    assert candidates(home, np.ones(3), room="kitchen") == ()
    assert room_id_of(replace(home, layout=None), desk) == 0
