"""Where to look from, where to stop, and what was seen."""

from itertools import pairwise

import numpy as np
import pytest
from fake_home import CAMERA, Robot, Thing, abstract_map, furniture

from seo_slam.abstraction.horizon import place_on
from seo_slam.navigation.choosing import Option, most_learned
from seo_slam.navigation.coverage import Coverage
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.looking import (
    Eye,
    headings_over,
    hidden_share,
    in_sight,
    legs_to_look,
    nearest_turn,
    places_near,
    shows_its_top,
    viewpoints,
    what_hides,
)
from seo_slam.navigation.outcomes import Candidate
from seo_slam.types import Frame

EYE = Eye.of(Robot().T_world_camera, CAMERA)
MAP = abstract_map(furniture(), [])
ANCHORS = {anchor.id: anchor for anchor in MAP.anchors}
GRID = NavigationGrid(MAP.layout, 0.18)
HIDING = what_hides(MAP.layout, MAP.anchors)
TABLE, COUNTER, DESK, SHELF = 1, 2, 3, 4


def test_the_eye_of_a_camera():
    assert EYE.z_m == pytest.approx(1.3)
    half = np.arctan(119.5 / 266.0)
    assert (EYE.up_rad, EYE.down_rad) == pytest.approx((-0.17 + half, -0.17 - half))
    assert EYE.half_width_rad == pytest.approx(np.arctan(159.5 / 266.0))
    assert EYE.nearest_m(0.4) > EYE.nearest_m(0.9) > EYE.nearest_m(1.3) == 0.0


@pytest.mark.parametrize("anchor_id", [TABLE, COUNTER, DESK, SHELF])
def test_from_a_viewpoint_the_near_edge_of_the_top_is_in_view(anchor_id):
    anchor = ANCHORS[anchor_id]
    robot = Robot((2.0, 2.0))
    place = viewpoints(anchor, EYE, robot.xy, GRID, HIDING)[0]
    assert GRID.same_part(robot.xy, place)
    assert hidden_share(place[None], anchor, HIDING)[0] == 0.0
    robot.xy = place
    robot.yaw_rad = headings_over(anchor, place, EYE)[0]
    nearest = anchor.footprint_world[np.argmin(np.linalg.norm(anchor.footprint_world - place, axis=1))]
    T = robot.T_world_camera
    uv = CAMERA.project(T[:3, :3].T @ (np.array([*nearest, anchor.support_z_m]) - T[:3, 3]))
    assert (uv >= 0).all()
    assert (uv <= [319, 239]).all()


def test_a_place_that_is_seen_anyway_changes_no_viewpoint():
    table, here = ANCHORS[TABLE], np.array([2.0, 2.0])
    at = place_on(np.array([*table.bounds_world[1], table.support_z_m]), np.zeros((0, 3)))
    places = viewpoints(table, EYE, here, GRID, HIDING)
    np.testing.assert_array_equal(viewpoints(table, EYE, here, GRID, HIDING, last_seen=at), places)


def test_what_an_anchor_hides_is_looked_at_from_the_side_where_it_does_not():
    table, here = ANCHORS[TABLE], np.array([2.0, 2.0])
    middle = np.array([*table.xy_world, table.support_z_m])
    for side in (0.0, np.pi):
        away = np.array([np.cos(side), np.sin(side)])
        around = side + np.linspace(-1.4, 1.4, 50)
        back = middle + np.column_stack([-0.3 * np.cos(around), -0.3 * np.sin(around), np.full(50, 0.6)])
        place = viewpoints(table, EYE, here, GRID, HIDING, last_seen=place_on(middle, back))[0]
        assert (place - table.xy_world) @ away > 0


def test_another_view_is_from_another_side():
    first = viewpoints(ANCHORS[TABLE], EYE, np.array([2.0, 2.0]), GRID, HIDING)[0]
    second = viewpoints(ANCHORS[TABLE], EYE, first, GRID, HIDING, [first])[0]
    a, b = first - ANCHORS[TABLE].xy_world, second - ANCHORS[TABLE].xy_world
    assert np.dot(a, b) / np.linalg.norm(a) / np.linalg.norm(b) < np.cos(0.65)


