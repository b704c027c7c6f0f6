import hashlib
import json
import re
import xml.etree.ElementTree as ET
from base64 import b64decode, b64encode
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_desk import MadeUpMap, circle_trajectory, landmark, make_desk, painted_frame, step

from seo_slam.records import MapEvent, Trajectory
from seo_slam.report.crops import ReportRecorder
from seo_slam.report.escaping import clean_text, escaped, script_json
from seo_slam.report.html import render_report, write_report

EMPTY = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "option"}
HOSTILE = [
    "<script>alert(1)</script>",
    "</script><script>alert(2)</script>",
    '"><img src=x onerror=alert(3)>',
    "' onmouseover='alert(4)",
    "</title></style></svg><b>",
    "<!--",
    "]]>",
    "a\x00b\x1b[31m\u202eevil\u2028line\nnext\ud800",
    "&lt;b&gt;",
    "x" * 10_000,
    "javascript:alert(5)",
    "{{7*7}}${7*7}%s",
]


class Page(HTMLParser):
    """Elements of a page, with a check that what is opened is closed."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.texts, self._open = [], [], []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.texts.append((self._open[-1] if self._open else "", data))

    def all(self, tag, **wanted):
        return [a for t, a in self.elements if t == tag and all(a.get(k.rstrip("_")) == v for k, v in wanted.items())]


def page_and_data(**arguments):
    text = render_report(**arguments)
    page = Page(text)
    (raw,) = re.findall(r'<script type="application/json" id="report-data">(.*?)</script>', text, re.DOTALL)
    return text, page, json.loads(raw)


def hostile_desk():
    recorder = ReportRecorder()
    landmarks = []
    for i, label in enumerate(HOSTILE):
        frame = painted_frame(100.0 + i, [[20, 20, 90, 90]])
        events = [MapEvent("created", i, label, label), MapEvent(label, i, other_id=3)]
        recorder.observe(frame, step(frame, [i], [[20, 20, 90, 90]], [label], events=events))
        landmarks.append(landmark(i, label, (0.3 * (i % 4), 0.3 * (i // 4), 0), "stable" if i % 2 else "tentative"))
    run = {
        "dataset": HOSTILE[1],
        "counts": dict.fromkeys(HOSTILE, 1),
        "seconds_per_stage": {text: {"p50": 0.1, "p95": 0.2, "max": 0.3} for text in HOSTILE},
        "warnings": [{"message": text, "count": 1} for text in HOSTILE],
        "versions": {text: text for text in HOSTILE},
        "config": {text: [text] for text in HOSTILE},
        **{text: text for text in HOSTILE},
    }
    stable = tuple(m for m in landmarks if m.state == "stable")
    the_map = MadeUpMap(stable, tuple(m for m in landmarks if m.state != "stable"), gravity=HOSTILE[0], embedder=HOSTILE[2])
    return {"map": the_map, "trajectory": circle_trajectory(), "recorder": recorder, "run": run}


def test_hostile_text_stays_text_everywhere():
    text, page, data = page_and_data(**hostile_desk())
    plain = Page(render_report(map=MadeUpMap((landmark(1),), (landmark(2, state="tentative"),)), trajectory=EMPTY, recorder=None, run={}))
    assert len(page.all("script")) == len(plain.all("script")) == 2
    assert {tag for tag, _ in page.elements} - {tag for tag, _ in plain.elements} <= {
        *("img", "polyline", "div", "details", "summary", "dl", "dt", "dd", "pre", "ul", "li", "tbody", "thead", "em", "rect", "svg"),
        *("b", "table", "tr", "td", "th"),
    }
    assert not [name for _, attrs in page.elements for name in attrs if name.startswith("on")]
    assert all(a["src"].startswith("data:image/jpeg;base64,") for a in page.all("img"))
    assert all(a["href"].startswith("#") for a in page.all("a"))
    assert text.count("</script>") == 2
    for bad in ("\x00", "\x1b", "\u202e", "\u2028", "\ud800", "alert(1)</"):
        assert bad not in text
    text.encode("utf-8")
    labels = {m["label"] for m in (*data["landmarks"], *data["tentative"])}
    assert HOSTILE[0] in labels  # harmless as data, and not mangled


def test_long_labels_are_capped_and_do_not_blow_up_the_page():
    text, _, data = page_and_data(**hostile_desk())
    assert "x" * 1001 not in text
    assert len(text) < 400_000
    assert max(len(m["label"]) for m in (*data["landmarks"], *data["tentative"])) <= 1000


@given(st.text())
def test_cleaned_text_is_one_printable_line_within_its_limit(text):
    cleaned = clean_text(text, 40)
    assert len(cleaned) <= 40
    assert all(c.isprintable() or c in "\u200c\u200d" for c in cleaned)
    assert clean_text(cleaned, 40) == cleaned
    assert not set('<>"') & set(escaped(text))
    assert "'" not in escaped(text)


@given(
    st.recursive(st.text() | st.floats() | st.integers() | st.none() | st.booleans(), lambda x: st.lists(x) | st.dictionaries(st.text(), x))
)
def test_script_json_is_json_that_cannot_close_its_script(value):
    text = script_json(value)
    json.loads(text)
    assert not set("<>&\u2028\u2029") & set(text)


def test_the_page_says_what_it_was_given():
    desk = make_desk(12, tentative=3)
    text, page, data = page_and_data(**desk.arguments)
    assert data["schema"] == "seo_slam.report/1"
    assert data["counts"] == {
        "frames": 120,
        "keyframes": 40,
        **{"stable": 9, "tentative": 3, "lost": 0, "gone": 0},
        "warnings": 10,
        "poses": 40,
    }
    assert data["duration_s"] == pytest.approx(9.75)
    assert data["path_length_m"] == pytest.approx(1.5 * 2, rel=0.01)
    assert [m["id"] for m in data["landmarks"]] == [m.id for m in desk.map.landmarks]
    first, given_first = data["landmarks"][0], desk.map.landmarks[0]
    assert first["label"] == given_first.label
    assert first["labels"] == dict(given_first.labels)
    assert first["position_m"] == pytest.approx(given_first.position_m.tolist())
    assert first["sigma_m"] == pytest.approx(np.sqrt(given_first.covariance_m2[1, 1]))
    assert first["has_crop"]
    assert first["history"][0][2] == given_first.label
    assert data["warnings"] == [{"message": "too small", "count": 7}, {"message": "no depth", "count": 3}]
    assert data["seconds_per_stage"]["detection"] == {"p50": 0.1, "p95": 0.2, "max": 0.9}
    assert data["events"] == {"created": 12}
    assert data["peak_memory_mb"] == 512.0
    for words in ("made up desk", "100 ms", "900 ms", "too small", "512 MB", "numpy"):
        assert words in text
    assert len(page.all("tr", class_="stable")) == 9
    assert len(page.all("tr", class_="tentative")) == 3


def test_how_sure_it_is_that_a_thing_is_there_stands_in_its_row():
    rows = {1: 1.0, 2: 0.9991, 3: 0.5, 4: 0.0004, 5: 0.0}
    the_map = MadeUpMap(tuple(landmark(i, existence=share) for i, share in rows.items()))
    text, page, data = page_and_data(map=the_map, trajectory=EMPTY, recorder=None, run={})
    assert [m["existence"] for m in data["landmarks"]] == list(rows.values())
    assert [row["data-existence"] for row in page.all("tr", class_="stable")] == [f"{share:.6f}" for share in rows.values()]
    shown = re.findall(r'<td class="num" data-name="there"><small[^>]*>([^<]*)</small>', text)
    assert shown == ["100 %", "&gt; 99 %", "50 %", "&lt; 1 %", "0 %"]


def test_events_say_which_id_a_moved_thing_had_until_then():
    events = [{"keyframe": 4, "kind": "moved", "landmark": 1, "detail": "cup: from a to b", "other": 7}]
    text, _, _ = page_and_data(map=MadeUpMap(), trajectory=EMPTY, recorder=None, run={"events": events})
    assert "until then #7, cup: from a to b" in text


def test_every_picture_is_a_jpeg_that_opens():
    _, page, data = page_and_data(**make_desk(8).arguments)
    pictures = page.all("img")
    assert len(pictures) == 8 == sum(m["has_crop"] for m in (*data["landmarks"], *data["tentative"]))
    for attributes in pictures:
        raw = b64decode(attributes["src"].partition(",")[2])
        image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_COLOR)
        assert image.shape[:2] == (int(attributes["height"]), int(attributes["width"]))


def test_every_link_leads_to_something_on_the_page():
    _, page, _ = page_and_data(**make_desk(30).arguments)
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    assert {a["href"][1:] for a in page.all("a")} <= set(ids)


def test_nothing_comes_from_outside_the_file():
    text, page, _ = page_and_data(**make_desk().arguments)
    assert "http:" not in text
    assert "https:" not in text
    assert "@import" not in text
    assert "url(" not in re.sub(r"url\(#map-edge-\w+\)", "", text)
    assert [a["href"] for a in page.all("link")] == ["data:,"]


def test_the_policy_allows_our_script_and_no_other():
    text, page, _ = page_and_data(**make_desk().arguments)
    (policy,) = [a["content"] for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy"]
    script = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)[0]
    digest = b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy


@pytest.mark.parametrize("gravity", ["recorded poses", "unknown"])
def test_an_empty_map_gives_a_page_that_says_so(gravity):
    text, page, data = page_and_data(map=MadeUpMap(gravity=gravity), trajectory=EMPTY, recorder=None, run={})
    assert data["counts"] == {"stable": 0, "tentative": 0, "lost": 0, "gone": 0, "warnings": 0, "poses": 0}
    assert data["duration_s"] is None
    assert "holds no stable landmark" in text
    assert len(page.all("svg", id="map-wide")) == 1
    assert not page.all("tr", class_="stable")


def test_unknown_gravity_is_said_and_known_gravity_is_not_doubted():
    arguments = {"trajectory": circle_trajectory(), "recorder": None, "run": {}}
    unknown, _, data = page_and_data(map=MadeUpMap((landmark(1),), gravity="unknown"), **arguments)
    assert "up is not known" in unknown
    assert data["gravity"] == "unknown"
    assert "up is not known" not in render_report(map=MadeUpMap((landmark(1),)), **arguments)


def test_one_landmark_without_a_recorder():
    text, page, data = page_and_data(map=MadeUpMap((landmark(4, "cup"),)), trajectory=EMPTY, recorder=None, run={})
    assert data["landmarks"][0]["id"] == 4
    assert not data["landmarks"][0]["has_crop"]
    assert "no picture" in text
    assert not page.all("img")


def test_an_unnamed_landmark_and_broken_numbers_are_shown():
    broken = landmark(3, "", (np.nan, 0, 0), covariance_m2=np.full((3, 3), np.nan))
    text, _, data = page_and_data(map=MadeUpMap((broken,)), trajectory=EMPTY, recorder=None, run={})
    assert "unnamed" in text
    assert data["landmarks"][0]["position_m"] == [None, 0.0, 0.0]
    assert data["landmarks"][0]["sigma_m"] is None
    assert data["not_drawn"] == [3]


def test_three_hundred_landmarks_fit_and_their_labels_do_not_collide():
    desk = make_desk(300, tentative=50)
    text, page, data = page_and_data(**desk.arguments)
    assert len(data["landmarks"]) == 250
    assert len([a for a in page.all("a") if a.get("class", "").startswith("landmark ")]) == 600  # in the wide and the narrow map
    assert len(text) < 3_000_000
    wide = ET.fromstring(re.search(r'<svg class="map map-wide".*?</svg>', text, re.DOTALL).group())
    tags = [node for node in wide.iter() if node.get("class", "").startswith("tag ")]
    assert 20 < len(tags) < 300


@pytest.mark.parametrize(
    "run",
    [
        {"counts": None, "warnings": None, "events": None, "config": None, "versions": None, "seconds_per_stage": None, "dataset": None},
        {"counts": [1], "warnings": ["a", "a"], "events": {"created": 3}, "config": "x", "seconds_per_stage": {"all": 0.1, "x": None}},
        {"counts": {"frames": float("nan"), "keyframes": "many"}, "warnings": [("late", 3)], "peak_memory_mb": "much", "events": [{}]},
        {"warnings": {"late": 3}, "seconds_per_stage": {"idle": {"p50": 0.0, "p95": 0.0, "max": 0.0}}},
    ],
)
def test_a_run_of_another_form_leaves_gaps_not_errors(run):
    page_and_data(map=MadeUpMap((landmark(1),)), trajectory=circle_trajectory(1), recorder=None, run=run)


def test_a_slow_start_of_one_stage_does_not_hide_the_others():
    slow_start = {"observe": {"p50": 0.003, "p95": 0.7, "max": 12.0}, "detect": {"p50": 0.02, "p95": 0.04, "max": 0.05}}
    text = render_report(map=MadeUpMap(), trajectory=EMPTY, recorder=None, run={"seconds_per_stage": slow_start})
    detect = text[text.index(">detect<") :]
    assert float(re.search(r'class="p50" style="width:([\d.]+)%', detect).group(1)) > 20
    assert text.count('class="max beyond"') == 1


def test_warnings_are_folded_and_counted():
    _, _, data = page_and_data(map=MadeUpMap(), trajectory=EMPTY, recorder=None, run={"warnings": ["late", "late", "dark"]})
    assert data["warnings"] == [{"message": "late", "count": 2}, {"message": "dark", "count": 1}]


def test_events_of_the_run_are_listed():
    events = [{"kind": "merged", "landmark_id": 5, "other_id": 2, "timestamp_s": 101.5, "source": "pipeline"}]
    text, _, data = page_and_data(map=MadeUpMap((landmark(2),)), trajectory=circle_trajectory(), recorder=None, run={"events": events})
    assert data["events"] == {"merged": 1}
    assert 'href="#landmark-5"' not in text  # it left the map
    assert "into #2" in text
    assert "1.5 s" in text


def test_events_as_run_json_has_them_are_listed_by_keyframe():
    events = [{"keyframe": 17, "kind": "merged", "landmark": 5, "detail": "boxes overlap", "source": "pipeline", "other": 2}]
    text = render_report(map=MadeUpMap((landmark(2),)), trajectory=EMPTY, recorder=None, run={"events": events})
    assert "keyframe 17" in text
    assert "into #2, boxes overlap" in text


@pytest.mark.parametrize("complete", [True, False])
def test_an_interrupted_run_is_said_to_be_one(complete):
    text, _, data = page_and_data(map=MadeUpMap(), trajectory=EMPTY, recorder=None, run={"complete": complete})
    assert ("interrupted" in text) != complete
    assert data["complete"] is complete


def test_the_same_input_gives_the_same_bytes_and_no_half_file(tmp_path):
    for name in ("a.html", "b.html"):
        write_report(tmp_path / name, **make_desk().arguments)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.html", "b.html"]


def test_a_folder_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(OSError, match=r"report\.html"):
        write_report(tmp_path / "absent" / "report.html", **make_desk().arguments)
