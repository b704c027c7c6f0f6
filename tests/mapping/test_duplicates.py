"""Two landmarks that are one are found, two things that are two are left alone."""

import numpy as np
import pytest
from small_map import AT, SmallMap

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.mapping.duplicates import duplicate_pairs, projected_box

NEAR = np.array([0.0, 0.02, 0.0])
BESIDE = np.array([0.0, 0.13, 0.0])


def pairs(desk, seen_now=None):
    ids, p_world = desk.smoother.positions()
    seen = ids if seen_now is None else np.array(seen_now, dtype=np.int64)
    return duplicate_pairs(desk.objects, ids, p_world, seen, LabelLikelihood(HashedEmbedder()), desk.T, desk.camera)


def separately(*things, keyframes=3, half_m=0.06):
    """A map in which each thing was seen in keyframes of its own, the first one more often."""
    desk = SmallMap()
    for number, (p_world, label) in enumerate(things):
        for _ in range(keyframes + (number == 0)):
            desk.see({number: (p_world, label)}, half_m=half_m)
    return desk


def test_two_on_one_place_are_one_and_the_one_seen_more_often_stays():
    assert pairs(separately((AT, "cup"), (AT + NEAR, "cup"))) == [(0, 1)]
    other = SmallMap()
    other.see({0: (AT, "cup")})
    for _ in range(3):
        other.see({1: (AT + NEAR, "cup")})
    assert pairs(other) == [(1, 0)]


def test_the_older_one_stays_on_a_tie():
    desk = SmallMap()
    for number in (3, 1):
        for _ in range(2):
            desk.see({number: (AT + number * 0.005, "cup")})
    assert pairs(desk) == [(1, 3)]


def test_side_by_side_stay_two():
    assert pairs(separately((AT, "cup"), (AT + BESIDE, "cup"))) == []


def test_seen_apart_three_times_are_two_for_good():
    """Even if their positions drift into one another afterwards."""
    desk = SmallMap()
    for _ in range(3):
        desk.see({0: (AT, "cup"), 1: (AT + BESIDE, "cup")})
    assert desk.objects.times_apart(0, 1) == 3
    for _ in range(12):
        desk.see({0: (AT + BESIDE - NEAR, "cup")})
    ids, p_world = desk.smoother.positions()
    p_world[1] = p_world[0] + NEAR
    arguments = desk.objects, ids, p_world, ids, LabelLikelihood(), desk.T, desk.camera
    assert duplicate_pairs(*arguments) == []
    desk.objects.seen_apart.clear()
    assert duplicate_pairs(*arguments) == [(0, 1)]


def test_boxes_that_overlap_prove_nothing():
    desk = SmallMap()
    for _ in range(5):
        desk.see({0: (AT, "cup"), 1: (AT + NEAR, "cup")})
    assert desk.objects.times_apart(0, 1) == 0
    assert pairs(desk) == [(0, 1)]


def test_another_label_stays():
    assert pairs(separately((AT, "keyboard"), (AT + NEAR, "flower pot"))) == []


def test_an_unnamed_one_is_taken_for_its_neighbour():
    assert pairs(separately((AT, "cup"), (AT + NEAR, None))) == [(0, 1)]


def test_another_size_stays():
    desk = SmallMap()
    for _ in range(4):
        desk.see({0: (AT, "table")}, half_m=0.4)
    for _ in range(3):
        desk.see({1: (AT + NEAR, "table")}, half_m=0.06)
    assert pairs(desk) == []


def test_only_pairs_seen_now_are_looked_at():
    desk = separately((AT, "cup"), (AT + NEAR, "cup"))
    assert pairs(desk, seen_now=[]) == []
    assert pairs(desk, seen_now=[0]) == pairs(desk, seen_now=[1]) == [(0, 1)]


def test_of_three_on_one_place_two_are_merged_at_a_time():
    desk = separately((AT, "cup"), (AT + NEAR, "cup"), (AT - 1.6 * NEAR, "cup"))
    found = pairs(desk)
    assert found == [(0, 1)]
    assert len({i for pair in found for i in pair}) == 2 * len(found)


@pytest.mark.parametrize("count", [0, 1])
def test_fewer_than_two_landmarks_hold_no_pair(count):
    desk = SmallMap()
    if count:
        desk.see({0: (AT, "cup")})
    assert pairs(desk) == []


def test_projected_box_is_around_the_corners():
    desk = SmallMap()
    box = projected_box(AT, np.array([0.1, 0.1, 0.1]), desk.T, desk.camera)
    front = AT - np.array([0.05, 0, 0])
    for dy in (-0.05, 0.05):
        for dz in (-0.05, 0.05):
            p_camera = np.array([-(front[1] + dy), 1.0 - (front[2] + dz), front[0]])
            u, v = desk.camera.project(p_camera)
            assert box[0] - 1e-9 <= u <= box[2] + 1e-9
            assert box[1] - 1e-9 <= v <= box[3] + 1e-9
    assert projected_box(np.array([-1.0, 0, 1.0]), np.full(3, 0.1), desk.T, desk.camera) is None
    assert projected_box(np.array([0.02, 0, 1.0]), np.full(3, 0.1), desk.T, desk.camera) is None
