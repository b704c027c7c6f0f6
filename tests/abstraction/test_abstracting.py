"""From landmarks to anchors and what belongs to them."""

from dataclasses import replace

import numpy as np
import pytest
from boxes_of_points import chair_points, landmark, on_box, shelf_points, table_points, thing_points

from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.footprints import Region
from seo_slam.abstraction.relations import Body, Carrier, best_relation, inside, is_carried, next_to, on
from seo_slam.errors import MapError

CUP_ON = thing_points(0.6, 0.4, 0.74)


def belongings(abstract_map):
    return {v.landmark_id: (a.id, v.relation) for a in abstract_map.anchors for v in a.volatiles}


def test_a_cup_on_a_table_and_a_chair_next_to_it(embedder, settings):
    rows = [
        landmark(7, "cup", CUP_ON),
        landmark(3, "table", table_points()),
        landmark(5, "chair", chair_points((0.4, 0.9))),
        landmark(9, "shoe", thing_points(-0.15, 0.4, 0.0)),
    ]
    made = abstract(rows, embedder, settings)
    assert [(a.id, a.label) for a in made.anchors] == [(3, "table"), (5, "chair")]
    assert belongings(made) == {7: (3, "on"), 9: (3, "next to")}
    table, chair = made.anchors
    assert table.support_z_m == pytest.approx(0.74, abs=0.02)
    assert chair.support_z_m == pytest.approx(0.45, abs=0.02)
    assert table.points == len(table_points())
    np.testing.assert_allclose(table.xy_world, [0.6, 0.4], atol=0.03)
    assert made.embedder == "words"
    assert [v.label for v in table.volatiles] == ["cup", "shoe"]


def test_the_order_of_landmarks_does_not_matter(embedder, settings):
    rows = [landmark(3, "table", table_points()), landmark(1, "cup", CUP_ON), landmark(2, "book", thing_points(0.3, 0.2, 0.74))]
    one, other = abstract(rows, embedder, settings), abstract(rows[::-1], embedder, settings)
    assert belongings(one) == belongings(other) == {1: (3, "on"), 2: (3, "on")}
    assert [v.landmark_id for v in other.anchors[0].volatiles] == [1, 2]
    np.testing.assert_array_equal(one.anchors[0].footprint_world, other.anchors[0].footprint_world)


def test_a_cup_under_a_table_is_not_on_it_nor_in_it(embedder, settings):
    rows = [landmark(1, "table", table_points()), landmark(2, "cup", thing_points(0.6, 0.4, 0.0))]
    assert belongings(abstract(rows, embedder, settings)) == {2: (1, "next to")}
    only_on = settings.model_copy(update={"relations": ("on",)})
    assert belongings(abstract(rows, embedder, only_on)) == {}


def test_a_book_stands_on_the_board_of_a_shelf_it_is_on(embedder, settings):
    rows = [landmark(1, "shelf", shelf_points())]
    rows += [landmark(2 + k, "book", thing_points(0.3, 0.17, z, 0.15)) for k, z in enumerate((0.45, 0.85))]
    rows.append(landmark(9, "book", thing_points(0.4, 0.17, 1.25)))
    assert belongings(abstract(rows, embedder, settings)) == {2: (1, "on"), 3: (1, "on"), 9: (1, "on")}


def test_what_hangs_in_a_shelf_between_its_boards_is_in_it(embedder, settings):
    rows = [landmark(1, "shelf", shelf_points(levels=(0.05, 1.25))), landmark(2, "cup", thing_points(0.4, 0.2, 0.6))]
    assert belongings(abstract(rows, embedder, settings)) == {2: (1, "in")}


def test_a_table_seen_from_above_with_a_hole_where_things_stand_carries_them(embedder, settings):
    top = on_box((0, 0, 0.72), (1.2, 0.8, 0.74), "top")
    hidden = (np.abs(top[:, 0] - 0.6) < 0.15) & (top[:, 1] > 0.3)  # the cup, and the table behind it
    rows = [landmark(1, "table", top[~hidden]), landmark(2, "cup", CUP_ON[CUP_ON[:, 2] > 0.78])]
    assert belongings(abstract(rows, embedder, settings)) == {2: (1, "on")}


def test_of_two_tables_the_one_below_carries(embedder, settings):
    rows = [
        landmark(1, "table", table_points()),
        landmark(2, "table", table_points((1.2, 0.0))),
        landmark(3, "cup", thing_points(1.3, 0.4, 0.74)),
    ]
    assert belongings(abstract(rows, embedder, settings)) == {3: (2, "on")}


