"""Recorded detections come back bit for bit, and a file that is wrong is refused by line before anything runs."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam import registry
from seo_slam.backends.recorded_detector import DetectionRecorder, RecordedDetector
from seo_slam.camera import Camera
from seo_slam.config import Component
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.perception.run_length import encode_mask
from seo_slam.types import Detections, Frame

CAMERA = Camera(50.0, 50.0, 10.0, 8.0, 20, 16)


def frame(timestamp_s):
    return Frame(timestamp_s, np.zeros((16, 20, 3), np.uint8), np.zeros((16, 20), np.float32), CAMERA)


@st.composite
def detections(draw):
    n = draw(st.integers(0, 4))
    lows = draw(st.lists(st.tuples(st.floats(0, 9), st.floats(0, 9)), min_size=n, max_size=n))
    sides = draw(st.lists(st.tuples(st.floats(1e-3, 9), st.floats(1e-3, 6)), min_size=n, max_size=n))
    boxes = np.array([(x, y, x + w, y + h) for (x, y), (w, h) in zip(lows, sides, strict=True)]).reshape(n, 4)
    labels = tuple(draw(st.lists(st.none() | st.text(max_size=5), min_size=n, max_size=n)))
    scores = np.array(draw(st.lists(st.floats(0, 1), min_size=n, max_size=n)), dtype=np.float64)
    masks = None
    if draw(st.booleans()):
        masks = np.zeros((n, 16, 20), dtype=bool)
        for row in range(n):
            if draw(st.booleans()):
                masks[row, draw(st.integers(0, 15)) :, : draw(st.integers(0, 20))] = True
    return Detections(boxes, labels, scores, masks)


def same(a, b):
    masks = a.masks is b.masks is None or np.array_equal(a.masks, b.masks)
    return a.boxes_px.tobytes() == b.boxes_px.tobytes() and a.labels == b.labels and a.scores.tobytes() == b.scores.tobytes() and masks


@settings(max_examples=60, deadline=None)
@given(st.lists(detections(), max_size=3), st.floats(0, 2e9))
def test_recorded_then_replayed_is_equal_to_the_bit(tmp_path_factory, seen, start_s):
    path = tmp_path_factory.mktemp("recorded") / "detections.jsonl"
    frames = [frame(start_s + 0.033 * k) for k in range(len(seen))]
    with DetectionRecorder(path) as recorder:
        for one, found in zip(frames, seen, strict=True):
            recorder.record(one, found)
    replay = RecordedDetector(path)
    replay.check_against(CAMERA)
    assert len(replay) == len(seen)
    assert all(same(replay.detect(one), found) for one, found in zip(frames, seen, strict=True))


def test_lines_are_on_disk_before_the_file_is_closed(tmp_path):
    path = tmp_path / "detections.jsonl"
    recorder = DetectionRecorder(path)
    recorder.record(frame(1.0), Detections(np.array([[1.0, 2, 3, 4]]), ("cup",), np.array([0.1 + 0.2])))
    assert json.loads(path.read_text()) == {
        "timestamp_s": 1.0,
        "boxes_px": [[1, 2, 3, 4]],
        "labels": ["cup"],
        "scores": [0.30000000000000004],
    }
    recorder.close()
    recorder.close()


def test_recorder_needs_a_place(tmp_path):
    with pytest.raises(DatasetError, match="cannot be written"):
        DetectionRecorder(tmp_path / "no" / "such" / "folder.jsonl")


GOOD = {"timestamp_s": 1.0, "boxes_px": [[1, 2, 8, 9], [-3, 0, 5, 5]], "labels": ["cup", None], "scores": [0.9, 0.3]}


@pytest.fixture
def write(tmp_path):
    def lines(*values):
        path = tmp_path / "detections.jsonl"
        path.write_text("".join((v if isinstance(v, str) else json.dumps(v)) + "\n" for v in values))
        return path

    return lines


def test_frames_without_a_line_and_stamps_that_are_rounded(write):
    detector = registry.create("detector", Component(name="recorded", options={"path": str(write(GOOD, "", GOOD | {"timestamp_s": 2.0}))}))
    assert len(detector.detect(frame(1.5))) == 0
    assert len(detector.detect(frame(2.0004))) == 2
    assert len(detector.detect(frame(2.0006))) == 0
    assert detector.detect(frame(1.0)).labels == ("cup", None)


def test_nearest_line_wins(write):
    detector = RecordedDetector(write(GOOD, GOOD | {"timestamp_s": 1.0002, "labels": ["mug", "mug"]}))
    assert detector.detect(frame(1.0)).labels == ("cup", None)
    assert detector.detect(frame(1.0002)).labels == ("mug", "mug")


def test_score_is_kept_from_the_threshold_on(write):
    path = write(GOOD)
    assert len(RecordedDetector(path, score=0.3).detect(frame(1.0))) == 2
    assert RecordedDetector(path, score=0.31).detect(frame(1.0)).labels == ("cup",)
    with pytest.raises(ConfigError, match="score"):
        RecordedDetector(path, score=2)


def test_an_empty_file_is_a_recording_without_detections(write):
    assert len(RecordedDetector(write()).detect(frame(1.0))) == 0


def test_packed_and_missing_masks(write):
    mask = np.zeros((16, 20), bool)
    mask[:2, 0] = True
    detector = RecordedDetector(write(GOOD | {"masks": [{"size": [16, 20], "counts": "02n9"}, None]}))
    seen = detector.detect(frame(1.0))
    assert np.array_equal(seen.masks[0], mask)
    assert not seen.masks[1].any()
    assert encode_mask(mask)["counts"] == [0, 2, 318]


def without(key):
    return {k: v for k, v in GOOD.items() if k != key}


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ('{"timestamp_s": 2.0, "boxes_px": [[1', "not JSON"),
        ('{"timestamp_s": NaN, "boxes_px": [], "labels": [], "scores": []}', "NaN"),
        (GOOD | {"boxes_px": [[1, 2, 8, "NaN"], [0, 0, 5, 5]]}, "box 0"),
        ('{"timestamp_s": 2.0, "boxes_px": [[1, 2, 1e999, 4]], "labels": [null], "scores": [0.5]}', "box 0.*finite"),
        ("[1, 2]", "JSON list"),
        (without("labels"), "missing labels"),
        (GOOD | {"label": []}, "unknown 'label'"),
        (GOOD | {"labels": ["cup"]}, "2 boxes_px, but 1 labels"),
        (GOOD | {"scores": [0.5]}, "2 boxes_px, but 1 scores"),
        (GOOD | {"masks": [None]}, "2 boxes_px, but 1 masks"),
        (GOOD | {"labels": "cups"}, "labels is 'cups', wanted a list"),
        (GOOD | {"labels": ["cup", 3]}, "label 1 is 3"),
        (GOOD | {"boxes_px": [[1, 2, 8, 9], [5, 0, 5, 5]]}, "box 1.*x0 < x1"),
        (GOOD | {"boxes_px": [[1, 2, 8], [5, 0, 5, 5]]}, "box 0.*four"),
        (GOOD | {"scores": [0.5, 1.01]}, "score 1 is 1.01"),
        (GOOD | {"scores": [True, 0.5]}, "score 0 is True"),
        (GOOD | {"timestamp_s": "now"}, "timestamp_s is 'now'"),
        (GOOD | {"timestamp_s": 1.0}, "does not rise"),
        (GOOD | {"timestamp_s": 0.5}, "does not rise"),
        (GOOD | {"masks": [None, {"size": [16, 20], "counts": [3]}]}, "mask 1.*cover 3"),
        (GOOD | {"masks": [{"counts": [3]}, None]}, "mask 0.*keys"),
    ],
)
def test_bad_lines_are_named(write, bad, words):
    value = bad | {"timestamp_s": 2.0} if isinstance(bad, dict) and bad.get("timestamp_s") == 1.0 and "rise" not in words else bad
    with pytest.raises(DatasetError, match=rf"detections\.jsonl:3: .*{words}"):
        RecordedDetector(write(GOOD, "", value))


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        RecordedDetector(tmp_path / "gone.jsonl")
    binary = tmp_path / "image.png"
    binary.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(DatasetError, match=r"image\.png: not a text file"):
        RecordedDetector(binary)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"boxes_px": [[1, 2, 8, 9], [20, 0, 25, 5]]}, "box 1 .*wholly outside the 20x16 image"),
        ({"masks": [{"size": [8, 4], "counts": [32]}, None]}, r"mask 0 is of size \[8, 4\], wanted \[16, 20\]"),
    ],
)
def test_detections_of_another_image_size(write, changes, words):
    detector = RecordedDetector(write(GOOD, GOOD | {"timestamp_s": 2.0} | changes))
    with pytest.raises(DatasetError, match=rf"jsonl:2: {words}"):
        detector.check_against(CAMERA)
    with pytest.raises(DatasetError, match=rf"jsonl:2: {words}"):
        detector.detect(frame(2.0))
    assert len(detector.detect(frame(1.0))) == 2