def test_a_path_is_cut_where_furniture_comes_into_sight():
    path = np.array([[0.8, 2.5], [3.5, 2.5], [7.0, 2.5]])
    legs = legs_to_look(path, MAP.anchors, EYE, 2.5, HIDING)
    assert len(legs) > 1
    assert np.linalg.norm(legs[0][-1] - path[0]) > 0.5, "where it stands it has looked around"
    np.testing.assert_allclose([legs[0][0], legs[-1][-1]], path[[0, -1]])
    for one, next_one in pairwise(legs):
        np.testing.assert_allclose(one[-1], next_one[0])
    assert sum(np.linalg.norm(np.diff(leg, axis=0), axis=1).sum() for leg in legs) == pytest.approx(6.2)
    assert any((leg == path[1]).all(axis=1).any() for leg in legs), "its corners are kept"
    seen = {anchor.id for leg in legs for anchor in in_sight(MAP.anchors, leg[-1], EYE, 2.5, HIDING)}
    assert seen == {TABLE, COUNTER, DESK, SHELF}


def test_a_path_is_not_cut_for_what_is_in_sight_at_its_end_or_never_or_for_nothing():
    path = np.array([[5.0, 2.5], [7.0, 2.5]])
    assert {DESK} <= {anchor.id for anchor in in_sight(MAP.anchors, path[-1], EYE, 2.5, HIDING)}
    for anchors in ((), [ANCHORS[DESK]], [ANCHORS[COUNTER]]):
        (leg,) = legs_to_look(path, anchors, EYE, 2.5, HIDING)
        np.testing.assert_allclose(leg[[0, -1]], path)
    (short,) = legs_to_look(path[[0, 0]], MAP.anchors, EYE, 2.5, HIDING)
    np.testing.assert_allclose(short, path[[0, 0]])


def test_what_is_low_is_looked_at_from_farther_off():
    def away(z_m):
        place = viewpoints(ANCHORS[TABLE], EYE, np.array([2.0, 2.0]), GRID, HIDING, z_m=z_m)[0]
        return np.linalg.norm(ANCHORS[TABLE].footprint_world - place, axis=1).min()

    assert away(0.3) > away(None) + 0.3


def test_there_is_no_view_without_free_floor():
    assert (
        viewpoints(
            ANCHORS[DESK], EYE, np.array([2.0, 2.0]), NavigationGrid(abstract_map(furniture(), [], door=False).layout, 0.18), HIDING
        ).size
        == 0
    )


def test_a_wide_thing_takes_several_looks():
    sofa = abstract_map([Thing(9, "shelf", (3.0, 4.5, 0.4), (5.0, 0.6, 0.8))], []).anchors[0]
    headings = headings_over(sofa, np.array([3.0, 3.2]), EYE)
    assert len(headings) > 1
    to = sofa.footprint_world - [3.0, 3.2]
    bearing = np.arctan2(to[:, 1], to[:, 0])
    off = np.abs((bearing[:, None] - np.array(headings) + np.pi) % (2 * np.pi) - np.pi)
    assert (off.min(axis=1) <= EYE.half_width_rad).all(), "all of it is in one of them"
    assert len(headings_over(ANCHORS[TABLE], np.array([1.5, 1.8]), EYE)) == 1


def test_a_turn_shows_what_is_near_and_behind_no_wall():
    seen = {anchor.id for anchor in in_sight(MAP.anchors, np.array([2.2, 1.5]), EYE, 3.5, HIDING)}
    assert seen == {TABLE, COUNTER}
    assert in_sight(MAP.anchors, np.array([2.2, 1.5]), EYE, 0.5, HIDING) == ()


def test_low_furniture_hides_nothing_and_tall_does():
    tall = abstract_map([*furniture(), Thing(5, "shelf", (2.0, 2.5, 1.0), (0.6, 0.4, 2.0))], [])
    from_m = np.array([[2.3, 1.5]])
    assert hidden_share(from_m, tall.anchors[0], what_hides(tall.layout, tall.anchors))[0] > 0.5
    low = abstract_map([*furniture(), Thing(5, "shelf", (2.0, 2.5, 0.4), (0.6, 0.4, 0.8))], [])
    assert hidden_share(from_m, low.anchors[0], what_hides(low.layout, low.anchors))[0] == 0.0


