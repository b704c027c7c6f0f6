import pytest
from local_scenes import evidence, landmark, put, surface_of, view_of, wall

from seo_slam.agents.local_verification import LOOKS_A_SIDE, LocalVerification
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.errors import ConfigError
from seo_slam.records import Confirm, Doubt, Remove
from seo_slam.registry import create
from seo_slam.testing import check_agent


def seen(agent, scene, times=3, **options):
    return [edit for k in range(times) for edit in agent.propose(view_of(*scene(k), keyframe=k, **options))]


def test_a_bare_wall_is_proposed_for_removal_not_at_the_first_look():
    agent = LocalVerification()
    assert seen(agent, wall, 1) == []
    assert {type(edit) for edit in seen(agent, wall, 2)} == {Remove}


@pytest.mark.parametrize("what", [{"nearer_m": 0.05}, {"colour": (40, 60, 160)}, {"nearer_m": 0.1, "colour": (20, 20, 20)}])
def test_what_stands_out_is_confirmed_once(what):
    edits = seen(LocalVerification(), lambda k: put(*wall(k), **what), 8)
    assert [type(edit) for edit in edits] == [Confirm]


def test_what_once_stood_out_is_never_removed():
    agent = LocalVerification()
    seen(agent, lambda k: put(*wall(k), nearer_m=0.1), 4)
    assert not [edit for edit in seen(agent, wall, 20) if isinstance(edit, Remove)]


def test_a_witness_denies_and_confirms_nothing():
    assert seen(LocalVerification(confirms=False), lambda k: put(*wall(k), nearer_m=0.1), 8) == []
    assert {type(edit) for edit in seen(LocalVerification(confirms=False), wall, 8)} == {Remove}


def test_looks_are_bounded_in_a_view_and_from_a_side():
    agent = LocalVerification(looks_a_view=2)
    rows = [landmark(i) for i in range(1, 6)]
    for k in range(3 * LOOKS_A_SIDE):
        agent.propose(view_of(*wall(k), rows=rows, keyframe=k))
    assert [sum(looks.tried.values()) for looks in agent._looks.values()] == [LOOKS_A_SIDE] * 5


def test_a_newcomer_where_nothing_was_found_is_judged_by_that():
    agent = LocalVerification()
    seen(agent, wall, 3)
    again = agent.propose(view_of(*wall(7), rows=[landmark(9, at=[0.03, 0.0, 2.0])], keyframe=9))
    assert [type(edit) for edit in again] == [Remove]


def test_a_landmark_that_moved_is_looked_at_anew():
    agent = LocalVerification()
    seen(agent, wall, 3)
    assert agent.propose(view_of(*wall(5), rows=[landmark(1, at=[0.6, 0.0, 2.0])], keyframe=9)) == []


def test_a_word_that_the_detector_no_longer_says_is_doubted():
    rgb, depth_m = put(*wall(), nearer_m=0.1)
    agent = LocalVerification(likelihood=LabelLikelihood())
    given = {1: evidence(surface_of(depth_m), {"cup": 2.0, "vase": 9.0})}
    edits = agent.propose(view_of(rgb, depth_m, rows=[landmark(1, "red cup", category="cup")], evidences=given))
    assert [type(edit) for edit in edits] == [Doubt]


def test_memory_is_bounded_and_answers_are_the_same_twice():
    agent = LocalVerification(most_remembered=3)
    for k in range(1, 9):
        agent.propose(view_of(*wall(k), rows=[landmark(k, at=[k, 0, 2.0])], keyframe=k))
    assert len(agent._looks) == 3
    assert seen(LocalVerification(), wall, 5) == seen(LocalVerification(), wall, 5)


def test_contract_and_options():
    check_agent(create("agent", "local_verification"))
    with pytest.raises(ConfigError, match="above 0"):
        LocalVerification(looks_a_view=0)


@pytest.mark.parametrize("label", ["poster", "table", "x"])
def test_the_place_is_what_counts_not_its_label(label):
    edits = seen(LocalVerification(), wall, rows=[landmark(1, label)])
    assert [type(edit) for edit in edits] == [Remove, Remove]
