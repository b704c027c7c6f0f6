"""navigation/1: what is a success, why a failure is one, and how trials add up."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.navigation import PROTOCOL, SUCCESS_M, Drive, score_drives, statement, wilson

GOOD = Drive(
    home="apartment 10",
    kind="static",
    strategy="updated",
    number=0,
    query="the cup",
    ending="found",
    attempts=1,
    distance_m=0.7,
    surface_m=0.5,
    in_sight=True,
    believed_m=0.1,
    driven_m=5.0,
    shortest_m=4.0,
    retrieved_object_m=0.1,
    retrieved_anchor_m=1.4,
)


def test_a_robot_that_stops_near_enough_has_succeeded():
    assert GOOD.is_success
    assert GOOD.failure is None
    assert GOOD.path_share == pytest.approx(0.8)
    assert replace(GOOD, distance_m=SUCCESS_M).is_success
    assert not replace(GOOD, distance_m=SUCCESS_M + 1e-6).is_success


def test_standing_near_by_chance_is_no_success():
    assert not replace(GOOD, ending="not_found").is_success


def test_three_attempts_count_only_where_things_moved():
    late = replace(GOOD, attempts=4)
    assert late.is_success
    assert replace(late, kind="in_anchor", attempts=3).is_success
    assert not replace(late, kind="in_anchor").is_success
    assert replace(late, kind="cross_anchor").failure == "attempts exhausted"


@pytest.mark.parametrize(
    ("changes", "failure"),
    [
        ({"distance_m": 3.0, "believed_m": 3.2}, "false match"),
        ({"distance_m": 1.3, "believed_m": 0.2}, "stopped short"),
        ({"distance_m": 3.0, "believed_m": 3.2, "mapped": False}, "not mapped"),
        ({"distance_m": 3.0, "believed_m": 3.2, "mapped": False, "kind": "cross_anchor"}, "false match"),
        ({"ending": "not_found", "believed_m": None}, "attempts exhausted"),
        ({"ending": "not_found", "mapped": False}, "not mapped"),
        ({"ending": "no_path"}, "planning error"),
        ({"ending": "bad_start"}, "planning error"),
        ({"ending": "gave_up"}, "gave up"),
        ({"ending": "empty_map"}, "not mapped"),
        ({"ending": "failed", "error": "KeyError: 3"}, "failed"),
    ],
)
def test_every_failure_has_a_class(changes, failure):
    drive = replace(GOOD, **changes)
    assert drive.failure == failure
    assert drive.path_share == 0.0


def test_a_way_shorter_than_the_shortest_on_the_grid_counts_as_the_shortest():
    assert replace(GOOD, driven_m=3.9).path_share == 1.0
    assert replace(GOOD, driven_m=0.0, shortest_m=0.0).path_share == 1.0


def test_the_table_has_a_row_for_every_kind_and_strategy_and_home():
    drives = [
        GOOD,
        replace(GOOD, number=1, in_sight=False, driven_m=4.0),
        replace(GOOD, number=2, distance_m=3.0, believed_m=3.0, collisions=2),
        replace(GOOD, home="house", distance_m=3.0, believed_m=3.0, retrieved_object_m=4.0),
        replace(GOOD, kind="cross_anchor", ending="not_found", attempts=3, believed_m=None),
        replace(GOOD, kind="cross_anchor", strategy="random", ending="not_found", attempts=3, believed_m=None),
    ]
    table = score_drives(drives)
    assert [(row["kind"], row["strategy"], row["trials"]) for row in table] == [
        ("static", "updated", 4),
        ("cross_anchor", "updated", 1),
        ("cross_anchor", "random", 1),
    ]
    static = table[0]
    assert static["successes"] == 2
    assert static["success_rate"] == 0.5
    assert static["success_in_sight"] == 0.25
    assert static["spl"] == pytest.approx((0.8 + 1.0) / 4)
    assert static["failures"] == {"false match": 2}
    assert static["collided"] == 0.25
    assert static["retrieval_object"] == 0.75
    assert static["retrieval_anchor"] == 0.0
    assert static["homes"]["apartment 10"]["success_rate"] == pytest.approx(2 / 3, abs=1e-4)
    assert static["mean_over_homes"] == pytest.approx(1 / 3, abs=1e-4)
    assert json.loads(json.dumps(table)) == table


def test_a_success_where_no_shortest_way_was_found_went_the_shortest():
    drive = Drive.from_dict(json.loads(json.dumps(replace(GOOD, shortest_m=np.inf).as_dict())))
    assert drive.path_share == 1.0
    assert score_drives([GOOD, drive])[0]["spl"] == pytest.approx(0.9)


def test_retrieval_is_a_share_of_all_trials():
    failed = Drive("apartment 10", "static", "updated", 1, "the cup", "failed", error="KeyError: 3")
    row = score_drives([GOOD, failed, failed, failed])[0]
    assert (row["success_rate"], row["retrieval_object"], row["retrieval_anchor"]) == (0.25, 0.25, 0.0)


def test_retrieval_of_nothing_is_none():
    assert score_drives([replace(GOOD, retrieved_object_m=None)])[0]["retrieval_object"] is None


def test_a_drive_survives_a_json_file():
    never = replace(GOOD, ending="failed", distance_m=np.inf, surface_m=np.inf, shortest_m=np.inf, believed_m=None)
    for drive in (GOOD, never):
        assert Drive.from_dict({**json.loads(json.dumps(drive.as_dict())), "log": []}) == drive
    with pytest.raises(EvaluationError, match="ending"):
        Drive.from_dict({"home": "house", "kind": "static", "strategy": "updated", "number": 0, "query": "cup"})


@given(st.integers(1, 200), st.data())
def test_the_interval_holds_the_share_and_narrows(trials, data):
    won = data.draw(st.integers(0, trials))
    low, high = wilson(won, trials)
    assert 0.0 <= low <= won / trials + 1e-12
    assert won / trials - 1e-12 <= high <= 1.0
    more = wilson(10 * won, 10 * trials)
    assert more[1] - more[0] < high - low


def test_wilsons_interval_is_the_published_one():
    assert wilson(55, 78) == pytest.approx((0.5960, 0.7948), abs=1e-3)
    with pytest.raises(EvaluationError, match="0 of 0"):
        wilson(0, 0)


def test_a_result_says_how_it_was_scored():
    said = statement({"homes": 0}, 0.69, {"numpy": "2"})
    assert said["protocol"] == PROTOCOL == "navigation/1"
    assert (said["radius_m"], said["most_attempts"], said["level"]) == (1.0, 3, 0.69)