def test_one_stops_as_near_as_can_be_on_the_near_side_of_a_wall():
    on_table = np.array([1.5, 3.4])
    places = places_near(on_table, 1.5, np.array([1.5, 2.0]), GRID, HIDING)
    nearest = GRID.nearest_free(on_table, 2.0)
    assert np.linalg.norm(places[0] - on_table) < np.linalg.norm(nearest - on_table) + 0.15
    by_wall = np.array([3.85, 1.0])
    assert places_near(by_wall, 1.5, np.array([2.0, 1.0]), GRID, HIDING)[0][0] < 4.0
    on_desk = np.array([7.75, 3.7])
    away = np.linalg.norm(places_near(on_desk, 1.5, np.array([0.8, 2.5]), GRID, HIDING) - on_desk, axis=1)
    assert away[0] < away.min() + 0.02, "as near as it gets, however long the way"
    assert places_near(np.array([-5.0, 0.0]), 1.5, np.array([2.0, 1.0]), GRID, HIDING).shape == (0, 2)


@pytest.mark.parametrize(("size", "shown"), [((1.0, 0.6, 1.9), False), ((1.0, 0.2, 1.7), True), ((1.0, 0.6, 1.2), True)])
def test_nothing_is_seen_on_a_wardrobe_but_on_a_wall_shelf_and_a_dresser_it_is(size, shown):
    thing = Thing(9, "wardrobe", (2.0, 2.0, size[2] / 2), size)
    anchor = abstract_map([thing], []).anchors[0]
    assert shows_its_top(anchor, EYE) is shown


def test_the_nearest_turn():
    assert nearest_turn([1.0, -3.1, 2.0], 3.0) == -3.1


def frame(depth_m=9.0):
    return Frame(0.0, np.zeros((240, 320, 3), np.uint8), np.full((240, 320), depth_m, np.float32), CAMERA)


def test_what_was_seen_is_counted():
    coverage = Coverage(3.5, 2)
    coverage.restart(MAP.anchors)
    robot = Robot((1.5, 1.6), np.pi / 2)
    coverage.add(frame(), robot.T_world_camera)
    assert coverage.seen_share(TABLE) == 0.0, "once is too seldom"
    coverage.add(frame(), robot.T_world_camera)
    assert coverage.seen_share(TABLE) == 1.0
    assert coverage.seen_share(COUNTER) == coverage.seen_share(DESK) == 0.0
    assert coverage.seen_share(77) == 0.0
    coverage.restart(MAP.anchors)
    assert coverage.seen_share(TABLE) == 0.0


@pytest.mark.parametrize("depth_m", [0.0, 0.8])
def test_what_is_hidden_or_has_no_depth_was_not_seen(depth_m):
    coverage = Coverage(3.5, 1)
    coverage.restart(MAP.anchors)
    coverage.add(frame(depth_m), Robot((1.5, 1.6), np.pi / 2).T_world_camera)
    assert coverage.seen_share(TABLE) == 0.0


def test_what_is_new_in_the_map_was_seen():
    coverage = Coverage(3.5, 3)
    coverage.restart(MAP.anchors[:2])
    coverage.follow(MAP.anchors)
    assert [coverage.seen_share(i) for i in (TABLE, COUNTER, DESK, SHELF)] == [0.0, 0.0, 1.0, 1.0]


def option(anchor_id, score=0.0, way_m=2.0, place=None):
    anchor = ANCHORS[anchor_id]
    return Option(Candidate(anchor_id, score, "", False), anchor, anchor.xy_world if place is None else np.array(place), way_m)


def choice(options, seen):
    return most_learned(options, seen, 3.5, 8.0).anchor.id


def test_most_is_learned_where_nobody_looked():
    assert choice([option(TABLE), option(DESK)], {TABLE: 0.9}) == DESK
    assert choice([option(TABLE, 0.5), option(DESK, 0.1)], {}) == TABLE, "what is alike comes first"
    assert choice([option(TABLE, way_m=9.0), option(DESK, way_m=1.0)], {}) == DESK, "then what is near"
    assert choice([option(TABLE), option(COUNTER), option(DESK)], {}) in (TABLE, COUNTER), "two in sight of each other are worth more"
    assert choice([option(TABLE, 0.1), option(DESK, 0.5)], {TABLE: 1.0, DESK: 1.0}) == DESK, "where all was seen the score decides"
