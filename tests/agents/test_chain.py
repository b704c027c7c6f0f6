"""Fig 3: who is asked about what, and when."""

import pytest
from a_view import ABSTAIN, CONFIRM, DOUBT, REMOVE, RENAME, Scripted, landmark, trio, view

from seo_slam.agents.chain import PAIR_ASKED, Chain


def work(chain):
    """Answer every question until none is left; return (role, keyframe, ids) of each."""
    done = []
    while (query := chain.next()) is not None:
        done.append((query.agent.role, query.view.keyframe_id, query.view.asked))
        chain.answered(query, query.agent.propose(query.view))
    return done


def of(done, role):
    return [ids for found, _, ids in done if found == role]


def test_new_landmarks_are_verified_by_fours_and_described_one_by_one():
    chain = Chain(trio())
    chain.show(view([landmark(i) for i in range(6)]))
    done = work(chain)
    assert of(done, "verification") == [(0, 1, 2, 3), (4, 5)]
    assert of(done, "description") == [(0,), (1,), (2,), (3,), (4,), (5,)]
    assert of(done, "merging") == []  # a metre apart: none could be a double of another
    assert chain.counts.landmarks_done == 6


def test_what_is_known_is_verified_again_in_every_view_and_described_once():
    chain = Chain(trio())
    work_of = []
    for keyframe in range(3):
        chain.show(view([landmark(0)], keyframe))
        work_of.append(work(chain))
    assert [of(done, "verification") for done in work_of] == [[(0,)]] * 3
    assert [of(done, "description") for done in work_of] == [[(0,)], [], []]


def test_a_landmark_that_is_verified_again_passes_the_chain_again():
    chain = Chain(trio())
    done = []
    for keyframe in range(PAIR_ASKED + 2):
        chain.show(view([landmark(0), landmark(1, x_m=0.1), landmark(2)], keyframe))
        work(chain)
        done.append(chain.counts.landmarks_done)
    assert done == [3 * (k + 1) for k in range(PAIR_ASKED + 2)]  # whether the merging agent is asked, or was asked often enough


@pytest.mark.parametrize("missing", ["description", "merging"])
def test_the_chain_ends_without_an_agent_that_is_not_there(missing):
    chain = Chain([agent for agent in trio() if agent.role != missing])
    for keyframe in range(2):
        chain.show(view([landmark(0), landmark(1, x_m=0.1)], keyframe))
        work(chain)
    assert chain.counts.landmarks_done == 4


def test_what_is_judged_nothing_did_not_pass():
    chain = Chain(trio(verify=REMOVE))
    chain.show(view([landmark(0)]))
    work(chain)
    assert chain.counts.landmarks_done == 0


def test_a_landmark_is_asked_about_once_in_a_view_and_version():
    chain = Chain([Scripted("verification", 4)])
    chain.show(view([landmark(0)], 0))
    assert len(work(chain)) == 1
    chain.show(view([landmark(0)], 0))
    assert work(chain) == []
    chain.show(view([landmark(0, version=1)], 0))
    assert len(work(chain)) == 1


def test_what_is_doubted_is_described_anew():
    verify = Scripted("verification", 4, CONFIRM)
    describe = Scripted("description", 1)
    chain = Chain([verify, describe])
    chain.show(view([landmark(0)], 0))
    work(chain)
    verify.answer = DOUBT
    chain.show(view([landmark(0)], 1))
    assert [role for role, _, _ in work(chain)] == ["verification", "description"]


def test_what_is_nothing_is_neither_described_nor_merged():
    chain = Chain(trio(verify=REMOVE))
    chain.show(view([landmark(0), landmark(1, x_m=0.05)]))
    assert {role for role, _, _ in work(chain)} == {"verification"}


def test_an_abstaining_verifier_leads_to_nothing():
    chain = Chain(trio(verify=ABSTAIN))
    chain.show(view([landmark(0)]))
    assert {role for role, _, _ in work(chain)} == {"verification"}


def test_near_ones_that_passed_are_shown_to_the_merging_agent_in_a_few_views():
    chain = Chain(trio())
    found = []
    for keyframe in range(PAIR_ASKED + 2):
        chain.show(view([landmark(0), landmark(1, x_m=0.1), landmark(2)], keyframe))
        found += of(work(chain), "merging")
    assert [sorted(ids) for ids in found] == [[0, 1]] * PAIR_ASKED  # the third is a metre away


