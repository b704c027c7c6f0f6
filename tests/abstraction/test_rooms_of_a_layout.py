"""Rooms of a layout and their names."""

import numpy as np
import pytest

from seo_slam.abstraction.abstract_map import Anchor, Layout
from seo_slam.abstraction.room_finding import room_of
from seo_slam.abstraction.room_words import ROOM_FURNITURE, room_votes
from seo_slam.abstraction.rooms import room_cells, with_rooms
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.settings.planning import LayoutSettings

SETTINGS = LayoutSettings()
EMBEDDER = HashedEmbedder()


def flat(seen_share=1.0, seed=0):
    """Three rooms of 10 x 6 m in cells of 5 cm: one to the left, two to the right, doors of 0.9 m between them."""
    walls = np.zeros((122, 202), dtype=np.bool_)
    walls[:2] = walls[-2:] = walls[:, :2] = walls[:, -2:] = True
    walls[:, 100:102] = walls[60:62, 100:] = True
    walls[20:38, 100:102] = walls[90:108, 100:102] = False
    obstacles = walls.copy()
    obstacles[70:110, 10:45] = obstacles[10:30, 150:190] = True
    floor = ~obstacles & (np.random.default_rng(seed).random(walls.shape) < seen_share)
    return Layout(np.array([2.0, 1.0]), 0.05, walls, obstacles, floor, np.zeros(walls.shape, dtype=np.int16))


def anchor(anchor_id, label, xy):
    x, y = np.meshgrid(np.arange(-0.4, 0.41, 0.1), np.arange(-0.3, 0.31, 0.1))
    footprint = np.asarray(xy) + np.column_stack([x.ravel(), y.ravel()])
    return Anchor(anchor_id, label, EMBEDDER.embed_text([label])[0], footprint, 100, (0.0, 0.5), 0.5)


LEFT, LOW, HIGH = (3.5, 5.5), (9.5, 2.0), (9.0, 6.3)


def test_rooms_are_parted_at_doors_and_not_by_furniture():
    cells = room_cells(flat(), SETTINGS)
    assert cells.max() == 3
    rooms = [cells[3:-3, 3:99], cells[3:59, 103:-3], cells[63:-3, 103:-3]]
    assert [int(np.median(room)) for room in rooms] == [1, 2, 3]
    assert all((room == np.median(room)).mean() > 0.99 for room in rooms)
    assert not cells[0].any()


@pytest.mark.parametrize("seed", range(3))
def test_floor_seen_in_patches_does_not_make_more_rooms(seed):
    layout, _ = with_rooms(flat(0.5, seed), [], EMBEDDER, SETTINGS)
    assert layout.rooms.max() == 3
    layout = flat()
    for row, column in np.random.default_rng(seed).integers(5, 95, (6, 2)):
        layout.floor[row : row + 14, column : column + 14] = False
    assert room_cells(layout, SETTINGS).max() == 3


def test_small_nooks_belong_to_the_room_beside_them():
    layout = flat()
    layout.walls[96:120, 85:87] = layout.obstacles[96:120, 85:87] = True  # a nook of 0.65 x 1.2 m
    layout.floor[layout.walls] = False
    assert room_cells(layout, SETTINGS).max() == 3


def test_rooms_are_named_by_their_furniture():
    anchors = [anchor(1, "bed", LEFT), anchor(2, "refrigerator", LOW), anchor(3, "chair", HIGH)]
    layout, rooms = with_rooms(flat(), anchors, EMBEDDER, SETTINGS)
    assert [room.name for room in rooms] == ["bedroom", "kitchen", "room 3"]
    assert [room.id for room in rooms] == [1, 2, 3]
    assert rooms[0].area_m2 == pytest.approx(4.85 * 5.9, rel=0.05)
    assert [room_of(layout, each.footprint_world) for each in anchors] == [1, 2, 3]
    assert room_of(layout, np.array([[50.0, 50.0]])) == 0


def test_a_second_room_of_a_kind_has_a_number_and_much_furniture_outvotes_one_piece():
    anchors = [
        anchor(1, "bed", LEFT),
        anchor(2, "bed", LOW),
        anchor(3, "sofa", HIGH),
        anchor(4, "coffee table", np.add(HIGH, 0.5)),
        anchor(5, "desk", np.add(HIGH, -0.5)),
    ]
    _, rooms = with_rooms(flat(), anchors, EMBEDDER, SETTINGS)
    assert [room.name for room in rooms] == ["bedroom", "bedroom 2", "living room"]


def test_an_open_kitchen_is_named_after_both():
    anchors = [anchor(1, "sofa", LEFT), anchor(2, "refrigerator", np.subtract(LEFT, 1.0)), anchor(3, "bookcase", np.subtract(LEFT, 0.5))]
    _, rooms = with_rooms(flat(), anchors, EMBEDDER, SETTINGS)
    assert rooms[0].name == "kitchen and living room"


def test_without_anchors_rooms_are_counted():
    _, rooms = with_rooms(flat(), [], EMBEDDER, SETTINGS)
    assert [room.name for room in rooms] == ["room 1", "room 2", "room 3"]


def test_a_layout_without_floor_has_no_rooms():
    nothing = np.zeros((4, 4), dtype=np.bool_)
    layout, rooms = with_rooms(
        Layout(np.zeros(2), 0.05, nothing, nothing, nothing, np.zeros((4, 4), dtype=np.int16)),
        [anchor(1, "bed", LEFT)],
        EMBEDDER,
        SETTINGS,
    )
    assert rooms == ()
    assert not layout.rooms.any()


def test_every_word_of_the_table_tells_its_own_room_and_plain_furniture_none():
    words = [(room, word) for room, furniture in ROOM_FURNITURE.items() for word in furniture]
    votes = room_votes(list(EMBEDDER.embed_text([word for _, word in words])), EMBEDDER, 0.55)
    assert [next(iter(vote)) for vote in votes] == [room for room, _ in words]
    assert room_votes(list(EMBEDDER.embed_text(["chair", "shelf", "table"])), EMBEDDER, 0.55) == [{}, {}, {}]
    assert room_votes([], EMBEDDER, 0.55) == []
