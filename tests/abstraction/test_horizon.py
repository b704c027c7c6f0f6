"""What an anchor hides of a place on it."""

import numpy as np
import pytest
from boxes_of_points import chair_points, on_box, table_points

from seo_slam.abstraction.abstract_map import Place
from seo_slam.abstraction.horizon import SECTORS, place_on, shows

SEAT = np.array([0.22, 0.1, 0.5])  # on a chair whose back is at high y, up to 0.9 m


def seen_from(place, x, y, z=1.0):
    return bool(shows(place, np.array([[x, y]]), z)[0])


def test_what_is_on_a_chair_is_seen_from_the_front_and_not_from_behind_its_back():
    place = place_on(SEAT, chair_points())
    assert seen_from(place, 0.22, -1.5)
    assert seen_from(place, -1.5, 0.0)
    assert not seen_from(place, 0.22, 2.0)


def test_from_high_up_or_from_near_one_sees_over_the_back():
    place = place_on(SEAT, chair_points())
    assert seen_from(place, 0.22, 2.0, z=3.0)
    assert seen_from(place, 0.22, 0.6, z=1.3)


def test_a_table_hides_nothing_that_stands_on_it_but_all_that_lies_below():
    around = [(0.6 + 2.0 * np.cos(a), 0.4 + 2.0 * np.sin(a)) for a in np.arange(12) * np.pi / 6]
    on_top = place_on(np.array([0.6, 0.4, 0.8]), table_points())
    assert all(seen_from(on_top, *xy) for xy in around)
    below = place_on(np.array([0.6, 0.4, 0.1]), table_points())
    assert not any(seen_from(below, *xy) for xy in around)


def test_the_thing_s_own_points_in_the_cloud_of_its_anchor_hide_nothing():
    stray = on_box((0.55, 0.35, 0.74), (0.65, 0.45, 0.95))
    place = place_on(np.array([0.6, 0.4, 0.8]), np.concatenate([table_points(), stray]))
    assert seen_from(place, 3.0, 0.4)


def test_with_no_points_around_it_is_seen_from_everywhere():
    place = place_on(SEAT, np.zeros((0, 3)))
    assert place.horizon.shape == (SECTORS,)
    assert all(seen_from(place, x, y, z=0.3) for x, y in ((2, 0), (0, 2), (-2, 0), (0, -2)))


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_it_turns_with_the_anchor(turn):
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    place = place_on(R @ SEAT, chair_points() @ R.T)
    assert seen_from(place, *(R @ [0.22, -1.5, 0])[:2])
    assert not seen_from(place, *(R @ [0.22, 2.0, 0])[:2])


def test_a_horizon_of_a_file_may_have_another_number_of_directions():
    place = Place(SEAT, np.array([-10.0, -10.0, 5.0, 5.0]))  # south-west, south-east, north-east, north-west
    assert [seen_from(place, *xy) for xy in ((-2, -2), (2, -2), (2, 2), (-2, 2))] == [True, True, False, False]
