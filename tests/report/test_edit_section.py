"""What the report shows of edits by agents."""

import base64
import json
import re
from dataclasses import replace

import pytest
from made_up_desk import landmark, make_desk, painted_frame, step

from seo_slam.records import MapEvent
from seo_slam.report.edit_log import EditLog
from seo_slam.report.edit_section import counts_of
from seo_slam.report.html import render_report
from seo_slam.testing.store import make_edit

HOSTILE = "<img src=x onerror=alert(1)>'); DROP TABLE edit; --\x00\x1b[31m\u202e\ud800 " + "x" * 5000


def edit(kind="relabel", landmark_id=1, other_id=None, **changes):
    made = make_edit(kind, landmark_id, other_id, **{k: changes.pop(k) for k in ("outcome", "before", "detail") if k in changes})
    return replace(made, **{"timestamp_s": 104.0, "view_s": 103.5, **changes})


def watch(recorder, edits, events=()):
    frame = painted_frame(104.0, [])
    recorder.observe(frame, replace(step(frame, events=events, keyframe_id=4), edits=tuple(edits)))


def section_of(desk):
    page = render_report(**desk.arguments)
    found = re.search(r'<section[^>]*"edits[^>]*>.*?</section>', page, re.DOTALL)
    return found[0] if found else ""


def cards(section):
    return re.findall(r'<li class="(\w+)">(.*?)</li>', section, re.DOTALL)


def shown(crop):
    return base64.b64encode(crop.jpeg).decode()


def test_a_run_without_agents_has_no_such_section():
    assert section_of(make_desk()) == ""


def test_each_change_is_shown_with_its_picture_newest_first():
    desk = make_desk()
    was = (landmark(1, "book"),)
    watch(desk.recorder, [edit(before=was, detail="book -> torn red hardcover"), edit(landmark_id=2, detail="cup -> mug")])
    (_, newest), (kind, text) = cards(section_of(desk))
    assert "cup → mug" in newest
    assert kind == "relabel"
    assert "book → torn red hardcover" in text
    assert shown(desk.recorder.crop(1)) in text
    for part in ("edit 1", "4.0 s", "Painter", "brush-2b", "prompt 5f2a9c01", "looked at keyframe 0, 0.5 s before"):
        assert part in text
    assert '<a href="#landmark-1">#1</a>' in text


def test_what_was_removed_keeps_its_picture_and_a_merge_shows_both():
    desk = make_desk()
    recorder = desk.recorder
    removed, gone, kept = (shown(recorder.crop(i)) for i in (6, 7, 2))
    before = (landmark(2, "cup"), landmark(7, "mug"))
    edits = [edit("remove", 6, before=(landmark(6, "book"),)), edit("merge", 7, 2, before=before)]
    watch(recorder, edits, [MapEvent("removed", 6), MapEvent("merged", 7, other_id=2)])
    assert recorder.crop(6) is None  # it never was stable: nothing else of it is kept
    (_, merged), (_, taken) = cards(section_of(desk))
    assert removed in taken
    assert "<b>removed</b> #6 book" in taken.replace('<a href="#landmark-6">#6</a>', "#6")
    assert gone in merged
    assert kept in merged
    assert re.sub("<a[^>]*>|</a>", "", merged).count("<b>merged</b> #7 mug into #2 cup") == 1


def test_what_changed_nothing_is_listed_without_pictures():
    desk = make_desk()
    others = [edit("confirm"), edit("remove", 2, outcome="refused", detail="one voice only"), edit("merge", 3, 2, outcome="noted")]
    watch(desk.recorder, others)
    section = section_of(desk)
    assert cards(section) == []
    assert "the last 3 proposals that changed nothing, newest first" in section
    assert section.index("one voice only") > section.index("#3")
    assert "data:image" not in section


