"""Which landmarks get a box: by hand-made depth images."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.agents.projection import LEAST_SIDE_PX, visible_boxes, without_covered
from seo_slam.camera import Camera
from seo_slam.geometry import exp, transform_points
from seo_slam.types import Frame, Landmark, Landmarks

CAMERA = Camera(500.0, 500.0, 319.5, 239.5, 640, 480)
EYE = np.eye(4)


def landmarks_at(*p_world, size_m=0.2, sigma_m=0.01, across_m=None):
    rows = [
        Landmark(
            k, "cup", {"cup": 1.0}, np.array(p, dtype=float), sigma_m**2 * np.eye(3), np.full(3, size_m), np.zeros(4), 5, 0.0, 1.0, "stable"
        )
        for k, p in enumerate(p_world, start=1)
    ]
    made = Landmarks.from_rows(rows)
    return made if across_m is None else replace(made, across_m=np.tile(across_m, (len(rows), 1)).astype(float))


def frame_of(depth_m):
    depth = np.broadcast_to(np.asarray(depth_m, dtype=np.float32), (480, 640)).copy()
    return Frame(0.0, np.zeros((480, 640, 3), np.uint8), depth, CAMERA)


def plate_at(p, half_m=0.1):
    """Points of a flat surface that faces the camera."""
    x, y = np.meshgrid(np.linspace(-half_m, half_m, 5), np.linspace(-half_m, half_m, 5))
    return np.array(p, dtype=float) + np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


@pytest.mark.parametrize("surfaces", [None, {1: plate_at((0, 0, 2))}])
@pytest.mark.parametrize(
    ("depth_m", "is_shown"),
    [
        (2.0, True),  # exactly on the surface that was measured: the paper's strict rule would hide it
        (1.95, True),  # a little behind it, as a thing's middle is
        (4.0, True),  # the camera sees farther: it may be gone, and agents are to judge
        (1.2, False),  # behind a wall
        (0.0, False),  # a frame without depth shows nothing
    ],
)
def test_depth_decides(surfaces, depth_m, is_shown):
    assert (1 in visible_boxes(landmarks_at((0, 0, 2)), frame_of(depth_m), EYE, surfaces)) == is_shown


def test_a_large_thing_is_not_hidden_by_its_own_front_and_a_small_one_is():
    front = frame_of(1.75)
    assert visible_boxes(landmarks_at((0, 0, 2), size_m=0.6), front, EYE)
    assert not visible_boxes(landmarks_at((0, 0, 2), size_m=0.1), front, EYE)


def test_an_unsure_position_is_given_more_tolerance():
    assert not visible_boxes(landmarks_at((0, 0, 2), size_m=0.1), frame_of(1.8), EYE)
    assert visible_boxes(landmarks_at((0, 0, 2), size_m=0.1, sigma_m=0.1), frame_of(1.8), EYE)


def test_half_behind_something_is_still_shown_and_more_is_not():
    half, most = np.full((480, 640), 3.0), np.full((480, 640), 3.0)
    half[:, :315] = 1.0
    most[:, :345] = 1.0
    for surfaces in (None, {1: plate_at((0, 0, 2))}):
        assert visible_boxes(landmarks_at((0, 0, 2)), frame_of(half), EYE, surfaces)
        assert not visible_boxes(landmarks_at((0, 0, 2)), frame_of(most), EYE, surfaces)


def test_where_the_sensor_returns_nothing_a_thing_is_not_hidden():
    depth = np.full((480, 640), 2.0)
    depth[150:330, 200:440] = 0.0
    assert visible_boxes(landmarks_at((0, 0, 2)), frame_of(depth), EYE)


@pytest.mark.parametrize("p", [(0, 0, -2), (0, 0, 0), (0, 0, 0.05), (0, 0, 9), (3, 0, 2), (1.28, 0, 2)])
def test_behind_too_far_outside_and_mostly_outside_get_no_box(p):
    assert visible_boxes(landmarks_at(p), frame_of(9.0), EYE) == {}


def test_boxes_of_a_few_pixels_are_left_out():
    size_m = LEAST_SIDE_PX / 500.0 * 4.0
    assert visible_boxes(landmarks_at((0, 0, 4), across_m=(0.9 * size_m, 0.5 * size_m)), frame_of(4.0), EYE) == {}
    assert 1 in visible_boxes(landmarks_at((0, 0, 4), across_m=(1.1 * size_m, 0.5 * size_m)), frame_of(4.0), EYE)


def test_a_box_is_as_large_as_size_and_depth_say():
    box = visible_boxes(landmarks_at((0.1, -0.2, 2), across_m=(0.4, 0.2)), frame_of(2.0), EYE)[1]
    assert box == pytest.approx([319.5 + 25 - 50, 239.5 - 50 - 25, 319.5 + 25 + 50, 239.5 - 50 + 25])


def test_without_a_size_across_the_extent_is_projected():
    box = visible_boxes(landmarks_at((0, 0, 2), size_m=0.2), frame_of(2.0), EYE)[1]
    half = 500.0 * 0.1 / 1.9  # the near side
    assert box == pytest.approx([319.5 - half, 239.5 - half, 319.5 + half, 239.5 + half])


def test_boxes_are_clipped_to_the_image():
    x0, _, x1, _ = visible_boxes(landmarks_at((-1.22, 0, 2), across_m=(0.2, 0.2)), frame_of(2.0), EYE)[1]
    assert x0 == 0.0
    assert x1 == pytest.approx(319.5 - 305 + 25)


def test_no_landmarks_no_boxes():
    assert visible_boxes(landmarks_at(), frame_of(2.0), EYE) == {}


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6))
@settings(max_examples=30)
def test_only_the_camera_relative_to_the_world_matters(xi):
    T = exp(np.array(xi))
    p_camera = np.array([[0.1, 0.0, 2.0], [-0.4, 0.2, 1.5]])
    here = visible_boxes(landmarks_at(*p_camera, across_m=(0.2, 0.1)), frame_of(2.0), EYE)
    there = visible_boxes(landmarks_at(*transform_points(T, p_camera), across_m=(0.2, 0.1)), frame_of(2.0), T)
    assert set(here) == set(there) == {1, 2}
    for k in here:
        assert there[k] == pytest.approx(here[k], abs=1e-6)


def test_surfaces_of_any_length_are_looked_at():
    surfaces = {1: plate_at((0, 0, 2))[:1], 2: np.repeat(plate_at((0.4, 0, 2)), 30, axis=0), 3: np.zeros((0, 3))}
    depth = np.full((480, 640), 2.0)
    depth[:, 390:460] = 1.0  # before the second
    shown = visible_boxes(landmarks_at((0, 0, 2), (0.4, 0, 2), (-0.4, 0, 2)), frame_of(depth), EYE, surfaces)
    assert set(shown) == {1, 3}


def test_a_thing_that_mostly_lies_behind_a_nearer_one_is_not_drawn():
    boxes = {
        7: np.array([0.0, 0, 100, 100]),
        3: np.array([10.0, 10, 60, 60]),
        5: np.array([10.0, 10, 60, 60]),
        9: np.array([80.0, 80, 200, 200]),
    }
    cleared = without_covered(boxes, {7: 1.0, 3: 2.0, 5: 1.2, 9: 3.0})
    assert cleared.left_out == (3,)  # 5 lies as near as 7: the two may be one thing twice; 9 is hardly covered
    assert cleared.kept == (7, 5, 9)


def test_one_box_covers_nothing():
    assert without_covered({4: np.array([0.0, 0, 1, 1])}, {4: 1.0}).kept == (4,)
    assert without_covered({}, {}).kept == ()
