"""The picture of a search: well-formed, with what was known, tried and driven; nothing from a label can steer it."""

import xml.etree.ElementTree as ET

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Volatile
from seo_slam.report.navigation_svg import STYLE, Search, navigation_svg

SVG = "{http://www.w3.org/2000/svg}"
FEATURE = np.array([1.0, 0.0])


def anchor(anchor_id, x, label, *carried):
    corners = np.array([[x, 0.0], [x + 1.0, 0.0], [x + 1.0, 0.6], [x, 0.6]])
    volatiles = tuple(Volatile(word, FEATURE, "on", 50 + k) for k, word in enumerate(carried))
    return Anchor(anchor_id, label, FEATURE, corners, 9, (0.0, 0.7), 0.7, volatiles)


def layout():
    floor = np.ones((20, 40), dtype=np.bool_)
    walls = np.zeros_like(floor)
    walls[0] = True
    return Layout(np.array([-1.0, -1.0]), 0.1, walls, np.roll(walls, 3, axis=0), floor, np.zeros(floor.shape, dtype=np.int16))


def drawn(**more):
    known = AbstractMap((anchor(1, 0.0, "desk", "cup", "<b>mug</b>"), anchor(2, 1.8, "shelf")), layout())
    way = np.array([[-0.5, -0.5], [0.2, -0.5], [0.5, -0.3]])
    planned = ((1, way), (7, way + 0.1))
    return ET.fromstring(navigation_svg(Search(known, way, planned, "the cup & co", "found it", **more)))


def classes(root):
    return [element.get("class") for element in root.iter() if element.get("class")]


def test_everything_is_in_the_picture():
    root = drawn(target_world=np.array([0.5, 0.3, 0.8]), believed_world=np.array([0.6, 0.3, 0.8]))
    found = classes(root)
    assert found.count("visited") == 1
    assert found.count("anchor") == 1
    assert found.count("planned") == 2 + 1  # and in the legend
    assert found.count("path") == 1 + 1
    assert {"floor", "walls", "obstacles", "start", "stop", "within", "target", "believed"} <= set(found)
    numbers = [element.text for element in root.iter(f"{SVG}text") if element.get("class") == "number"]
    assert numbers == ["1", "2"]
    texts = " ".join(element.text or "" for element in root.iter(f"{SVG}text"))
    for words in ("the cup & co", "found it", "desk: cup", "shelf", "true place, 1 m around it"):
        assert words in texts
    assert not list(root.iter(f"{SVG}b"))


def test_what_is_not_known_is_not_drawn():
    found = set(classes(drawn()))
    assert not found & {"within", "target", "believed"}


def test_an_empty_map_is_a_picture_too():
    search = Search(AbstractMap(()), np.array([[0.0, 0.0]]))
    root = ET.fromstring(navigation_svg(search))
    assert float(root.get("width")) == STYLE.width_px


def test_the_way_lies_where_it_was_driven():
    root = drawn()
    inner = next(element for element in root.iter(f"{SVG}svg") if element is not root)
    line = next(element for element in inner if element.get("class") == "path")
    points = np.array([[float(v) for v in pair.split(",")] for pair in line.get("points").split()])
    step_m, step_px = np.array([0.7, 0.0]), points[1] - points[0]
    assert step_px[1] == 0.0
    scale = step_px[0] / step_m[0]
    np.testing.assert_allclose(points[2] - points[1], [0.3 * scale, -0.2 * scale], atol=0.2)