def test_counts_by_agent_and_outcome_are_those_of_the_run():
    desk = make_desk()
    watch(desk.recorder, [edit(), edit("confirm"), edit("remove", outcome="refused"), replace(edit(outcome="stale"), agent="Other")])
    section = section_of(desk)
    rows = re.findall(r"<tr><td>(\w+)</td>(.*?)</tr>", section)
    found = {agent: [int(n) for n in re.findall(r">(\d+)</td>", cells)] for agent, cells in rows}
    assert found["Painter"] == [2, 0, 0, 1]
    assert found["Other"] == [0, 0, 1, 0]
    lines = [{"agent": "Painter", "kind": "relabel", "outcome": "applied", "number": 70}]
    desk.run["agents"] = {"edits": lines, "age_s": {"p50": 0.25}, "agents": [{"name": "Painter", "role": "any", "asked": 12}]}
    section = section_of(desk)
    assert ">70</td>" in section
    assert "<dt>age s p50</dt><dd>0.25</dd>" in section
    assert "<dt>asked</dt><dd>12</dd>" in section
    data = json.loads(re.search(r'id="report-data">(.*?)</script>', render_report(**desk.arguments), re.DOTALL)[1])
    assert data["edits"] == lines


def test_agents_that_proposed_nothing_are_told():
    desk = make_desk()
    desk.run["agents"] = {"mode": "inline", "agents": []}
    assert "They proposed nothing." in section_of(desk)


def test_hostile_words_are_text_and_short():
    desk = make_desk()
    nasty = edit(before=(landmark(1, HOSTILE),), detail=HOSTILE, agent=HOSTILE, model=HOSTILE, prompt_hash=HOSTILE)
    strange = replace(nasty, kind="<b>", landmark_id='1"><script>', other_id=2**80, outcome="refused")
    watch(desk.recorder, [nasty, replace(nasty, kind="remove"), replace(nasty, kind="merge", other_id=2), strange])
    desk.run["agents"] = {
        HOSTILE: HOSTILE,
        "agents": [{"name": HOSTILE, HOSTILE: HOSTILE}, 3],
        "edits": [{"agent": HOSTILE, "number": 1}, 7],
    }
    desk.map.landmarks = (replace(desk.map.landmarks[0], label=HOSTILE, category=HOSTILE), *desk.map.landmarks[1:])
    page = render_report(**desk.arguments)
    section = section_of(desk)
    for bad in ("<img src=x", "<script>'", '1"><script>', "<b>'", "\x00", "\x1b", "\u202e", "\ud800", "x" * 1001):
        assert bad not in page
    assert "x" * 400 not in section
    assert "&lt;img src=x onerror=alert(1)&gt;" in section
    assert len(cards(section)) == 3
    page.encode("utf-8")


@pytest.mark.parametrize("agents", [{"edits": "none"}, {"edits": {"a": 1}}, {"edits": [1, {"number": "7"}, {"agent": 3}]}, {}])
def test_counts_of_another_form_are_left_out(agents):
    assert counts_of(agents) == {}


def test_the_number_of_edits_kept_is_bounded_and_all_are_counted():
    log = EditLog(lambda landmark_id: None, most_changes=3, most_others=2)
    log.note([edit(landmark_id=i) for i in range(5)])
    log.note([edit("confirm", landmark_id=i) for i in range(5)])
    assert [noted.number for noted in log.changes] == [3, 4, 5]
    assert [noted.number for noted in log.others] == [9, 10]
    assert log.counts == {("Painter", "relabel", "applied"): 5, ("Painter", "confirm", "applied"): 5}


def test_a_long_run_shows_some_and_folds_the_others():
    desk = make_desk()
    watch(desk.recorder, [edit(landmark_id=1 + i % 5, detail=f"{i}") for i in range(400)])
    section = section_of(desk)
    assert len(cards(section)) == 300
    assert "<summary>284 earlier changes</summary>" in section
    assert "100 older changes are not shown" in section


def test_edits_after_the_last_frame_are_followed_too():
    desk = make_desk()
    recorder = desk.recorder
    watch(recorder, [], [MapEvent("stable", 6)])
    picture = shown(recorder.crop(6))
    recorder.observe_edits([edit("remove", 6), edit("confirm", 2), edit("merge", 7, 2)])
    assert recorder.gone == (6,)
    assert recorder.crop(7) == recorder.crop(2)
    assert recorder.event_counts["removed"] == recorder.event_counts["merged"] == 1
    assert picture in section_of(desk)
