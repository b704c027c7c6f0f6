"""How the report tells what became of a thing: lost, found, moved, removed."""

import json
import re

import pytest
from made_up_desk import MadeUpMap, circle_trajectory, landmark, painted_frame, step

from seo_slam.records import MapEvent
from seo_slam.report.crops import RecordedEvent, ReportRecorder
from seo_slam.report.html import render_report
from seo_slam.report.life_history import away_spans, life_line

BOX = [20, 20, 90, 90]


def events(*rows, landmark_id=1):
    return [RecordedEvent(stamp_s, None, MapEvent(kind, landmark_id, detail="<cup>")) for stamp_s, kind in rows]


def test_a_thing_that_was_simply_there_has_no_line():
    assert life_line(events((1.0, "created"), (2.0, "stable")), 0.0) == ""


def test_the_line_tells_what_happened_in_order_and_escapes():
    line = life_line(events((11.0, "created"), (14.0, "lost"), (15.5, "found"), (17.0, "moved"), (19.0, "removed")), 10.0)
    assert re.sub("<[^>]*>", "", line) == "lost 4.0 s → found 5.5 s → moved 7.0 s → removed 9.0 s"
    assert "<cup>" not in line
    assert "&lt;cup&gt;" in line


def test_of_a_long_life_the_end_is_told():
    rows = [(float(k), "lost" if k % 2 else "found") for k in range(20)]
    text = re.sub("<[^>]*>", "", life_line(events(*rows), 0.0))
    assert text.startswith("14 earlier → found 14.0 s")
    assert text.endswith("lost 19.0 s")


@pytest.mark.parametrize(
    ("rows", "spans"),
    [
        ([(1.0, "created"), (2.0, "stable")], []),
        ([(2.0, "lost"), (4.0, "found")], [(2.0, 4.0)]),
        ([(2.0, "lost"), (4.0, "moved"), (6.0, "lost"), (8.0, "removed")], [(2.0, 4.0), (6.0, 10.0)]),
        ([(3.0, "removed")], [(3.0, 10.0)]),
    ],
)
def test_when_a_thing_was_away(rows, spans):
    assert away_spans(events(*rows), 10.0) == spans


def test_the_report_keeps_what_is_gone_and_tells_lost_from_tentative():
    recorder = ReportRecorder()
    for k, happened in enumerate(
        (
            [MapEvent("created", i, "") for i in (1, 2, 3)],
            [MapEvent("stable", 1), MapEvent("stable", 2)],
            [MapEvent("lost", 1, "cup"), MapEvent("lost", 2, "book")],
            [MapEvent("removed", 2, "book")],
        )
    ):
        frame = painted_frame(100.0 + k, [BOX], seed=k)
        seen = [1, 2, 3] if k == 0 else []
        recorder.observe(frame, step(frame, seen, [BOX] * len(seen), ["cup", "<b>book", "pen"][: len(seen)], events=happened))
    made = MadeUpMap((), (landmark(1, "cup", state="lost"), landmark(3, "pen", state="tentative")))
    text = render_report(map=made, trajectory=circle_trajectory(), recorder=recorder, run={})
    (raw,) = re.findall(r'<script type="application/json" id="report-data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(raw)
    assert (data["counts"]["tentative"], data["counts"]["lost"], data["counts"]["gone"]) == (2, 1, 1)
    assert [(row["id"], row["label"], [kind for _, kind, _ in row["life"]]) for row in data["gone"]] == [
        (2, "<b>book", ["created", "stable", "lost", "removed"])
    ]
    for words in (
        "1 lost: not seen where they should be",
        "1 no longer there",
        "1 tentative: not seen",
        'id="landmark-2"',
        "&lt;b&gt;book",
    ):
        assert words in text
    assert "<b>book" not in text.replace(raw, "")
    # The page's script finds and sorts the rows of all tables by these.
    assert all("data-id=" in row and "data-label=" in row for row in re.findall(r'<tr id="landmark-[^>]*>', text))
    assert text.count('class="nothing"') == text.count('<table class="landmarks')
    row = text[text.index('id="landmark-2"') :]
    assert re.search(r"lost 2\.0 s.*removed 3\.0 s", re.sub("<[^>]*>", "", row[: row.index("</tr>")]))
    assert row[: row.index("</tr>")].count("data:image/jpeg") == 1
