"""The rails: what one verdict does, what a second does, and what no number of them may do."""

import numpy as np
import pytest
from judged_map import AT, JudgedMap, aside, beside

from seo_slam.config import EditSettings
from seo_slam.records import Confirm, Doubt, MapEvent, Merge, Relabel, Remove

ALL_ROUND = [beside(angle) for angle in range(0, 360, 45)]


def kinds(judged):
    return [(record.kind, record.outcome) for record in judged.records]


def test_one_denial_of_what_is_well_seen_is_noted_and_others_from_other_sides_remove():
    room = JudgedMap()
    assert room.outcome(room.remove(), camera=ALL_ROUND[0]) == "noted"
    assert room.ids() == [0]
    outcomes = []
    for camera in ALL_ROUND[1:]:
        outcomes.append(room.outcome(room.remove(), camera=camera))
        if outcomes[-1] == "applied":
            break
    assert outcomes[-1] == "applied"
    assert room.ids() == []


def test_however_often_it_is_said_of_one_view_that_is_one_denial():
    room = JudgedMap(times=20)
    assert {room.outcome(room.remove(), view=1, camera=ALL_ROUND[0]) for _ in range(20)} == {"noted"}
    assert room.ids() == [0]


def test_confirmations_stand_against_denials():
    room = JudgedMap()
    for camera in ALL_ROUND[:4]:
        room.propose(room.confirm(), camera=camera)
    for camera in ALL_ROUND[4:6]:
        assert room.outcome(room.remove(), camera=camera) == "noted"


def test_where_the_sightings_are_against_it_too_one_denial_removes():
    room = JudgedMap()
    room.objects[0].existence = 0.35
    judged = room.propose(room.remove(), camera=ALL_ROUND[0])
    assert kinds(judged) == [("remove", "applied")]
    assert [event.kind for event in judged.events] == ["removed"]
    assert room.ids() == []


def test_a_first_confirmation_is_an_event_later_ones_are_noted():
    room = JudgedMap()
    first, second = room.propose(room.confirm()), room.propose(room.confirm())
    assert [event.kind for event in first.events] == ["confirmed"]
    assert kinds(first) == [("confirm", "applied")]
    assert kinds(second) == [("confirm", "noted")]
    assert second.events == []
    assert first.records[0].before == ()


def test_one_name_is_outvoted_by_the_detector_and_by_confirmations():
    room = JudgedMap(times=10)
    for camera in ALL_ROUND[:4]:
        room.propose(room.confirm(), camera=camera)
    assert room.outcome(room.relabel("walrus"), camera=ALL_ROUND[5]) == "noted"
    assert room.row(0).label == "cup"


def test_a_name_said_from_several_sides_is_taken_with_its_category():
    room = JudgedMap()
    outcomes = [room.outcome(room.relabel("green mug", "mug"), camera=camera) for camera in ALL_ROUND[:4]]
    assert "applied" in outcomes
    row = room.row(0)
    assert (row.label, row.category) == ("green mug", "mug")
    assert room.outcome(room.relabel("green mug", "mug"), camera=ALL_ROUND[5]) == "noted"  # it has it already


def test_a_description_that_keeps_the_word_is_taken_at_once():
    room = JudgedMap()
    judged = room.propose(room.relabel("red cup", "cup"))
    assert kinds(judged) == [("relabel", "applied")]
    assert room.row(0).label == "red cup"


def test_a_doubt_alone_changes_nothing():
    room = JudgedMap()
    assert {room.outcome(room.doubt(), camera=camera) for camera in ALL_ROUND} == {"noted"}
    assert room.row(0).label == "cup"


def two(apart_m, times_together=0):
    """Two boxes 0.11 m wide beside each other, never seen at once unless said so."""
    room = JudgedMap({0: (AT, "cup")})
    for _ in range(5):
        room.see({1: (aside(apart_m), "mug")})
    for _ in range(times_together):
        room.see({0: (AT, "cup"), 1: (aside(apart_m), "mug")})
    return room


def test_what_overlaps_is_merged_at_once():
    room = two(0.03)
    judged = room.propose(room.merge())
    assert kinds(judged) == [("merge", "applied")]
    assert (judged.records[0].landmark_id, judged.records[0].other_id) == (1, 0)
    assert room.ids() == [0]


