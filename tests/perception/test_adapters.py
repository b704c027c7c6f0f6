"""Whatever a detector returns becomes Detections that fit the image, or an error that says which row of which frame is wrong."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.perception.adapters import to_detections
from seo_slam.types import Detections, Frame

CAMERA = Camera(50.0, 50.0, 20.0, 15.0, 40, 30)
FRAME = Frame(1.5, np.zeros((30, 40, 3), np.uint8), np.zeros((30, 40), np.float32), CAMERA, index=7)
BOXES = [[1.0, 2.0, 11.0, 12.0], [20.0, 5.0, 30.0, 25.0]]


def test_own_detections_pass_unchanged():
    masks = np.zeros((2, 30, 40), bool)
    masks[0, 3:6, 4:9] = True
    mine = Detections(np.array(BOXES), ("cup", None), np.array([0.25, 1.0]), masks, np.eye(2))
    seen = to_detections(mine, FRAME)
    assert np.array_equal(seen.boxes_px, mine.boxes_px)
    assert seen.labels == ("cup", None)
    assert np.array_equal(seen.scores, mine.scores)
    assert np.array_equal(seen.masks, masks)
    assert np.array_equal(seen.embeddings, np.eye(2))


def test_layout_of_supervision():
    found = SimpleNamespace(
        xyxy=np.array(BOXES, dtype=np.float32),
        mask=np.zeros((2, 30, 40), bool),
        confidence=np.array([0.5, 0.75], dtype=np.float32),
        class_id=np.array([3, 4]),
        tracker_id=None,
        data={"class_name": np.array(["cup", "book"])},
        metadata={},
    )
    seen = to_detections(found, FRAME)
    assert seen.labels == ("cup", "book")
    assert seen.scores.tolist() == [0.5, 0.75]
    assert seen.boxes_px.dtype == np.float64
    assert seen.masks is not None


def test_supervision_without_names_or_confidence():
    found = SimpleNamespace(xyxy=np.array(BOXES), mask=None, confidence=None, class_id=np.array([3, 4]), data={})
    seen = to_detections(found, CAMERA)
    assert seen.labels == ("class 3", "class 4")
    assert seen.scores.tolist() == [1.0, 1.0]
    found.class_id = None
    assert to_detections(found, CAMERA).labels == (None, None)


def test_supervision_empty():
    found = SimpleNamespace(xyxy=np.empty((0, 4)), mask=None, confidence=np.array([]), class_id=np.array([], int), data={"class_name": []})
    assert len(to_detections(found, FRAME)) == 0


@pytest.mark.parametrize("nothing", [[], np.zeros((0, 512)), np.zeros((0, 30, 40))])
def test_nothing_may_be_said_in_empty_lists(nothing):
    found = to_detections({"boxes": [], "labels": [], "scores": [], "masks": [], "embeddings": nothing}, FRAME)
    assert len(found) == 0
    assert found.embeddings is None


@pytest.mark.parametrize("boxes", ["boxes", "boxes_px", "xyxy"])
def test_mappings_and_objects(boxes):
    values = {boxes: BOXES, "labels": ["cup", "  "], "scores": [0.1, 0.2], "masks": [None, np.ones((1, 30, 40)) * 0.7]}
    for found in (values, SimpleNamespace(**values)):
        seen = to_detections(found, FRAME)
        assert seen.labels == ("cup", None)
        assert not seen.masks[0].any()
        assert seen.masks[1].all()


def test_words_win_over_class_numbers():
    assert to_detections({"boxes": BOXES, "labels": [1, 2], "text_labels": ["cup", "mug"]}, FRAME).labels == ("cup", "mug")


class _Tensor:
    """As torch: no array before it is detached and on the CPU."""

    def __init__(self, values):
        self._values = values

    def detach(self):
        return SimpleNamespace(cpu=lambda: np.asarray(self._values))

    def __array__(self, *args, **kwargs):
        raise TypeError("on the GPU")


def test_tensors():
    seen = to_detections({"boxes": _Tensor(BOXES), "scores": _Tensor([0.5, 0.5]), "labels": _Tensor([1, 2])}, FRAME)
    assert seen.labels == ("class 1", "class 2")


def test_boxes_are_clipped_and_slivers_dropped():
    found = {"boxes": [[-5, -5, 10, 10], [35, 25, 45, 35], [-9, 3, 0.5, 20], [5, 5, 5.5, 20]], "labels": list("abcd"), "scores": [0.5] * 4}
    seen = to_detections(found, FRAME)
    assert seen.labels == ("a", "b", "d")  # c leaves half a pixel in the image; d is thin by itself
    assert seen.boxes_px.tolist() == [[0, 0, 10, 10], [35, 25, 40, 30], [5, 5, 5.5, 20]]


coordinates = st.floats(-60, 100, allow_nan=False, width=32)


@given(arrays(np.float64, st.tuples(st.integers(0, 6), st.just(4)), elements=coordinates))
def test_twice_is_once(boxes):
    boxes = np.concatenate([np.minimum(boxes[:, :2], boxes[:, 2:]), np.maximum(boxes[:, :2], boxes[:, 2:]) + 0.25], axis=1)
    inside = (boxes[:, :2] < (40, 30)).all(axis=1) & (boxes[:, 2:] > 0).all(axis=1)
    once = to_detections({"boxes": boxes[inside]}, FRAME)
    twice = to_detections(once, FRAME)
    assert np.array_equal(once.boxes_px, twice.boxes_px)
    assert (once.boxes_px >= 0).all()
    assert (once.boxes_px <= [40, 30, 40, 30]).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"boxes": [[np.nan, 2, 11, 12], BOXES[1]]}, ["row 0", "not finite"]),
        ({"scores": [0.5, np.nan]}, ["row 1", "not finite"]),
        ({"boxes": [BOXES[0], [40, 5, 50, 25]]}, ["row 1", "wholly outside", "40x30"]),
        ({"boxes": [BOXES[0], [-9, 5, 0, 25]]}, ["row 1", "wholly outside"]),
        ({"boxes": [[11, 2, 1, 12], BOXES[1]]}, ["row 0", "x0 < x1"]),
        ({"boxes": [[1, 2, 1, 12], BOXES[1]]}, ["row 0", "x0 < x1"]),
        ({"labels": ["cup"]}, ["2 boxes", "1 labels"]),
        ({"scores": [0.5]}, ["2 boxes", "1 scores"]),
        ({"scores": [0.5, 1.5]}, ["row 1", "1.5", "0..1"]),
        ({"masks": np.zeros((2, 40, 30), bool)}, ["row 0", "(40, 30)", "(30, 40)"]),
        ({"masks": [None]}, ["2 boxes", "1 masks"]),
        ({"labels": ["cup", 3.5]}, ["row 1", "float"]),
        ({"labels": "cup"}, ["one text"]),
        ({"boxes": [1, 2, 3, 4]}, ["(4,)", "(N, 4)"]),
        ({"boxes": "all of them"}, ["not an array of numbers"]),
        ({"embeddings": [[1.0], [np.inf]]}, ["row 1", "embedding"]),
        ({"embeddings": []}, ["(0,)", "(N, D)"]),
    ],
)
def test_errors_name_frame_source_and_row(changes, words):
    found = {"boxes": BOXES, "labels": ["cup", "book"], "scores": [0.5, 0.5]} | changes
    with pytest.raises(FrameError) as caught:
        to_detections(found, FRAME, "my detector")
    for word in ("my detector", "frame 7", *words):
        assert word in str(caught.value)


def test_something_else_is_refused_by_type():
    with pytest.raises(FrameError, match="got list, wanted Detections or something with boxes"):
        to_detections([1, 2], FRAME)
