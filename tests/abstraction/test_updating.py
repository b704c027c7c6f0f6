"""How a new view changes an abstract map (DualMap IV-D)."""

from dataclasses import replace

import numpy as np
import pytest
from boxes_of_points import WordEmbedder, chair_points, landmark, shelf_points, table_points, thing_points

from seo_slam.abstraction.abstract_map import AbstractMap, Layout, Room
from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.footprints import box_share
from seo_slam.abstraction.updating import updated
from seo_slam.errors import MapError

CUP = landmark(10, "cup", thing_points(0.6, 0.4, 0.74))
BOOK = landmark(11, "book", thing_points(0.2, 0.2, 0.74))
SHOE = landmark(12, "shoe", thing_points(1.1, 0.7, 0.74))


@pytest.fixture
def seen(embedder, settings):
    return lambda *rows: abstract(rows, embedder, settings)


def table(landmark_id=1, points=None, label="table"):
    return landmark(landmark_id, label, table_points() if points is None else points)


def labels(anchor):
    return sorted(v.label for v in anchor.volatiles)


def corner(points, share=0.3):
    """What is seen of a table's far end."""
    return points[points[:, 0] >= 1.2 * (1 - share)]


def test_a_full_view_without_the_cup_forgets_it(seen, settings):
    old = seen(table(), CUP, BOOK)
    (anchor,) = updated(old, seen(table(5), SHOE, BOOK), settings).anchors
    assert anchor.id == 1
    assert labels(anchor) == ["book", "shoe"]
    (empty,) = updated(old, seen(table(5)), settings).anchors
    assert empty.volatiles == ()


def test_a_view_of_a_corner_forgets_nothing_and_adds_what_it_saw(seen, settings):
    old = seen(table(), CUP, BOOK)
    (anchor,) = updated(old, seen(table(5, corner(table_points())), SHOE), settings).anchors
    assert labels(anchor) == ["book", "cup", "shoe"]
    assert anchor.points < len(table_points()) * 1.05  # what lies in both counts once
    np.testing.assert_allclose(anchor.bounds_world, old.anchors[0].bounds_world, atol=0.06)


def test_a_thing_that_is_seen_again_from_a_corner_is_not_doubled_but_two_cups_are_two(seen, settings):
    old = seen(table(), landmark(10, "cup", thing_points(1.0, 0.4, 0.74)))
    again = seen(table(5, corner(table_points())), landmark(3, "cup", thing_points(1.0, 0.4, 0.74)))
    (anchor,) = updated(old, again, settings).anchors
    assert [v.landmark_id for v in anchor.volatiles] == [3]
    two = seen(table(5, corner(table_points())), *(landmark(k, "cup", thing_points(x, 0.4, 0.74)) for k, x in ((3, 1.0), (4, 1.15))))
    assert labels(updated(old, two, settings).anchors[0]) == ["cup", "cup"]


def test_a_view_from_afar_forgets_nothing(seen, settings):
    far = table(5, table_points()[::4])
    (anchor,) = updated(seen(table(), CUP), seen(far), settings).anchors
    assert labels(anchor) == ["cup"]


def test_a_corner_first_and_the_whole_later_gives_the_whole(seen, settings):
    part = table(1, corner(table_points()))
    (anchor,) = updated(seen(part, SHOE), seen(table(5), CUP), settings).anchors
    assert anchor.id == 1
    assert labels(anchor) == ["cup"]
    np.testing.assert_allclose(anchor.bounds_world, [[0, 0], [1.2, 0.8]], atol=0.03)
    assert anchor.points == pytest.approx(len(table_points()), rel=0.1)


def test_features_are_weighted_by_the_sizes_of_the_clouds(seen, settings, embedder):
    old = seen(table())
    new = replace(old.anchors[0], points=3 * old.anchors[0].points, feature=embedder.embed_text(["desk"])[0], label="desk")
    (anchor,) = updated(old, AbstractMap((new,), embedder="words"), settings).anchors
    np.testing.assert_allclose(anchor.feature, embedder.embed_text(["table"])[0])  # the two words are one in this embedder
    other = np.zeros(16)
    other[[0, 3]] = np.sqrt(0.5)
    (anchor,) = updated(old, AbstractMap((replace(new, feature=other),), embedder="words"), settings).anchors
    expected = old.anchors[0].feature + 3 * other
    np.testing.assert_allclose(anchor.feature, expected / np.linalg.norm(expected))
    assert anchor.label == "desk"
    assert anchor.id == 1


def test_a_chair_pushed_under_a_table_is_another_anchor(seen, settings):
    old = seen(table(), CUP)
    chair = landmark(0, "chair", chair_points((0.4, 0.2)))
    for one, other in ((old, seen(chair)), (seen(chair), old)):
        anchors = updated(one, other, settings).anchors
        assert sorted(a.label for a in anchors) == ["chair", "table"]
        assert anchors[0] is one.anchors[0]


