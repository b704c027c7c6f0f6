"""What vanishes here and appears there is the same thing, where nothing else fits."""

from dataclasses import replace

import pytest
from living_map import LivingMap

from painted_blocks import FAR_ASIDE_M, Block

CUP, BOOK, LAMP, SHOE = Block("cup", -0.3), Block("book", 0.0), Block("lamp", 0.3), Block("shoe", 0.1, -0.25)
REST = {1: BOOK, 2: LAMP, 3: SHOE}
THERE = replace(CUP, x=-0.15, y=-0.25)
"""Where the cup goes."""


def before(others=None, **life):
    """The things found ten times, the cup as 0."""
    desk = LivingMap(**life)
    desk.see({0: CUP, **REST, **(others or {})}, times=10)
    return desk


def until_lost(desk):
    """The cup is not found, and the camera sees through its place."""
    while ("lost", 0) not in desk.see(REST):
        assert desk.keyframes < 40


def moved(desk):
    return [(event.landmark_id, event.other_id) for event in desk.events if event.kind == "moved"]


def test_a_thing_that_moves_keeps_its_id():
    desk = before()
    desk.see(REST, times=10)
    assert 0 not in desk.objects
    desk.see({7: THERE, **REST}, times=8)
    assert moved(desk) == [(0, 7)]
    assert desk.ids() == [0, 1, 2, 3]
    assert desk.state(0) == "stable"
    assert desk.position(0) == pytest.approx(THERE.p_world, abs=0.01)
    assert desk.objects[0].observations == 10 + 8
    assert desk.objects[0].first_seen_s == 0.0
    assert desk.objects.next_id == 8
    (event,) = [event for event in desk.events if event.kind == "moved"]
    assert event.detail.startswith("cup: from (1.30, ")


def test_also_if_it_is_seen_at_its_new_place_first():
    """The newcomer is stable before the old place is looked at again; the thing is lost then, and moves at once."""
    desk = LivingMap()
    aside = {7: replace(CUP, x=FAR_ASIDE_M)}
    desk.see({}, aside_m=FAR_ASIDE_M, times=6)
    desk.see({0: CUP, **REST}, times=10)
    desk.see(aside, aside_m=FAR_ASIDE_M, times=6)
    assert desk.state(7) == "stable"
    assert moved(desk) == []
    desk.see(REST, times=10)
    assert moved(desk) == [(0, 7)]
    assert desk.ids() == [0, 1, 2, 3]
    assert desk.kinds().index(("stable", 7)) < desk.kinds().index(("lost", 0)) < desk.kinds().index(("moved", 0))
    assert ("removed", 0) not in desk.kinds()
    assert desk.position(0) == pytest.approx(aside[7].p_world, abs=0.01)


def test_it_lives_on_and_may_move_again():
    desk = before()
    desk.see({7: THERE, **REST}, times=12)
    last = replace(CUP, x=0.35, y=-0.25)
    assert desk.see({0: THERE, **REST}, times=6) == []
    desk.see(REST, times=10)
    desk.see({8: last, **REST}, times=8)
    assert moved(desk) == [(0, 7), (0, 8)]
    assert desk.position(0) == pytest.approx(last.p_world, abs=0.01)


def test_what_proves_two_to_be_two_goes_with_it():
    desk = before()
    desk.see({7: THERE, **REST}, times=12)
    assert moved(desk) == [(0, 7)]
    assert desk.objects.times_apart(0, 1) >= 10
    assert desk.objects.times_apart(7, 1) == 0


def test_the_word_of_an_agent_goes_with_it():
    desk = before()
    desk.objects.relabel(0, "mug", desk.objects[0].embedding())
    desk.see({7: replace(THERE, label="mug"), **REST}, times=12)
    assert moved(desk) == [(0, 7)]
    assert desk.objects[0].label == "mug"
    assert desk.objects[0].fixed_label == "mug"


def test_not_while_another_like_it_has_not_been_looked_at_since():
    """Of two cups one is aside, out of view: it might be the one that came here."""
    aside = replace(CUP, x=FAR_ASIDE_M)
    desk = LivingMap()
    desk.see({9: aside}, aside_m=FAR_ASIDE_M, times=10)
    desk.see({0: CUP, **REST}, times=10)
    desk.see(REST, times=10)
    desk.see({7: THERE, **REST}, times=6)
    assert moved(desk) == []
    assert desk.ids() == [1, 2, 3, 7, 9]
    desk.see({9: aside}, aside_m=FAR_ASIDE_M)
    assert moved(desk) == [(0, 7)]
    assert desk.ids() == [0, 1, 2, 3, 9]


def test_but_not_for_ever():
    """One change is likelier than two."""
    desk = LivingMap()
    desk.see({9: replace(CUP, x=FAR_ASIDE_M)}, aside_m=FAR_ASIDE_M, times=10)
    desk.see({0: CUP, **REST}, times=10)
    desk.see(REST, times=10)
    desk.see({7: THERE, **REST}, times=50)
    assert moved(desk) == [(0, 7)]