def test_what_is_far_from_all_anchors_is_left_out(embedder, settings):
    rows = [
        landmark(1, "table", table_points()),
        landmark(2, "cup", thing_points(3.0, 0.4, 0.0)),
        landmark(3, "cup", thing_points(0.6, 0.4, 1.5)),
    ]
    assert belongings(abstract(rows, embedder, settings)) == {}


def test_without_a_cloud_the_box_stands_in(embedder, settings):
    rows = [landmark(1, "table", table_points()), landmark(2, "cup", CUP_ON)]
    bare = [replace(row, cloud_world=np.zeros((0, 3))) for row in rows]
    assert belongings(abstract(bare, embedder, settings)) == {2: (1, "on")}


def test_nothing_gives_an_empty_map(embedder, settings):
    made = abstract([], embedder, settings)
    assert made.anchors == ()
    assert made.layout is None
    assert made.embedder == "words"


def test_a_thing_without_word_and_feature_is_no_volatile(embedder, settings):
    rows = [landmark(1, "table", table_points()), landmark(2, "", CUP_ON)]
    assert belongings(abstract(rows, embedder, settings)) == {}


def test_a_feature_of_another_model_is_made_anew_from_the_words(embedder, settings):
    made = abstract([landmark(1, "table", table_points(), embedding=np.ones(3))], embedder, settings)
    np.testing.assert_allclose(made.anchors[0].feature, embedder.embed_text(["table"])[0])


def test_an_id_twice_or_a_place_that_is_none_is_refused(embedder, settings):
    row = landmark(1, "table", table_points())
    with pytest.raises(MapError, match="given twice"):
        abstract([row, row], embedder, settings)
    with pytest.raises(MapError, match="landmark 1 is at no finite place"):
        abstract([replace(row, cloud_world=np.full((3, 3), np.nan))], embedder, settings)


def best_of_all(body, carriers, settings):
    """What ``best_relation`` is to find, with every anchor looked at."""
    for kind, test in (("on", on), ("in", inside), ("next to", next_to)):
        scores = [(test(body, carrier, settings), i) for i, carrier in enumerate(carriers)]
        known = [(-round(score, 9), i) for score, i in scores if score is not None]
        if known:
            return min(known)[1], kind
    return None


def drawn_points(draws, size_m):
    """A cloud somewhere in 6 x 6 m: a box, or a line, or a single point, with some stray points beside it."""
    size = draws.uniform(0.05, 1.0, 3) * size_m * (draws.random(3) > 0.1)
    points = draws.uniform(0, 6, 3) * (1, 1, 0.05) + draws.uniform(-0.5, 0.5, (int(draws.integers(1, 200)), 3)) * size
    stray = points[: len(points) // 20] + draws.normal(0.0, 0.3, (len(points) // 20, 3))
    return np.concatenate([points, stray])


@pytest.mark.parametrize("next_to_m", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_anchors_that_are_not_looked_at_could_carry_nothing(settings, seed, next_to_m):
    draws = np.random.default_rng(seed)
    loose = settings.model_copy(update={"next_to_m": next_to_m, "on_overlap": 0.05, "in_share": 0.05, "in_enclosed": 0.0})
    carriers = [Carrier.of(Body.of(drawn_points(draws, 1.5), anchor=True), loose) for _ in range(40)]
    bodies = [Body.of(drawn_points(draws, 0.4), anchor=False) for _ in range(150)]
    found = [best_relation(body, carriers, loose) for body in bodies]
    assert found == [best_of_all(body, carriers, loose) for body in bodies]
    assert {kind for _, kind in filter(None, found)} == {"on", "in", "next to"}
    carried = [any(test(body, carrier, loose) is not None for carrier in carriers for test in (on, inside)) for body in bodies]
    assert [is_carried(body, carriers, loose) for body in bodies] == carried
    assert best_relation(bodies[0], [], loose) is None


def test_anchors_that_are_far_off_are_not_looked_at(settings, monkeypatch):
    looked = []
    contains = Region.contains

    def counted(region, xy_world):
        looked.append(region)
        return contains(region, xy_world)

    carriers = [Carrier.of(Body.of(table_points((3.0 * k, 0.0)), anchor=True), settings) for k in range(20)]
    monkeypatch.setattr(Region, "contains", counted)
    assert best_relation(Body.of(thing_points(6.6, 0.4, 0.74), anchor=False), carriers, settings) == (2, "on")
    assert looked == [carriers[2].region]
