"""YOLOX: made-up networks whose answer is known, and the real one on a real desk."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from handmade_onnx import constant_model

from seo_slam import registry
from seo_slam.backends.coco_names import COCO_NAMES
from seo_slam.backends.yolox_detector import YoloxDetector, suppress
from seo_slam.camera import Camera
from seo_slam.config import Component
from seo_slam.errors import BackendError, ConfigError
from seo_slam.types import Frame

ANCHORS = 64 + 16 + 4  # of a 64x64 input, strides 8, 16, 32


def frame(width=128, height=96):
    camera = Camera(100.0, 100.0, width / 2, height / 2, width, height)
    return Frame(0.0, np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.float32), camera)


@pytest.fixture
def make(tmp_path):
    names = tmp_path / "names.txt"
    names.write_text("cup\nbook\n")

    def build(rows, size=64, anchors=ANCHORS, **options):
        """A network of two classes: ``rows`` are anchor -> (x, y, w, h, objectness, cup, book), the rest sees nothing."""
        answer = np.zeros((1, anchors, 7), np.float32)
        for anchor, row in rows.items():
            answer[0, anchor] = row
        weights = constant_model({"images": (1, 3, size, size)}, answer, tmp_path / "net.onnx")
        return YoloxDetector(weights, labels=names, **options)

    return build


def test_boxes_are_decoded_on_the_grid_and_scaled_back(make):
    # Anchor 10: stride 8, column 2, row 1. 128 pixels were halved to 64.
    detections = make({10: (0.5, 0.25, np.log(2.0), np.log(1.0), 0.9, 0.1, 0.8)}).detect(frame())
    assert detections.labels == ("book",)
    assert detections.scores == pytest.approx([0.72])
    assert detections.boxes_px[0] == pytest.approx([24.0, 12.0, 56.0, 28.0], abs=1e-4)


def test_coarser_strides(make):
    # Anchor 64 + 5: stride 16, column 1, row 1; anchor 80: stride 32, column 0, row 0.
    detections = make({69: (0, 0, 0, 0, 0.9, 1, 0), 80: (0.5, 0.5, 0, 0, 0.8, 0, 1)}).detect(frame())
    assert detections.labels == ("cup", "book")
    assert detections.boxes_px == pytest.approx(np.array([[16, 16, 48, 48], [0, 0, 64, 64]]), abs=1e-4)


def test_outputs_that_are_decoded_already(make):
    rows = {10: (20.0, 10.0, 16.0, 8.0, 0.9, 0.0, 1.0), 83: (60.0, 40.0, 5.0, 5.0, 0.0, 0.0, 0.0)}
    assert make(rows).detect(frame()).boxes_px[0] == pytest.approx([24.0, 12.0, 56.0, 28.0], abs=1e-4)


def test_score_is_kept_from_the_threshold_on(make):
    rows = {10: (0.5, 0.5, 1, 1, 0.5, 0.5, 0.0)}
    assert len(make(rows, score=0.25).detect(frame())) == 1
    assert len(make(rows, score=0.26).detect(frame())) == 0
    assert len(make({}, score=0.25).detect(frame())) == 0


def test_suppression_is_a_matter_of_one_class(make):
    same = (0.5, 0.5, 1, 1)
    rows = {10: (*same, 0.9, 1, 0), 11: (-0.5, 0.5, 1, 1, 0.8, 0.9, 0), 12: (-1.5, 0.5, 1, 1, 0.7, 0, 1)}
    assert make(rows).detect(frame()).labels == ("cup", "book")


def test_boxes_are_clipped_and_what_is_beside_the_picture_is_dropped(make):
    # The picture fills the upper 48 of 64 rows; anchor 58 is at row 7, in the grey.
    rows = {0: (0.5, 0.5, np.log(4), np.log(4), 0.9, 1, 0), 58: (0.5, 0.5, 0, 0, 0.9, 1, 0)}
    detections = make(rows).detect(frame())
    assert detections.boxes_px == pytest.approx(np.array([[0, 0, 40, 40]]), abs=1e-4)


def test_other_image_size_than_before_leaves_no_trace(tmp_path):
    detector = YoloxDetector(
        constant_model({"images": (1, 3, 64, 64)}, np.zeros((1, ANCHORS, 85)), tmp_path / "net.onnx"),
    )
    detector._place(np.full((64, 64, 3), 9, np.uint8))
    detector._place(np.zeros((48, 64, 3), np.uint8))
    assert (detector._canvas[0, :, 48:] == 114).all()
    assert (detector._canvas[0, :, :48] == 0).all()


def test_rgb_becomes_bgr(tmp_path):
    detector = YoloxDetector(constant_model({"images": (1, 3, 64, 64)}, np.zeros((1, ANCHORS, 85)), tmp_path / "net.onnx"))
    detector._place(np.full((64, 64, 3), (10, 20, 30), np.uint8))
    assert detector._canvas[0, :, 5, 5].tolist() == [30, 20, 10]


def test_suppress_keeps_what_only_a_suppressed_box_overlaps():
    boxes = np.array([[0, 0, 10, 10], [4, 0, 14, 10], [8, 0, 18, 10]], dtype=float)
    assert suppress(boxes, np.array([0.9, 0.8, 0.7]), np.zeros(3, np.int64), 0.4).tolist() == [0, 2]


def test_missing_weights(tmp_path):
    with pytest.raises(ConfigError, match=r"nothing\.onnx: no such weights file"):
        YoloxDetector(tmp_path / "nothing.onnx")


def test_weights_that_are_no_model(tmp_path):
    weights = tmp_path / "text.onnx"
    weights.write_text("not a model")
    with pytest.raises(BackendError, match=r"text\.onnx: not a model"):
        YoloxDetector(weights)


@pytest.mark.parametrize(
    ("inputs", "output", "words"),
    [
        ({"images": (1, 3, 64, 64)}, (1, ANCHORS, 5), "output is"),
        ({"images": (1, 3, 64, 64)}, (1, 100, 85), "wanted \\(1, 84, 5 \\+ classes\\)"),
        ({"images": (1, 3, 64, 64)}, (7,), "output is"),
        ({"images": (1, 1, 64, 64)}, (1, ANCHORS, 85), "input is"),
        ({"images": (1, 3, 0, 0)}, (1, ANCHORS, 85), "fixed size"),
        ({"images": (2, 3, 64, 64)}, (1, ANCHORS, 85), "input is"),
        ({"a": (1, 3, 64, 64), "b": (1, 3, 64, 64)}, (1, ANCHORS, 85), "input is"),
        ({}, (1, ANCHORS, 85), "input is missing"),
    ],
)
def test_another_kind_of_model(tmp_path, inputs, output, words):
    weights = constant_model(inputs, np.zeros(output), tmp_path / "other.onnx")
    with pytest.raises(BackendError, match=rf"other\.onnx: not a YOLOX model.*{words}"):
        YoloxDetector(weights)


def test_names_must_be_as_many_as_classes(make, tmp_path):
    weights = constant_model({"images": (1, 3, 64, 64)}, np.zeros((1, ANCHORS, 7)), tmp_path / "two.onnx")
    with pytest.raises(ConfigError, match="2 classes, the names of COCO 80"):
        YoloxDetector(weights)
    with pytest.raises(ConfigError, match=r"gone\.txt"):
        YoloxDetector(weights, labels=tmp_path / "gone.txt")


@pytest.mark.parametrize("options", [{"score": 1.5}, {"score": float("nan")}, {"nms_iou": -0.1}, {"threads": 0}])
def test_options_out_of_range(make, options):
    with pytest.raises(ConfigError, match="yolox: got"):
        make({}, **options)


def test_names():
    assert len(set(COCO_NAMES)) == 80
    assert COCO_NAMES[62] == "tv"
    assert COCO_NAMES[67] == "cell phone"


def desk(shared, number):
    file = sorted((shared / "data/tum_fr1_xyz/rgb").iterdir())[number]
    camera = Camera(517.3, 516.5, 318.6, 255.3, 640, 480)
    rgb = np.ascontiguousarray(cv2.imread(str(file))[:, :, ::-1])
    return Frame(float(file.stem), rgb, np.zeros((480, 640), np.float32), camera)


def test_real_desk(shared):
    detector = registry.create("detector", Component(name="yolox", options={"weights": shared / "models/yolox_nano/yolox_nano.onnx"}))
    first = desk(shared, 0)
    detections = detector.detect(first)
    assert {"tv", "keyboard", "cup", "book"} <= set(detections.labels)
    tv = detections.boxes_px[detections.labels.index("tv")]
    assert tv == pytest.approx([296, 110, 590, 290], abs=12)
    keyboard = detections.boxes_px[detections.labels.index("keyboard")]
    assert keyboard == pytest.approx([330, 338, 590, 474], abs=12)
    again = detector.detect(replace(first, index=1))
    assert np.array_equal(again.boxes_px, detections.boxes_px)
    assert np.array_equal(again.scores, detections.scores)
    assert (np.diff(detections.scores) <= 0).all()
