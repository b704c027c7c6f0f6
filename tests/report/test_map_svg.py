import re
import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_desk import circle_trajectory, landmark, make_desk

from seo_slam.records import Trajectory
from seo_slam.report.label_layout import place_labels, text_width_px
from seo_slam.report.map_svg import NARROW, WIDE, make_scene, render_map, sigma_ellipse
from seo_slam.report.projection import choose_projection, far_away, fit_view, hull

EMPTY = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
coordinates = st.floats(-1000, 1000, allow_nan=False, width=32)
planes = st.lists(st.tuples(coordinates, coordinates), max_size=30).map(lambda p: np.array(p, dtype=np.float64).reshape(-1, 2))


def draw(landmarks, gravity="recorded poses", trajectory=EMPTY, style=WIDE):
    return ET.fromstring(render_map(make_scene(landmarks, gravity, trajectory), style, lambda label: "c0"))


def find(svg, name):
    return [node for node in svg.iter() if name in node.get("class", "").split()]


@given(planes, st.sampled_from([WIDE, NARROW]))
def test_a_view_holds_all_points_inside_its_margin(points, style):
    view = fit_view(points, style.width_px, style.tallest, style.flattest, style.margin_px)
    pixels = view.pixels(points)
    low, high = style.margin_px - 1e-3, np.array([view.width_px, view.height_px]) - style.margin_px + 1e-3
    assert (pixels >= low).all()
    assert (pixels <= high).all()
    assert style.flattest * style.width_px - 1 <= view.height_px <= style.tallest * style.width_px + 1


def test_y_points_up_in_the_picture_and_x_right():
    view = fit_view(np.array([[-1.0, -1.0], [1.0, 1.0]]), 400, 1.0, 1.0, 20)
    (x0, y0), (x1, y1) = view.pixels(np.array([[0.0, 0.0], [0.5, 0.5]]))
    assert x1 > x0
    assert y1 < y0


@given(planes)
def test_grid_lines_are_where_their_metres_are(points):
    view = fit_view(points, 400, 1.2, 0.5, 20)
    step = view.grid_step_m(50)
    for axis in (0, 1):
        lines = list(view.lines(axis, step))
        for metres, at_px in lines:
            point = np.zeros(2)
            point[axis] = metres
            assert view.pixels(point)[axis] == pytest.approx(at_px, abs=0.01)
        assert all(abs(b[1] - a[1]) == pytest.approx(step * view.px_per_m) for a, b in pairwise(lines))
        assert step * view.px_per_m >= 50


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(0, 300), st.floats(0, 200), st.text(max_size=12)), max_size=40))
def test_labels_cover_neither_each_other_nor_obstacles_and_stay_inside(items):
    points = np.array([item[:2] for item in items]).reshape(-1, 2)
    texts = [item[2] for item in items]
    bounds = (0.0, 0.0, 300.0, 200.0)
    obstacles = np.array([[100.0, 50.0, 160.0, 90.0]])
    boxes = [p.box_px for p in place_labels(points, texts, 12, bounds, obstacles) if p]
    for i, a in enumerate(boxes):
        assert a[0] >= 0
        assert a[1] >= 0
        assert a[2] <= 300
        assert a[3] <= 200
        for b in [*boxes[i + 1 :], (100.0, 50.0, 160.0, 90.0)]:
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]


def test_a_label_alone_stands_right_of_its_point_and_a_crowded_one_gets_a_leader():
    bounds = (0.0, 0.0, 300.0, 200.0)
    (alone,) = place_labels(np.array([[100.0, 100.0]]), ["cup"], 12, bounds, np.zeros((0, 4)))
    assert alone.box_px[0] > 100
    assert not alone.leader
    crowd = place_labels(np.tile([150.0, 100.0], (14, 1)), ["cup"] * 14, 12, bounds, np.zeros((0, 4)))
    assert any(p and p.leader for p in crowd)


def test_wide_letters_are_given_more_room():
    assert text_width_px("椅子", 10) > text_width_px("ab", 10)


def test_an_ellipse_has_the_axes_and_the_angle_of_its_covariance():
    angle = np.deg2rad(30)
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    major, minor, turned = sigma_ellipse(R @ np.diag([0.04, 0.01]) @ R.T, sigmas=2)
    assert (major, minor) == pytest.approx((0.4, 0.2))
    assert np.tan(turned) == pytest.approx(np.tan(angle))


@given(planes.filter(lambda p: len(p) >= 3))
def test_a_hull_is_convex_and_holds_every_point(points):
    corners = hull(points)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, rest = b - a, points - a
        side = edge[0] * rest[:, 1] - edge[1] * rest[:, 0]
        assert len(corners) < 3 or (side >= -1e-6 * max(1.0, np.abs(points).max() ** 2)).all()