def test_not_when_two_like_it_vanished():
    other = replace(CUP, x=0.35, y=-0.25)
    desk = before({4: other})
    desk.see(REST, times=12)
    desk.see({7: THERE, **REST}, times=10)
    assert moved(desk) == []
    assert desk.ids() == [1, 2, 3, 7]


def test_not_when_two_like_it_appeared():
    desk = before()
    desk.see(REST, times=12)
    desk.see({7: THERE, 8: replace(CUP, x=0.35, y=-0.25), **REST}, times=10)
    assert moved(desk) == []
    assert desk.ids() == [1, 2, 3, 7, 8]


def test_not_when_the_new_place_was_never_seen_empty():
    """It may have been there all the time."""
    aside = replace(CUP, x=FAR_ASIDE_M)
    desk = before()
    desk.see(REST, times=12)
    desk.see({7: aside}, aside_m=FAR_ASIDE_M, times=10)
    assert moved(desk) == []
    assert desk.state(7) == "stable"
    assert 0 not in desk.objects


def test_not_when_the_new_place_was_hidden_before():
    screen = replace(THERE, label="screen", z=0.9, half_m=0.15)
    desk = LivingMap()
    desk.see({0: CUP, 2: LAMP}, times=10, before=[screen])
    desk.see({2: LAMP}, times=12, before=[screen])
    desk.see({7: THERE, 2: LAMP}, times=10)
    assert moved(desk) == []
    assert desk.ids() == [2, 7]


@pytest.mark.parametrize(
    "newcomer",
    [replace(THERE, half_m=3 * CUP.half_m), replace(THERE, half_m=CUP.half_m / 3), replace(THERE, label="banana")],
    ids=["larger", "smaller", "other label"],
)
def test_not_when_size_or_label_differ(newcomer):
    desk = before()
    desk.see(REST, times=12)
    desk.see({7: newcomer, **REST}, times=10)
    assert moved(desk) == []
    assert desk.ids() == [1, 2, 3, 7]


def test_what_comes_up_again_at_its_own_place_has_not_moved():
    desk = before()
    desk.see(REST, times=10)
    desk.see({7: replace(CUP, x=CUP.x + 0.02), **REST}, times=10)
    assert moved(desk) == []


def test_a_thing_that_was_found_where_it_was_does_not_move():
    desk = before()
    until_lost(desk)
    desk.see({0: CUP, **REST}, times=8)
    assert desk.state(0) == "stable"
    desk.see({0: CUP, 7: THERE, **REST}, times=10)
    assert moved(desk) == []
    assert desk.ids() == [0, 1, 2, 3, 7]


def test_a_lost_thing_that_became_one_with_what_stands_there_does_not_move():
    """What was found at its place is merged with it; then another cup appears elsewhere while this one is out of view."""
    desk = LivingMap(removed_seconds=60.0)
    desk.see({}, aside_m=FAR_ASIDE_M, times=6)
    desk.see({0: CUP, **REST}, times=10)
    until_lost(desk)
    desk.see({5: CUP, **REST}, times=6)
    assert desk.state(5) == "stable"
    desk.smoother.merge(0, 5)
    desk.objects.merge(0, 5)
    assert desk.state(0) == "stable"
    desk.see({0: CUP, **REST}, times=2)
    desk.see({7: replace(CUP, x=FAR_ASIDE_M)}, aside_m=FAR_ASIDE_M, times=50)
    assert moved(desk) == []
    assert desk.ids() == [0, 1, 2, 3, 7]
    assert desk.position(0) == pytest.approx(CUP.p_world, abs=0.02)


def test_a_lost_thing_that_was_merged_into_another_does_not_come_back():
    desk = before(removed_seconds=60.0)
    until_lost(desk)
    desk.see({5: CUP, **REST}, times=6)
    desk.smoother.merge(5, 0)
    desk.objects.merge(5, 0)
    desk.see({7: THERE, **REST}, times=30)
    assert moved(desk) == [(5, 7)] or moved(desk) == []
    assert 0 not in desk.objects


def test_a_lost_thing_that_an_agent_removed_does_not_come_back():
    desk = before()
    until_lost(desk)
    desk.smoother.remove(0)
    desk.objects.forget(0)
    desk.see({7: THERE, **REST}, times=10)
    assert moved(desk) == []
    assert desk.ids() == [1, 2, 3, 7]


def test_two_different_things_that_move_at_once_keep_their_ids():
    desk = before()
    shoe_there = replace(SHOE, x=0.35, y=-0.2)
    rest = {1: BOOK, 2: LAMP}
    desk.see(rest, times=12)
    desk.see({7: THERE, 8: shoe_there, **rest}, times=10)
    assert sorted(moved(desk)) == [(0, 7), (3, 8)]
    assert desk.ids() == [0, 1, 2, 3]