def test_what_lies_beside_is_merged_when_a_second_view_says_so():
    room = two(0.1)
    assert room.outcome(room.merge(), view=1) == "noted"
    assert room.outcome(room.merge(1, 0), view=1) == "noted"  # the same view again, the other way round
    assert room.ids() == [0, 1]
    assert room.outcome(room.merge(), view=2) == "applied"
    assert room.ids() == [0]


def test_what_was_seen_apart_is_never_merged():
    room = two(0.1, times_together=5)
    assert room.objects.times_apart(0, 1) >= room.objects.settings.separate_frames
    for view in range(4):
        assert room.outcome(room.merge(), view=view) == "refused"
    assert room.ids() == [0, 1]


@pytest.mark.parametrize("edit", [Merge(0, 1, 0, 1), "far"])
def test_a_merge_with_itself_or_with_what_is_far_is_refused(edit):
    room = two(0.6)
    judged = room.propose(room.merge() if edit == "far" else edit, role="merging")
    assert kinds(judged) == [("merge", "refused")]
    assert "edit refused" in judged.warnings[0]
    assert room.ids() == [0, 1]


def test_a_stale_edit_is_dropped_and_told():
    room = JudgedMap()
    old = room.remove()
    room.objects[0].version += 1
    judged = room.propose(old)
    assert kinds(judged) == [("remove", "stale")]
    assert judged.warnings == []
    assert room.ids() == [0]


def test_an_agents_own_name_does_not_make_older_edits_stale():
    room = JudgedMap()
    old = room.confirm()
    room.propose(room.relabel("red cup", "cup"))
    assert room.version() != old.version
    assert room.outcome(old) == "applied"


@pytest.mark.parametrize("kind", [Confirm, Doubt, Remove])
@pytest.mark.parametrize(("landmark_id", "version", "outcome"), [(77, 0, "stale"), (0, 99, "refused"), (-1, 0, "stale")])
def test_unknown_landmarks_and_versions_that_never_were_change_nothing(kind, landmark_id, version, outcome):
    room = JudgedMap()
    before = room.row(0)
    assert room.outcome(kind(landmark_id, version)) == outcome
    assert room.row(0).version == before.version


@pytest.mark.parametrize("label", ["", "\u202e\u200b", "\x00\x07", 7.5, None, ["mug"], b"mug"])
@pytest.mark.parametrize("rails", [True, False])
def test_a_name_that_is_none_is_refused(label, rails):
    room = JudgedMap(rails=rails)
    assert room.outcome(Relabel(0, room.version(), label)) == "refused"
    assert room.row(0).label == "cup"


def test_something_that_is_no_edit_is_refused():
    room = JudgedMap()
    judged = room.propose("remove all", role="any")
    assert [record.outcome for record in judged.records] == ["refused"]
    assert judged.records[0].landmark_id == -1


def test_the_quota_bounds_what_one_keyframe_changes_and_the_rest_waits():
    things = {k: (aside(0.3 * k), "cup") for k in range(12)}
    room = JudgedMap(things, quota=3)
    for k in things:
        room.objects[k].existence = 0.35
    judged = room.propose(*(room.remove(k) for k in things))
    assert [record.outcome for record in judged.records] == ["applied"] * 3
    assert len(room.ids()) == 9
    assert room.desk.waiting == 9
    assert len(room.propose().records) == 3
    assert len(room.ids()) == 6


def test_noted_verdicts_do_not_use_the_quota():
    things = {k: (aside(0.3 * k), "cup") for k in range(12)}
    room = JudgedMap(things, quota=1)
    assert len(room.propose(*(room.confirm(k) for k in things)).records) == 12


def test_what_waits_is_bounded_and_what_is_dropped_is_told():
    room = JudgedMap({k: (aside(0.3 * k), "cup") for k in range(3)}, quota=1)
    for k in range(3):
        room.objects[k].existence = 0.35
    judged = room.propose(*(room.remove(k) for k in range(3)), *(room.confirm(k % 3) for k in range(1000)))
    assert room.desk.waiting < 1000
    assert len(judged.records) + room.desk.waiting == 1003
    assert {record.detail for record in judged.records if record.outcome == "refused"} == {"too many edits wait"}