def test_a_thing_that_is_called_otherwise_in_the_same_place_is_the_same(seen, settings):
    old = seen(landmark(1, "shelf", shelf_points()), landmark(10, "cup", thing_points(0.4, 0.17, 0.85)))
    (anchor,) = updated(old, seen(landmark(8, "wardrobe", shelf_points())), settings).anchors
    assert anchor.id == 1
    assert anchor.volatiles == ()


def test_what_was_not_seen_stays_and_what_is_new_gets_a_new_id(seen, settings):
    old = seen(table(4), CUP)
    new = seen(table(4, table_points((3.0, 0.0))), landmark(5, "book", thing_points(3.5, 0.4, 0.74)))
    kept, added = updated(old, new, settings).anchors
    assert kept is old.anchors[0]
    assert added.id == 5
    assert labels(added) == ["book"]


def test_two_pieces_of_a_table_are_no_second_table(seen, settings):
    points = table_points()
    left, right = points[points[:, 0] < 0.6], points[points[:, 0] >= 0.6]
    new = seen(table(1, left), table(2, right), SHOE)
    assert len(new.anchors) == 2
    (anchor,) = updated(seen(table(), CUP), new, settings).anchors
    assert labels(anchor) == ["shoe"]  # together they show all of it


def test_two_tables_side_by_side_stay_two(seen, settings):
    both = (table(1), table(2, table_points((1.22, 0.0))))
    again = updated(seen(*both, CUP), seen(*both), settings)
    assert [a.id for a in again.anchors] == [1, 2]
    assert again.anchors[0].volatiles == ()


def test_many_updates_with_the_same_view_change_nothing(seen, settings):
    old = seen(table(), landmark(2, "shelf", shelf_points((2.0, 0.0))), CUP, BOOK)
    now = old
    for _ in range(5):
        now = updated(now, old, settings)
    assert len(old.anchors) == 2
    for before, after in zip(old.anchors, now.anchors, strict=True):
        assert (after.points, after.label, labels(after)) == (before.points, before.label, labels(before))
        np.testing.assert_allclose(after.bounds_world, before.bounds_world, atol=1e-9)
        assert len(after.footprint_world) == pytest.approx(len(before.footprint_world), rel=0.05)


def test_boxes_may_stand_in_for_cells(seen, settings):
    boxes = settings.model_copy(update={"overlap": "boxes"})
    (anchor,) = updated(seen(table(), CUP), seen(table(5)), boxes).anchors
    assert anchor.volatiles == ()


@pytest.mark.parametrize("overlap", ["cells", "boxes"])
@pytest.mark.parametrize("points", [1, 4])
def test_a_footprint_without_area_is_known_again(seen, settings, overlap, points):
    made = seen(table())
    thin = replace(made.anchors[0], footprint_world=np.array([[1.0 + 0.05 * k, 1.0] for k in range(points)]))
    old = now = replace(made, anchors=(thin,))
    for _ in range(5):
        now = updated(now, old, settings.model_copy(update={"overlap": overlap}))
    assert len(now.anchors) == 1


def test_the_share_of_a_box_in_another():
    square, half = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[0.5, 0.0], [1.5, 1.0]])
    assert box_share(square, half, 0.05) == pytest.approx(0.5)
    assert box_share(square, half + 5.0, 0.05) == 0.0
    line = np.array([[0.2, 0.5], [0.6, 0.5]])
    assert box_share(line, square, 0.05) == pytest.approx(1.0)
    assert box_share(square, line, 0.05) == pytest.approx(0.4 * 0.05)
    assert box_share(line, line + np.array([0.0, 0.02]), 0.05) == pytest.approx(0.6)


def test_nothing_in_or_out(seen, settings):
    full, none = seen(table(4), CUP), AbstractMap((), embedder="words")
    assert updated(full, none, settings).anchors == full.anchors
    assert updated(none, full, settings).anchors[0].volatiles == full.anchors[0].volatiles
    assert updated(none, none, settings).anchors == ()


def test_layout_and_rooms_of_the_whole_map_are_kept(seen, settings):
    grid = np.zeros((2, 3), dtype=np.bool_)
    layout = Layout(np.zeros(2), 0.1, grid, grid, grid, grid.astype(np.int16))
    old = replace(seen(table()), layout=layout, rooms=(Room(1, "kitchen", 9.0),))
    now = updated(old, seen(table(5)), settings)
    assert now.layout is layout
    assert now.rooms == old.rooms
    assert updated(seen(table()), old, settings).layout is layout


def test_features_of_two_models_are_not_mixed(seen, settings):
    with pytest.raises(MapError, match="one model"):
        updated(seen(table()), replace(seen(table()), embedder="minilm"), settings)


def test_the_tiny_embedder_is_an_embedder():
    assert np.linalg.norm(WordEmbedder().embed_text(["cup"])[0]) == pytest.approx(1.0)
