"""What flows through the pipeline refuses what cannot be when it is built, and says where."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.errors import FrameError
from seo_slam.records import Trajectory
from seo_slam.testing.worlds import TINY_CAMERA, tiny_frames, tiny_landmarks, tiny_observations
from seo_slam.types import NEW, REJECTED, Association, Detections, Estimate, Frame, Landmarks, Motion, Observations, heaviest

RGB = np.zeros((240, 320, 3), np.uint8)
DEPTH = np.ones((240, 320), np.float32)


def frame(timestamp_s=1.0, rgb=RGB, depth_m=DEPTH, camera=TINY_CAMERA, index=7):
    return Frame(timestamp_s, rgb, depth_m, camera, index)


def with_value(value):
    depth = DEPTH.copy()
    depth[3, 4] = value
    return depth


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"timestamp_s": float("nan")}, "timestamp_s is not finite"),
        ({"timestamp_s": "1.0"}, "timestamp_s is not finite seconds"),
        ({"rgb": None}, "are NoneType, ndarray, Camera; wanted an array"),
        ({"depth_m": DEPTH.tolist()}, "are ndarray, list, Camera; wanted an array"),
        ({"camera": None}, "a Camera"),
        ({"rgb": RGB.astype(np.float32)}, "rgb is float32"),
        ({"rgb": RGB[..., 0]}, "wanted uint8"),
        ({"rgb": RGB[:100]}, "rgb is 320x100, the camera 320x240"),
        ({"depth_m": DEPTH.astype(np.uint16)}, "depth_m is uint16"),
        ({"depth_m": DEPTH.astype(np.float64)}, "depth_m is float64"),
        ({"depth_m": DEPTH[:100]}, "depth_m is float32"),
        ({"depth_m": with_value(np.nan)}, "NaN"),
        ({"depth_m": with_value(np.inf)}, "infinity"),
        ({"depth_m": with_value(-1.0)}, "negative"),
    ],
)
def test_a_bad_frame_is_refused_by_its_number(changes, words):
    with pytest.raises(FrameError, match=rf"frame 7 .*{words}"):
        frame(**changes)


def test_a_frame_without_depth():
    assert not frame(depth_m=None).has_depth
    assert not frame(depth_m=np.zeros_like(DEPTH)).has_depth
    assert frame().has_depth
    assert frame(depth_m=None).depth_m.shape == (240, 320)


BOX = np.array([[1.0, 2.0, 3.0, 4.0]])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"boxes_px": BOX[0]}, "boxes_px: got shape"),
        ({"boxes_px": BOX * np.nan}, "row 0 is not finite"),
        ({"boxes_px": BOX[:, [2, 1, 0, 3]]}, "x0 < x1"),
        ({"labels": ("cup", "cup")}, "boxes_px: got shape"),
        ({"scores": np.array([1.2])}, "wanted 0..1"),
        ({"scores": np.array([-0.1])}, "wanted 0..1"),
        ({"scores": np.array([0.5, 0.5])}, "scores: got shape"),
        ({"masks": np.zeros((1, 4, 4))}, "masks: got float64"),
        ({"masks": np.zeros((2, 4, 4), bool)}, "masks"),
        ({"embeddings": np.zeros((2, 4))}, "embeddings"),
    ],
)
def test_bad_detections_are_refused(changes, words):
    good = Detections(BOX, ("cup",), np.array([0.5]))
    with pytest.raises(FrameError, match=words):
        replace(good, **changes)


@given(st.lists(st.booleans(), min_size=4, max_size=4))
def test_rows_are_picked_by_mask_as_by_number(mask):
    seen = tiny_observations(tiny_landmarks().p_world, ("cup", "keyboard", "book", None))
    by_mask, by_number = seen[np.array(mask)], seen[np.flatnonzero(mask)]
    assert len(by_mask) == sum(mask)
    assert by_mask.labels == by_number.labels == tuple(label for label, kept in zip(seen.labels, mask, strict=True) if kept)
    for name in ("p_camera", "cov_camera", "size_m", "scores", "embeddings", "boxes_px", "truncated", "rows"):
        np.testing.assert_array_equal(getattr(by_mask, name), getattr(by_number, name))
        np.testing.assert_array_equal(getattr(by_mask, name), getattr(seen, name)[np.array(mask)])
    assert len(by_mask.clouds) == sum(mask)
    landmarks = tiny_landmarks()
    assert landmarks[np.array(mask)].ids.tolist() == landmarks.ids[np.array(mask)].tolist()


def test_rows_keep_what_is_not_a_row():
    found = Detections(BOX, ("cup",), np.array([0.5]))
    assert found[np.array([True])].masks is None
    assert found[np.array([False])].boxes_px.shape == (0, 4)


def test_empty_ones_have_their_shapes():
    assert len(Detections.empty()) == 0
    assert Observations.empty(5).embeddings.shape == (0, 5)
    none = Landmarks.from_rows([], embedding_size=6)
    assert (len(none), none.embeddings.shape, none.p_world.shape, none.cov_world.shape) == (0, (0, 6), (0, 3), (0, 3, 3))


@pytest.mark.parametrize("name", ["p_camera", "cov_camera", "size_m", "scores", "boxes_px"])
def test_an_observation_with_nan_is_refused_by_its_row(name):
    seen = tiny_observations(tiny_landmarks().p_world, ("cup",) * 4)
    array = getattr(seen, name).copy()
    array[2] = np.nan
    with pytest.raises(FrameError, match=rf"{name}: row 2 is not finite"):
        replace(seen, **{name: array})


def test_a_landmark_is_given_to_one_observation():
    def association(*ids):
        return Association(np.array(ids, dtype=np.int64), np.full(len(ids), np.nan))

    assert len(association(NEW, NEW, REJECTED, REJECTED, 3).landmark_ids) == 5
    with pytest.raises(FrameError, match="two observations"):
        association(3, NEW, 3)
    with pytest.raises(FrameError, match="costs"):
        Association(np.array([1]), np.zeros(2))


def test_a_motion_must_be_rigid_and_its_covariance_finite():
    assert Motion(np.eye(4), np.eye(6)).status == "ok"
    sheared = np.eye(4)
    sheared[0, 1] = 0.3
    for wrong, words in (
        ((sheared, np.eye(6)), "T_previous_current"),
        ((np.eye(4), np.eye(3)), "covariance"),
        ((np.eye(4), np.full((6, 6), np.nan)), "covariance"),
    ):
        with pytest.raises(FrameError, match=words):
            Motion(*wrong)
    with pytest.raises(FrameError, match="T_world_camera"):
        Motion(np.eye(4), np.eye(6), T_world_camera=sheared)


def test_the_covariance_of_an_estimate_is_that_of_the_pose_alone():
    asked = []
    estimate = Estimate(np.eye(4), lambda ids: asked.append(len(ids)) or np.eye(6 + 3 * len(ids)))
    assert estimate.covariance.shape == (6, 6)
    assert asked == [0]


@pytest.mark.parametrize(
    ("labels", "wanted"), [({}, ""), ({"cup": 0.2, "mug": 0.8}, "mug"), ({"mug": 0.5, "cup": 0.5}, "cup"), ({"x": 0.0}, "x")]
)
def test_the_heaviest_word(labels, wanted):
    assert heaviest(labels) == wanted


def test_a_trajectory_rises():
    poses = np.tile(np.eye(4), (3, 1, 1))
    assert len(Trajectory(np.array([1.0, 2.0, 3.0]), poses)) == 3
    with pytest.raises(FrameError, match="row 2"):
        Trajectory(np.array([1.0, 2.0, 2.0]), poses)
    with pytest.raises(FrameError, match="poses"):
        Trajectory(np.array([1.0, 2.0]), poses)


def test_tiny_frames_are_frames():
    assert [one.index for one in tiny_frames(3)] == [0, 1, 2]


def test_a_landmark_is_called_what_an_agent_said_or_its_heaviest_word():
    rows = tiny_landmarks()
    named = replace(rows, names=("red cup", "", "book", "book"), categories=("cup", "", "", ""))
    bare = replace(rows, names=(), categories=())
    assert [named.name_of(k) for k in range(4)] == ["red cup", "keyboard", "book", "book"]
    assert [bare.name_of(k) for k in range(4)] == ["cup", "keyboard", "book", "book"]
    assert (named.category_of(0), bare.category_of(0)) == ("cup", "")
    chosen = np.array([2, 0])
    assert [named[chosen].name_of(k) for k in range(2)] == ["book", "red cup"]
    assert [bare[chosen].name_of(k) for k in range(2)] == ["book", "cup"]
