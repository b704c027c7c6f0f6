"""An abstract map in words."""

from dataclasses import replace

import numpy as np
from boxes_of_points import landmark, shelf_points, table_points, thing_points

from seo_slam.abstraction.abstract_map import AbstractMap, Layout, Room
from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.describing import describe, room_id_of


def a_kitchen(embedder, settings):
    rows = [landmark(1, "table", table_points()), landmark(2, "shelf", shelf_points((3.0, 0.0)))]
    rows += [
        landmark(4 + k, label, thing_points(x, 0.4, z))
        for k, (label, x, z) in enumerate((("cup", 0.2, 0.74), ("cup", 0.9, 0.74), ("shoe", -0.1, 0.0)))
    ]
    return abstract(rows, embedder, settings)


def test_a_line_an_anchor(embedder, settings):
    assert describe(a_kitchen(embedder, settings)).splitlines() == [
        "1 table at 0.6, 0.4: on it 2 cup; next to it shoe",
        "2 shelf at 3.4, 0.2",
    ]
    assert describe(AbstractMap(())) == "no anchors"


def test_anchors_stand_under_their_rooms(embedder, settings):
    rooms = np.zeros((20, 60), dtype=np.int16)
    rooms[:, 2:20] = 1  # the table's left end is in no room
    grid = rooms > 0
    layout = Layout(np.zeros(2), 0.1, grid, grid, grid, rooms)
    home = replace(a_kitchen(embedder, settings), layout=layout, rooms=(Room(1, "kitchen", 3.64), Room(2, "room 2", 1.0)))
    assert [room_id_of(home, anchor) for anchor in home.anchors] == [1, 0]
    assert describe(home).splitlines() == [
        "kitchen (3.6 m2)",
        "  1 table at 0.6, 0.4: on it 2 cup; next to it shoe",
        "room 2 (1.0 m2)",
        "in no room",
        "  2 shelf at 3.4, 0.2",
    ]
