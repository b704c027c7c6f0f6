"""Trials: what is asked for is there, can be reached, was moved as it says, and is the same in every run."""

import json
from functools import cache

import numpy as np
import pytest
from driven_homes import apartment

from seo_slam.driving.trials import START_AWAY_M, Trial, bearing, make_trials, phrase
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.evaluation.navigation import SUCCESS_M
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.shortest import ShortestWays

COUNTS = {"static": 26, "in_anchor": 2, "cross_anchor": 2}


@cache
def trials(kind):
    made = make_trials(apartment(), kind, COUNTS[kind], seed=1)
    assert len(made) == COUNTS[kind]  # so that no test loops over nothing
    return made


@pytest.mark.parametrize("kind", COUNTS)
def test_what_is_asked_for_can_be_reached_from_the_start(kind):
    home = apartment()
    ways = ShortestWays(home.free)
    for trial in trials(kind):
        world = trial.world(home.world)
        lengths_m = ways.lengths_m(np.array(trial.start_xy))
        nearest_m = [lengths_m[ways.within(world.thing(i).p_world, SUCCESS_M)].min(initial=np.inf) for i in trial.target_ids]
        assert np.isfinite(min(nearest_m)), trial
        away_m = [np.linalg.norm(world.thing(i).p_world[:2] - trial.start_xy) for i in trial.target_ids]
        assert min(away_m) >= START_AWAY_M, trial


def test_static_trials_ask_for_every_word_before_one_comes_again():
    home = apartment()
    words = {thing.label for thing in home.world.things if thing.kind != "fixed"}
    asked = [home.world.thing(trial.target_ids[0]) for trial in trials("static")]
    assert all(trial.moved == () for trial in trials("static"))
    assert {thing.kind for thing in asked} == {"volatile", "anchor"}
    labels = [tuple(trial.target_ids) for trial in trials("static")]
    assert len(set(labels)) >= min(len(labels), len(words)) - 1  # one word may mean the same things as another


def test_any_thing_that_has_the_word_counts():
    home = apartment()
    for trial in trials("static"):
        word = trial.query.removeprefix("the ").removeprefix("an ").removeprefix("a ")
        assert trial.target_ids == tuple(sorted(thing.id for thing in bearing(home.world, word)))


@pytest.mark.parametrize("kind", ["in_anchor", "cross_anchor"])
def test_what_is_asked_for_was_moved_as_the_kind_says(kind):
    home = apartment()
    before = anchors_of(home.world)
    for trial in trials(kind):
        (target,) = trial.target_ids
        assert target in [thing_id for thing_id, _ in trial.moved]
        assert len(bearing(home.world, home.world.thing(target).label)) == 1
        after = anchors_of(trial.world(home.world))
        for thing_id, _ in trial.moved:
            assert after[thing_id] is not None
            assert (after[thing_id] == before[thing_id]) == (kind == "in_anchor")
        others = {thing.id for thing in home.world.things} - {thing_id for thing_id, _ in trial.moved}
        world = trial.world(home.world)
        assert all(np.array_equal(world.thing(i).T_world_thing, home.world.thing(i).T_world_thing) for i in others)


def test_a_trial_survives_a_json_file():
    for kind in COUNTS:
        for trial in trials(kind):
            assert Trial.from_dict(json.loads(json.dumps(trial.as_dict()))) == trial


def test_fewer_trials_are_the_first_of_more_and_another_seed_gives_others():
    assert make_trials(apartment(), "static", 5, seed=1) == trials("static")[:5]
    assert make_trials(apartment(), "cross_anchor", 1, seed=1) == trials("cross_anchor")[:1]
    assert make_trials(apartment(), "static", 5, seed=2) != trials("static")[:5]


@pytest.mark.parametrize(
    ("word", "form", "said"),
    [("cup", 0, "cup"), ("cup", 1, "the cup"), ("apple", 2, "an apple"), ("scissors", 2, "the scissors"), ("glass", 2, "a glass")],
)
def test_queries_are_english(word, form, said):
    assert phrase(word, form) == said


def test_bad_trials_are_refused():
    with pytest.raises(ConfigError, match="'sideways'"):
        make_trials(apartment(), "sideways", 1)
    with pytest.raises(ConfigError, match="-1"):
        make_trials(apartment(), "static", -1)
    good = trials("static")[0].as_dict()
    for wrong in ({**good, "kind": "x"}, {**good, "moved": [[1, [1.0]]]}, {"kind": "static"}):
        with pytest.raises(DatasetError, match="trial"):
            Trial.from_dict(wrong)