def test_a_known_world_is_seen_from_above():
    projection = choose_projection("recorded poses", circle_trajectory())
    assert projection.points(np.array([1.0, 2.0, 3.0])).tolist() == [1.0, 2.0]


def test_without_gravity_the_first_camera_gives_right_and_ahead():
    T = np.eye(4)[None].copy()
    T[0, :3, :3] = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # looks along world x, its right is world -y
    T[0, :3, 3] = [5.0, 0.0, 0.0]
    projection = choose_projection("unknown", Trajectory(np.zeros(1), T))
    assert projection.points(np.array([7.0, -1.0, 0.3])) == pytest.approx([1.0, 2.0])
    assert "not known" in projection.caption
    assert choose_projection("unknown", EMPTY).axes.shape == (2, 3)


def test_one_stray_point_is_far_and_a_spread_out_flat_is_not():
    rng = np.random.default_rng(0)
    assert not far_away(rng.uniform(-20, 20, (50, 2))).any()
    points = np.concatenate([rng.uniform(-1, 1, (20, 2)), [[60.0, 0.0]], [[np.nan, 0.0]]])
    assert np.flatnonzero(far_away(points)).tolist() == [20, 21]


@pytest.mark.parametrize("style", [WIDE, NARROW])
@pytest.mark.parametrize("gravity", ["recorded poses", "unknown"])
def test_the_map_shows_every_landmark_with_footprint_ellipse_and_link(style, gravity):
    desk = make_desk(9)
    everything = (*desk.map.landmarks, *desk.map.tentative)
    svg = draw(everything, gravity, desk.trajectory, style)
    groups = find(svg, "landmark")
    assert sorted(int(g.get("data-id")) for g in groups) == [m.id for m in everything]
    assert all(g.get("href") == f"#landmark-{g.get('data-id')}" for g in groups)
    assert len(find(svg, "footprint")) == len(find(svg, "sigma")) == len(find(svg, "dot")) == 9
    assert len(find(svg, "path")) == 1
    assert len(find(svg, "camera")) == 2
    assert len(find(svg, "scale")) == 1


def test_ellipse_and_footprint_have_their_true_size():
    svg = draw([landmark(1, sigma_m=0.02, size_m=np.array([0.4, 0.2, 0.1]))])  # sigma 0.02 along x, 0.04 along y
    (bar,) = (node for node in svg.iter() if node.get("d", "").startswith("M") and node.get("d", "").count("v") == 2)
    left, right = (float(x) for x in re.findall(r"M([\d.]+).*H([\d.]+)", bar.get("d"))[0])
    text = find(svg, "scale")[0][1].text
    bar_m = float(text.split()[0]) * (0.01 if text.endswith("cm") else 1.0)
    px_per_m = (right - left) / bar_m
    (ellipse,), (box,) = find(svg, "sigma"), find(svg, "footprint")
    assert float(ellipse.get("rx")) / px_per_m == pytest.approx(0.08, rel=0.01)
    assert float(ellipse.get("ry")) / px_per_m == pytest.approx(0.04, rel=0.01)
    corners = np.array([[float(v) for v in corner.split(",")] for corner in box.get("points").split()])
    assert np.ptp(corners, axis=0) / px_per_m == pytest.approx([0.4, 0.2], rel=0.01)


def test_strays_are_left_out_and_named():
    near = [landmark(i, position=(0.1 * i, 0.0, 0.0)) for i in range(6)]
    scene = make_scene([*near, landmark(50, position=(90.0, 0, 0)), landmark(51, position=(np.nan, 0, 0))], "x", EMPTY)
    assert scene.left_out == (50, 51)
    assert len(scene.drawn) == 6
    tentative = landmark(60, position=(2.9, 0, 0), state="tentative")
    assert make_scene([*near, tentative], "x", EMPTY).left_out == (60,)


def test_a_map_of_nothing_is_still_a_picture():
    svg = draw([])
    assert find(svg, "grid")
    assert not find(svg, "landmark")


def test_a_landmark_of_no_size_and_no_certainty_is_drawn():
    broken = landmark(1, size_m=np.zeros(3), covariance_m2=np.full((3, 3), np.nan))
    assert len(find(draw([broken]), "dot")) == 1


def test_a_long_trajectory_is_thinned_but_keeps_its_end():
    svg = draw([], trajectory=circle_trajectory(5000))
    (path,) = find(svg, "path")
    points = path.get("points").split()
    assert len(points) <= 802
    end = find(svg, "end")[0]
    circle = next(node for node in end if node.tag == "circle")
    assert points[-1] == f"{circle.get('cx')},{circle.get('cy')}"
