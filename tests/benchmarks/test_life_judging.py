"""A cup leaves its place at 10 s, a keyframe a second; what is left at its old place, where it goes, and who takes its id."""

from dataclasses import replace

import numpy as np
import pytest
from life_judging import Left, judge_ghost, judge_hidden, judge_moved, judge_stayed, taken_ids
from life_watch import Known, Moment, Seen, TrueMoment, heir_of, owners_of

from seo_slam.evaluation.true_objects import TruthObject
from seo_slam.records import MapEvent

CHANGE_S = 10.0
RADIUS_M = 0.2
SMALLEST_PX = 15.0
IN_VIEW = Seen(200, 220, True)
HIDDEN = Seen(20, 220, True)


def thing(number, x, label="cup"):
    return TruthObject(str(number), (label,), np.array([[x, 0.0, 0.0]]))


def known(x, state="stable", label="cup"):
    return Known(label, np.array([x, 0.0, 0.0]), state, 0.9)


def moment(stamp_s, things, landmarks, seen=None, open_places=(), hits=(), events=()):
    seen = {int(item.id): IN_VIEW for item in things} if seen is None else seen
    owners = owners_of(landmarks, things, RADIUS_M)
    return Moment(TrueMoment(stamp_s, tuple(things), seen, frozenset(open_places)), landmarks, owners, frozenset(hits), tuple(events))


def cup_leaves(later_things, later_landmarks, seconds=12, events=(), open_places=(0,)):
    """Ten keyframes with the cup (thing 1, landmark 7) at 0 and a bowl (2, 8) at 1 m; then what is given."""
    start = [moment(float(t), [thing(1, 0.0), thing(2, 1.0, "bowl")], {7: known(0.02), 8: known(1.0, label="bowl")}) for t in range(10)]
    end = [moment(CHANGE_S + t, later_things, later_landmarks, open_places=open_places) for t in range(seconds)]
    if events:
        end[0] = replace(end[0], events=tuple(events))
    return start + end


REMOVED = Left(0, CHANGE_S, "removed", thing(1, 0.0))
MOVED = Left(0, CHANGE_S, "moved", thing(1, 0.0))
BOWL = thing(2, 1.0, "bowl")


def test_a_landmark_that_stays_where_its_thing_was_is_a_ghost():
    case = judge_ghost(cup_leaves([BOWL], {7: known(0.02), 8: known(1.0)}), REMOVED, RADIUS_M)
    assert (case["verdict"], case["landmark"], case["views"], case["gone_after_s"]) == ("ghost", 7, 10, None)
    assert [row["landmark"] for row in case["standing"]] == [7]


@pytest.mark.parametrize("landmarks", [{8: known(1.0)}, {7: known(0.02, "lost"), 8: known(1.0)}, {7: known(0.5), 8: known(1.0)}])
def test_it_is_gone_once_out_of_the_map_lost_or_elsewhere(landmarks):
    case = judge_ghost(cup_leaves([BOWL], landmarks), REMOVED, RADIUS_M)
    assert (case["verdict"], case["gone_after_s"], case["taken_over_by"]) == ("gone", 0.0, None)


def test_a_second_landmark_of_the_thing_is_a_ghost_too():
    assert judge_ghost(cup_leaves([BOWL], {8: known(1.0), 9: known(-0.1)}), REMOVED, RADIUS_M)["verdict"] == "ghost"


def test_a_second_landmark_of_a_thing_close_by_is_none():
    close = thing(3, 0.15)
    landmarks = {8: known(1.0), 9: known(0.15), 10: known(0.12)}
    assert judge_ghost(cup_leaves([BOWL, close], landmarks), REMOVED, RADIUS_M)["verdict"] == "gone"


def test_the_old_landmark_may_stand_for_another_thing_now():
    case = judge_ghost(cup_leaves([BOWL, thing(3, 0.1)], {7: known(0.02), 8: known(1.0)}), REMOVED, RADIUS_M)
    assert (case["verdict"], case["taken_over_by"]) == ("gone", 3)


@pytest.mark.parametrize(("seconds", "views"), [(9, (0,)), (12, ())])
def test_nothing_is_judged_before_ten_views_of_the_old_place(seconds, views):
    case = judge_ghost(cup_leaves([BOWL], {7: known(0.02)}, seconds, open_places=views), REMOVED, RADIUS_M)
    assert case["verdict"] == "undecided"


