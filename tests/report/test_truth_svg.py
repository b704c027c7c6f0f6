"""The picture of truth beside map, and the page around it."""

import json
import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from made_up_desk import circle_trajectory, landmark

from seo_slam.evaluation.landmarks import FormerPlace, Truth, TruthObject, evaluate_landmarks
from seo_slam.report.evaluation_page import render_evaluation, write_evaluation
from seo_slam.report.truth_scene import compare
from seo_slam.report.truth_svg import BELOW, BESIDE, FILE, draw_comparison, truth_svg

SVG = "{http://www.w3.org/2000/svg}"
HOSTILE = '</text><script>alert("1")</script>&amp;\x1b'


def thing(name, label, center, size=(0.2, 0.1, 0.1), seen=None):
    middle, half = np.array(center, dtype=float), np.array(size) / 2
    return TruthObject(name, (label,), middle[None], float(half[:2].min()), seen, np.stack([middle - half, middle + half]))


def place(name, event, label, center, size=(0.2, 0.1, 0.1)):
    return FormerPlace(name, event, (label,), np.array(center, dtype=float), 0.05, np.array(size))


TRUTH = Truth(
    (
        thing("c", "cup", (0, 0, 1), seen=9),
        thing("b", "book", (1, 0.5, 1), seen=9),
        thing("t", "tv", (1, 1, 1), seen=2),
        thing("h", HOSTILE, (0, 1, 1), seen=9),
    ),
    (
        place("v", "removed", "vase", (0.5, 1.2, 1)),
        place("b", "moved", "book", (-1, 0, 1)),
        place("b", "moved", "book", (-1, 1, 1)),
        place("b", "moved", "book", (-1, 1, 1)),
        place("b", "moved", "book", (1, 0.5, 1)),
    ),
)
FOUND = [
    landmark(1, "cup", (0.03, 0.04, 1)),
    landmark(2, "cup", (0.1, -0.05, 1)),
    landmark(3, "book", (-1, 0, 1)),
    landmark(4, "vase", (0.5, 1.25, 1)),
    landmark(5, "dragon", (0.6, 0.1, 1)),
    landmark(6, HOSTILE, (0, 1, 1)),
    landmark(7, "cup", (0, 0, 1), state="tentative"),
]
RESULT = evaluate_landmarks(FOUND, TRUTH)


def picture(found=FOUND, truth=TRUTH, trajectory=None, title="a room"):
    return ET.fromstring(truth_svg(found, truth, evaluate_landmarks(found, truth), trajectory, title))


def marks(svg, side):
    """Kind -> tooltips of the things drawn on a side."""
    (panel,) = (node for node in svg.iter() if node.get("class", "") == f"side {side}")
    found = {}
    for node in panel.iter():
        kinds = node.get("class", "").split()
        title = node.find(f"{SVG}title")
        if kinds[:1] == ["mark"] and title is not None:
            found.setdefault(kinds[1], []).append(title.text)
    return found


def test_each_thing_is_drawn_as_what_it_is():
    svg = picture(trajectory=circle_trajectory())
    truth, found = marks(svg, "truth"), marks(svg, "map")
    assert {kind: len(titles) for kind, titles in truth.items()} == {"object": 3, "seldom": 1, "removed": 1, "moved": 2}
    assert {kind: len(titles) for kind, titles in found.items()} == {"matched": 2, "duplicate": 1, "ghost": 2, "false": 1, "missing": 2}
    assert "landmark 1 (cup): cup (c), 5.0 cm off" in found["matched"]
    assert found["duplicate"] == ["landmark 2 (cup): duplicate of c"]
    assert set(found["missing"]) == {"book (b): no landmark", "tv (t): no landmark"}
    assert truth["removed"] == ["vase (v) was taken away from here"]
    words = [node.text for node in svg.iter(f"{SVG}text")]
    assert {"Truth: 4 objects", "Map: 6 landmarks", "a room", "matched 2", "ghost 2", "seldom in view 1", "camera path"} <= set(words)
    assert any(text.startswith("precision 0.33, recall 0.50, F1 0.40 (landmarks/1, within 0.2 m") for text in words)


def test_moves_are_a_chain_of_arrows_that_ends_where_the_thing_is():
    moved = [mark for mark in compare(FOUND, TRUTH, RESULT).truth if mark.kind == "moved"]
    assert [mark.centre.tolist() for mark in moved] == [[-1, 0], [-1, 1]]
    assert [mark.leads_to.tolist() for mark in moved] == [[-1, 1], [1, 0.5]]
    gone = Truth(TRUTH.objects, (place("v", "moved", "vase", (3, 0, 1)), place("v", "removed", "vase", (3, 1, 1))))
    left = [mark for mark in compare(FOUND, gone, RESULT).truth if mark.kind in ("moved", "removed")]
    assert [(mark.kind, mark.leads_to is None) for mark in left] == [("moved", False), ("removed", True)]


def test_both_panels_have_one_scale():
    svg = picture()
    boxes = {}
    for side, kind in (("truth", "object"), ("map", "missing")):
        (panel,) = (node for node in svg.iter() if node.get("class", "") == f"side {side}")
        for node in panel.iter():
            title = node.find(f"{SVG}title")
            if node.get("class") == f"mark {kind}" and title is not None and title.text.startswith("book (b)"):
                boxes[side] = node.find(f"{SVG}polygon").get("points")
    assert boxes["truth"] == boxes["map"]


