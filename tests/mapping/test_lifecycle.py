"""Things that are taken away leave the map; those that are hidden, or seldom found, do not."""

import numpy as np
import pytest
from living_map import LivingMap

from painted_blocks import FAR_ASIDE_M, Block
from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.config import LifeSettings, MapSettings
from seo_slam.mapping.lifecycle import SightingsOnly
from seo_slam.mapping.object_map import ObjectMap

CUP, BOOK, LAMP, SHOE = Block("cup", -0.3), Block("book", 0.0), Block("lamp", 0.3), Block("shoe", 0.1, -0.25)
DESK = {0: CUP, 1: BOOK, 2: LAMP, 3: SHOE}


def without(*ids, of=None):
    return {i: block for i, block in (DESK if of is None else of).items() if i not in ids}


@pytest.fixture
def desk():
    """Four things, each found in eight keyframes."""
    made = LivingMap()
    made.see(DESK, times=8)
    assert {made.state(i) for i in DESK} == {"stable"}
    return made


def test_what_is_found_again_and_again_becomes_stable_once():
    desk = LivingMap()
    assert desk.see(DESK) == []
    assert desk.state(0) == "tentative"
    assert sorted(desk.see(DESK, times=10)) == [("stable", i) for i in DESK]
    assert desk.objects[0].existence > 0.9


def test_what_is_taken_away_is_lost_and_then_removed(desk):
    happened = desk.see(without(0), times=12)
    assert happened == [("lost", 0), ("removed", 0)]
    assert desk.ids() == [1, 2, 3]


def test_lost_is_not_yet_removed_and_says_so_in_its_state_and_version(desk):
    version = desk.objects[0].version
    happened = []
    while not happened:
        happened = desk.see(without(0))
    assert happened == [("lost", 0)]
    assert (desk.state(0), desk.objects[0].version) == ("lost", version + 1)
    assert desk.objects[0].existence < LifeSettings().lost_existence
    assert desk.keyframes < 8 + 8


def test_a_lost_thing_that_is_seen_again_is_found(desk):
    while ("lost", 0) not in desk.see(without(0)):
        assert desk.keyframes < 30
    happened = desk.see(DESK, times=6)
    assert happened == [("found", 0)]
    assert (desk.ids(), desk.state(0)) == ([0, 1, 2, 3], "stable")


def test_what_stands_behind_something_else_stays(desk):
    screen = Block("screen", CUP.x, CUP.y, 0.9, 0.12)
    assert desk.see(without(0), there=DESK, before=[screen], times=40) == []
    assert desk.state(0) == "stable"
    assert desk.objects[0].existence > 0.9


def test_what_is_out_of_view_stays(desk):
    assert desk.see({}, aside_m=FAR_ASIDE_M, times=40) == []
    assert desk.ids() == [0, 1, 2, 3]


def test_an_image_without_depth_tells_nothing(desk):
    existence = desk.objects[0].existence
    assert desk.see({}, wall_m=0.0, times=20) == []
    assert desk.ids() == [0, 1, 2, 3]
    assert desk.objects[0].existence == existence


def test_what_the_detector_misses_but_the_camera_sees_goes_later_than_what_it_sees_through():
    def keyframes_until_lost(there):
        desk = LivingMap()
        desk.see(DESK, times=8)
        for count in range(1, 60):
            if ("lost", 0) in desk.see(without(0), there=there):
                return count
        return 60

    assert keyframes_until_lost(without(0)) < keyframes_until_lost(DESK)


def test_a_mistake_that_comes_back_now_and_then_leaves_the_map(desk):
    """Nothing stands at the place of 9, the camera sees the wall behind it; one view in five has a box there."""
    phantom = {9: Block("vase", -0.1, -0.25)}
    for _ in range(10):
        desk.see(DESK | phantom, there=DESK)
        desk.see(DESK, times=4)
        if 9 not in desk.objects:
            break
    assert desk.ids() == [0, 1, 2, 3]
    assert ("removed", 9) in desk.kinds()
    assert {desk.state(i) for i in DESK} == {"stable"}


def test_a_thing_that_is_found_in_one_view_of_three_among_such_things_stays():
    desk = LivingMap()
    for k in range(60):
        desk.see({i: DESK[i] for i in DESK if (k + i) % 3 == 0}, there=DESK)
    assert desk.ids() == [0, 1, 2, 3]
    assert "removed" not in dict(desk.kinds())


def test_a_place_is_remembered():
    """What comes up again where a landmark was removed is judged by all that was seen there."""
    again = Block("cup", CUP.x + 0.01)
    desk = LivingMap()
    desk.see(DESK, times=8)
    desk.see(without(0), times=12)
    assert 0 not in desk.objects
    desk.see(without(0) | {7: again})
    sightings = desk.objects[7].sightings
    assert sightings.hits > 5
    assert sightings.misses > 2
    elsewhere = LivingMap()
    elsewhere.see(DESK, times=8)
    elsewhere.see(without(0), times=12)
    elsewhere.see(without(0) | {7: Block("cup", -0.1, -0.25)})
    assert elsewhere.objects[7].sightings.hits <= 1


def test_what_was_never_confirmed_leaves_no_memory(desk):
    desk.see(DESK | {9: Block("vase", -0.1, -0.25)}, there=DESK)
    desk.see(DESK, times=12)
    assert 9 not in desk.objects
    desk.see(DESK | {10: Block("vase", -0.1, -0.25)}, there=DESK)
    assert desk.objects[10].sightings.misses == 0


def test_nothing_is_removed_before_its_time():
    desk = LivingMap(removed_seconds=30.0)
    desk.see(DESK, times=8)
    assert desk.see(without(0), times=20) == [("lost", 0)]
    assert desk.see(without(0), times=60) == [("removed", 0)]
    patient = LivingMap(removed_misses=50)
    patient.see(DESK, times=8)
    assert patient.see(without(0), times=40) == [("lost", 0)]


def test_of_a_map_that_is_continued_only_what_is_gone_goes(desk):
    again = LivingMap(old=desk.objects.rows(desk.smoother))
    again.see(without(0), times=12)
    assert again.ids() == [1, 2, 3]
    assert {again.state(i) for i in again.ids()} == {"stable"}
    assert [i for kind, i in again.kinds() if kind == "removed"] == [0]


def test_what_was_in_view_when_two_became_one_counts_once():
    """Of two halves of one thing, each found in every second view, the whole was found in all."""
    desk = LivingMap()
    for k in range(12):
        desk.see({k % 2: CUP, 2: LAMP}, there={0: CUP, 2: LAMP})
    halves = [desk.objects[i].sightings for i in (0, 1)]
    assert min(half.misses + half.tail for half in halves) >= 4
    desk.smoother.merge(0, 1)
    desk.objects.merge(0, 1)
    whole = desk.objects[0].sightings
    assert whole.hits + whole.misses <= 12
    assert whole.hits > max(half.hits for half in halves)


def test_the_papers_variants_only_count_sightings():
    objects, smoother = ObjectMap(MapSettings(), 8), GtsamSmoother()
    merged_away = np.array([5])
    assert SightingsOnly(objects).step(None, merged_away, smoother) == []
    desk = LivingMap()
    desk.life = SightingsOnly(desk.objects)
    desk.see(DESK, times=4)
    assert desk.see(without(0), times=40) == []
    assert {desk.state(i) for i in desk.ids()} == {"stable"}
    assert desk.ids() == [0, 1, 2, 3]