def test_at_most_eight_are_merged_in_one_question():
    chain = Chain(trio())
    chain.show(view([landmark(i, x_m=0.05 * i) for i in range(11)]))
    assert max(len(ids) for ids in of(work(chain), "merging")) == 8


def test_without_a_verifier_new_ones_are_described():
    chain = Chain(trio()[1:])
    chain.show(view([landmark(0)]))
    assert [role for role, _, _ in work(chain)] == ["description"]


def test_a_newer_view_takes_the_place_of_an_older_one():
    chain = Chain([Scripted("verification", 4)])
    chain.show(view([landmark(0), landmark(1)], 0))
    chain.show(view([landmark(0), landmark(2)], 1))
    asked = {(keyframe, ids) for _, keyframe, ids in work(chain)}
    assert asked == {(0, (1,)), (1, (0, 2))}  # what the newer view does not show is still asked of the older one
    assert chain.counts.superseded == 1


def test_new_ones_come_first_then_what_was_verified_longest_ago():
    chain = Chain([Scripted("verification", 1)])
    chain.show(view([landmark(0)], 0))
    work(chain)
    chain.show(view([landmark(1)], 1))
    work(chain)
    chain.show(view([landmark(i) for i in range(4)], 2))
    assert of(work(chain), "verification") == [(2,), (3,), (0,), (1,)]


def test_the_queue_is_bounded_and_the_oldest_views_go():
    chain = Chain([Scripted("verification", 1)], most_waiting=3)
    chain.show(view([landmark(i) for i in range(3)], 0))
    chain.show(view([landmark(i) for i in range(10, 12)], 1))
    assert chain.waiting == 3
    assert chain.counts.dropped == 2
    assert {keyframe for _, keyframe, _ in work(chain)} == {0, 1}


def test_an_agent_that_stopped_is_asked_no_more():
    verify, describe, merge = trio()
    chain = Chain([verify, describe, merge])
    chain.show(view([landmark(0)]))
    chain.stop_asking(verify)
    assert work(chain) == []
    chain.show(view([landmark(0)], 1))
    assert [role for role, _, _ in work(chain)] == ["description"]


def test_labels_given_so_far_are_shown_to_the_next_question():
    chain = Chain(trio())
    chain.show(view([landmark(0), landmark(1)]))
    known = []
    while (query := chain.next()) is not None:
        known.append((query.agent.role, query.view.known_labels))
        chain.answered(query, query.agent.propose(query.view))
    assert known[1:] == [("description", ()), ("description", ("red thing 0",))]


def test_who_was_not_described_is_asked_about_again_though_verification_is_silent():
    verify, describe, merge = trio()
    chain = Chain([verify, describe, merge])
    describe.answer = ABSTAIN
    chain.show(view([landmark(0)], 0))
    work(chain)
    verify.answer, describe.answer = ABSTAIN, RENAME
    chain.show(view([landmark(0)], 1))
    assert "description" in [role for role, _, _ in work(chain)]
    chain.show(view([landmark(0)], 2))
    assert "description" not in [role for role, _, _ in work(chain)]


def test_who_has_no_answer_does_not_keep_new_ones_waiting():
    verify, describe, _ = trio(describe=ABSTAIN)
    chain = Chain([verify, describe])
    chain.show(view([landmark(0)], 0))
    work(chain)
    chain.show(view([landmark(0), landmark(1)], 1))
    assert [(role, ids) for role, _, ids in work(chain)][:2] == [("verification", (1, 0)), ("description", (1,))]


def test_a_witness_that_confirms_nothing_does_not_stand_for_a_judge_that_stopped():
    judge, describe, _ = trio()
    witness = Scripted("verification", 4, ABSTAIN)
    witness.confirms = False
    chain = Chain([judge, describe, witness])
    chain.stop_asking(judge)
    chain.show(view([landmark(0)], 0))
    assert of(work(chain), "description") == [(0,)]


def test_what_left_the_map_is_forgotten():
    chain = Chain(trio())
    for keyframe in range(80):
        chain.show(view([landmark(10 * keyframe + k) for k in range(10)], keyframe))
        work(chain)
    assert len(chain._progress) < 700
    assert len(chain._asked) < 2100


@pytest.mark.parametrize("count", [0, 1, 5])
def test_an_agent_of_any_role_sees_every_view_whole(count):
    agent = Scripted("any")
    chain = Chain([agent])
    chain.show(view([landmark(i) for i in range(count)], 0))
    chain.show(view([landmark(i) for i in range(count)], 1))
    assert work(chain) == [("any", 1, ())]