def test_text_from_outside_stays_text():
    text = truth_svg(FOUND, TRUTH, RESULT, None, HOSTILE)
    assert "<script" not in text
    assert "\x1b" not in text
    svg = ET.fromstring(text)
    assert {node.tag.removeprefix(SVG) for node in svg.iter()} <= {
        *("svg", "style", "rect", "g", "text", "title", "path", "polygon", "polyline", "circle", "clipPath")
    }
    assert not [name for node in svg.iter() for name in node.attrib if name.startswith("on") or "href" in name]
    assert any("<script>" in (node.text or "") for node in svg.iter(f"{SVG}title"))


def test_a_file_of_its_own_needs_no_variables_and_no_network():
    text = truth_svg(FOUND, TRUTH, RESULT)
    assert "var(" not in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")
    assert truth_svg(FOUND[::-1], TRUTH, RESULT) == text


def label_boxes(svg):
    """Labels of the right panel with their boxes, by the layout's own measure of text."""
    font = float(svg.get("font-size"))
    (panel,) = (node for node in svg.iter() if node.get("class", "") == "side map")
    boxes = []
    for node in panel.iter():
        text = node.find("text")
        if node.get("class", "").startswith("mark ") and text is not None:
            width, x, y = 0.62 * font * len(text.text), float(text.get("x")), float(text.get("y"))
            left = {"start": x, "end": x - width, "middle": x - width / 2}[text.get("text-anchor")]
            boxes.append((left, y - 0.95 * font, left + width, y + 0.3 * font))
    return boxes


@pytest.mark.parametrize(("style", "stacked"), [(FILE, False), (BESIDE, False), (BELOW, True)])
def test_in_a_crowd_labels_do_not_cover_each_other_and_few_are_missing(style, stacked):
    rng = np.random.default_rng(0)
    objects = [
        thing(str(i), f"thing {i % 7}", (*rng.normal(0, 0.25, 2) + 2.5 * np.array(divmod(i % 3, 2)), 1), (0.1, 0.1, 0.1)) for i in range(32)
    ]
    truth = Truth(tuple(objects))
    found = [landmark(i, item.labels[0], item.centers_m[0] + 0.01, size_m=np.full(3, 0.1)) for i, item in enumerate(objects)]
    result = evaluate_landmarks(found, truth)
    drawn = draw_comparison(compare(found, truth, result), result, style, stacked)
    boxes = label_boxes(ET.fromstring(drawn))
    assert len(boxes) >= 28
    for i, a in enumerate(boxes):
        for b in boxes[i + 1 :]:
            assert a[2] <= b[0] + 0.2 or b[2] <= a[0] + 0.2 or a[3] <= b[1] + 0.2 or b[3] <= a[1] + 0.2


def test_strays_are_named_instead_of_drawn():
    found = [*FOUND, landmark(50, "moon", (400, 0, 1))]
    svg = picture(found)
    assert "not drawn, too far away: #50" in [node.text for node in svg.iter(f"{SVG}text")]
    assert len(marks(svg, "map")["false"]) == 1


def test_a_path_that_would_shrink_the_things_is_cut_and_one_outside_is_not_in_the_legend():
    near, far = circle_trajectory(), circle_trajectory()
    far.T_world_camera[:, :2, 3] += 30.0
    words = [{node.text for node in picture(trajectory=path).iter(f"{SVG}text")} for path in (near, far)]
    assert ["camera path" in shown for shown in words] == [True, False]
    extents = [np.ptp(compare(FOUND, TRUTH, RESULT, path).extent, axis=0).max() for path in (None, far)]
    assert extents[0] == extents[1]


def test_an_empty_map_and_a_truth_without_boxes_are_still_a_picture():
    bare = Truth((TruthObject("c", ("cup",), np.zeros((1, 3))),), (FormerPlace("x", "removed", (), np.ones(3)),))
    svg = picture([], bare)
    assert marks(svg, "map") == {"missing": ["cup (c): no landmark"]}
    assert marks(svg, "truth") == {"object": ["cup (c)"], "removed": ["x (x) was taken away from here"]}


def test_the_page_holds_both_pictures_all_scores_and_its_data(tmp_path):
    write_evaluation(tmp_path / "e.html", landmarks=FOUND, truth=TRUTH, result=RESULT, trajectory=circle_trajectory(), title=HOSTILE)
    text = (tmp_path / "e.html").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["e.html"]
    (raw,) = re.findall(r'<script type="application/json" id="report-data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(raw)
    assert data["schema"] == "seo_slam.evaluation/1"
    assert (data["matched"], data["ghosts"], data["duplicates"], data["visible"]["objects"]) == (2, 2, 1, 3)
    assert text.count("</script>") == 2
    assert text.count('class="truth-map') == 2
    assert "alert(" not in text.replace("alert(&quot;", "").replace(raw, "")
    for words in ("all objects present at the end", "those in view for 5 keyframes or more", "label of no class here", "ghost of v"):
        assert words in text
    assert "as given" not in text
    given = evaluate_landmarks(FOUND, TRUTH, truth_count=9)
    assert "as given" in render_evaluation(landmarks=FOUND, truth=TRUTH, result=given)