@pytest.mark.parametrize("kind", ["remove", "relabel", "merge"])
def test_the_record_holds_what_was_before(kind):
    room = two(0.03)
    room.objects[0].existence = 0.35
    edit = {"remove": room.remove(), "relabel": room.relabel("red cup", "cup"), "merge": room.merge()}[kind]
    rows = {row.id: row for row in room.objects.rows(room.smoother)}
    if kind == "relabel":
        room.objects[0].existence = 1.0
    (record,) = room.propose(edit).records
    assert (record.kind, record.outcome) == (kind, "applied")
    assert [row.id for row in record.before] == ([0, 1] if kind == "merge" else [0])
    for row in record.before:
        assert (row.label, row.version, row.observations) == (rows[row.id].label, rows[row.id].version, rows[row.id].observations)
        np.testing.assert_allclose(row.position_m, rows[row.id].position_m)


def test_with_the_rails_off_every_edit_whose_version_holds_is_applied():
    room = JudgedMap({k: (aside(0.3 * k), "cup") for k in range(3)}, rails=False)
    assert room.outcome(room.relabel("walrus")) == "applied"
    assert room.row(0).label == "walrus"
    assert room.outcome(room.merge(0, 1)) == "applied"  # however far apart
    assert room.outcome(room.remove(2)) == "applied"
    assert room.ids() == [0]
    assert room.outcome(room.doubt()) == "noted"


def test_an_agent_that_stands_alone_is_taken_at_its_word_for_names_but_not_for_removals():
    room = JudgedMap()
    assert room.outcome(room.relabel("grail"), role="any") == "applied"
    assert room.row(0).label == "grail"
    assert room.outcome(room.remove(), role="any") == "noted"
    assert room.outcome(room.relabel("mug"), role="description") == "noted"  # what somebody chose stays


def test_what_was_said_of_what_is_gone_is_forgotten():
    room = JudgedMap()
    room.propose(room.confirm())
    assert not room.desk.is_new(0)
    room.desk.follow([MapEvent("removed", 0)])
    assert room.desk.is_new(0)


def test_what_was_said_of_a_double_goes_on_with_what_it_was_merged_into():
    room = JudgedMap()
    room.propose(room.confirm())
    room.desk.follow([MapEvent("merged", 0, other_id=1)])
    assert [room.desk.is_new(i) for i in (0, 1)] == [True, False]


def test_a_verdict_is_about_the_word_that_the_agent_saw():
    room = JudgedMap()
    seen = room.version()
    room.propose(room.relabel("red mug", "mug"), role="any")
    room.propose(Confirm(0, seen), Doubt(0, seen), agent="late")
    assert [(v.kind, v.word) for v in room.desk._verdicts.of(0) if v.who == "late m"] == [("confirm", "cup"), ("doubt", "cup")]


def test_the_same_name_again_changes_nothing():
    room = JudgedMap()
    assert room.outcome(room.relabel("red mug", "mug"), role="any") == "applied"
    version = room.version()
    assert room.outcome(room.relabel("red mug", "mug"), role="any") == "noted"
    assert room.version() == version


@pytest.mark.parametrize("rails", [True, False])
def test_nothing_is_merged_with_itself(rails):
    room = JudgedMap(rails=rails)
    assert room.outcome(room.merge(0, 0)) == "refused"
    assert 0 in room.objects


def test_a_refused_name_binds_nobody():
    room = JudgedMap()
    assert room.outcome(room.relabel(" "), role="any") == "refused"
    assert not room.desk._told[0].is_final


def test_the_rails_are_on_unless_somebody_says_otherwise():
    assert EditSettings().rails


def test_however_often_a_keyframe_asks_it_has_one_quota():
    room = JudgedMap({k: (aside(0.3 * k), "cup") for k in range(8)}, quota=2)
    for k in range(8):
        room.objects[k].existence = 0.35
    for k in range(8):
        room.propose(room.remove(k), view=1)
    assert len(room.ids()) == 6
    room.propose(view=2)
    assert len(room.ids()) == 4


def test_at_the_end_of_a_run_nothing_waits():
    room = JudgedMap({k: (aside(0.3 * k), "cup") for k in range(8)}, quota=2)
    for k in range(8):
        room.objects[k].existence = 0.35
    room.propose(*(room.remove(k) for k in range(8)), view=1)
    assert len(room.ids()) == 6
    room.desk.judge([], 1, 2.0, heed_quota=False)
    assert room.ids() == []
    assert room.desk.waiting == 0