def test_nor_before_five_seconds():
    fast = [moment(CHANGE_S + t / 10, [BOWL], {8: known(1.0), **({7: known(0.0)} if t < 45 else {})}, open_places=[0]) for t in range(52)]
    case = judge_ghost(cup_leaves([BOWL], {}, 0) + fast, REMOVED, RADIUS_M)
    assert (case["verdict"], case["seconds"], case["views"], case["gone_after_s"]) == ("gone", 5.0, 51, 4.5)


def test_what_was_never_mapped_is_no_case():
    nothing = [moment(float(t), [thing(1, 0.0)], {}) for t in range(10)]
    assert judge_ghost(nothing, REMOVED, RADIUS_M)["verdict"] == "not_mapped"
    assert judge_moved(nothing, MOVED, SMALLEST_PX)["verdict"] == "not_mapped"


def test_a_moved_thing_keeps_its_id_gets_another_or_is_not_mapped_again():
    now = [thing(1, 3.0), BOWL]
    for landmarks, verdict in (
        ({7: known(3.0), 8: known(1.0)}, "kept"),
        ({7: known(0.0), 9: known(3.0)}, "other_id"),
        ({7: known(0.0), 8: known(1.0)}, "not_mapped_again"),
    ):
        assert judge_moved(cup_leaves(now, landmarks), MOVED, SMALLEST_PX)["verdict"] == verdict
    assert judge_moved(cup_leaves(now, {7: known(3.0)}, seconds=4), MOVED, SMALLEST_PX)["verdict"] == "not_seen_again"


def test_the_id_is_followed_through_mergers_and_moves():
    now, merged, moved = [thing(1, 3.0), BOWL], MapEvent("merged", 7, other_id=4), MapEvent("moved", 7, other_id=9)
    assert judge_moved(cup_leaves(now, {4: known(3.0)}, events=[merged]), MOVED, SMALLEST_PX)["verdict"] == "kept"
    assert heir_of(7, [merged, MapEvent("merged", 4, other_id=2)]) == 2
    assert heir_of(9, [moved]) == 7
    assert heir_of(7, [moved, MapEvent("removed", 4)]) == 7


def test_ids_of_others_are_found():
    now = [thing(1, 3.0), BOWL]
    own, others = taken_ids(cup_leaves(now, {8: known(3.0), 7: known(1.0)}), CHANGE_S, {1}, set())
    assert [(case["thing"], case["stood_for"]) for case in own] == [(1, 2)]
    assert [(case["thing"], case["stood_for"]) for case in others] == [(2, 1)]
    assert taken_ids(cup_leaves(now, {7: known(3.0), 8: known(1.0)}), CHANGE_S, {1}, set()) == ([], [])


def hidden_for(keyframes, last_landmarks, events=()):
    shown = [moment(float(t), [BOWL], {8: known(1.0)}) for t in range(5)]
    behind = [moment(5.0 + t, [BOWL], {8: known(1.0)}, {2: HIDDEN}) for t in range(keyframes)]
    return [*shown, *behind, moment(40.0, [BOWL], last_landmarks, events=events)]


def test_a_hidden_thing_should_keep_its_landmark():
    assert judge_hidden(hidden_for(5, {8: known(1.0)}), BOWL, SMALLEST_PX)["verdict"] == "kept"
    assert judge_hidden(hidden_for(5, {8: known(1.0, "lost")}), BOWL, SMALLEST_PX)["verdict"] == "lost"
    gone = judge_hidden(hidden_for(5, {9: known(1.1)}, [MapEvent("removed", 8)]), BOWL, SMALLEST_PX)
    assert (gone["verdict"], gone["another_stands_for_it"], gone["hidden_keyframes"]) == ("removed", 9, 5)
    merged = [MapEvent("merged", 8, other_id=3), MapEvent("removed", 3)]
    assert judge_hidden(hidden_for(5, {}, merged), BOWL, SMALLEST_PX)["verdict"] == "removed"
    assert judge_hidden(hidden_for(5, {3: known(1.0)}, merged[:1]), BOWL, SMALLEST_PX)["verdict"] == "kept"


def test_only_things_mapped_and_hidden_long_enough_count():
    assert judge_hidden(hidden_for(4, {8: known(1.0)}), BOWL, SMALLEST_PX) is None
    assert judge_stayed(hidden_for(4, {8: known(1.0)}), BOWL)["verdict"] == "kept"
    never = [moment(float(t), [BOWL], {}, {2: HIDDEN}) for t in range(9)]
    assert judge_hidden(never, BOWL, SMALLEST_PX) is None
    assert judge_stayed(never, BOWL) is None
