"""Every registered detector keeps the contract, and the check notices those that do not."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends.recorded_detector import DetectionRecorder
from seo_slam.config import Component
from seo_slam.testing import check_detector
from seo_slam.testing.worlds import tiny_frames
from seo_slam.types import Detections

SEEN = Detections(np.array([[10.0, 20.0, 60.0, 80.0]]), ("cup",), np.array([0.5]))


def options(name, request, tmp_path):
    if name == "yolox":
        return {"weights": request.getfixturevalue("shared") / "models/yolox_nano/yolox_nano.onnx", "score": 0.01}
    if name == "recorded":
        with DetectionRecorder(tmp_path / "detections.jsonl") as recorder:
            for frame in tiny_frames(2):
                recorder.record(frame, SEEN)
        return {"path": tmp_path / "detections.jsonl"}
    if name == "hybrid":
        return {"detector": Returns(SEEN), "segmenter": {"name": "none"}}
    return {}


@pytest.mark.parametrize("name", registry.known("detector"))
def test_contract(name, request, tmp_path):
    check_detector(registry.create("detector", Component(name=name, options=options(name, request, tmp_path))))


class Returns:
    """A detector that always gives the same answer."""

    def __init__(self, found):
        self._found = found

    def detect(self, frame):
        return self._found


@pytest.mark.parametrize("found", [SEEN, {"boxes": [[1, 2, 3, 4]], "labels": ["cup"], "scores": [0.5]}, {"boxes": []}])
def test_good_answers(found):
    check_detector(Returns(found))


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (None, "returned None"),
        ([SEEN], "got list"),
        ({"boxes": [[1, 2, np.nan, 4]]}, "Returns, frame 0.*row 0.*not finite"),
        ({"boxes": [[1, 2, 3, 4]], "scores": [7]}, "0..1"),
        ({"boxes": [[900, 2, 950, 4]]}, "wholly outside"),
        ({"boxes": [[1, 2, 3, 4]], "masks": np.ones((1, 10, 10))}, "mask"),
    ],
)
def test_bad_answers_are_noticed(found, words):
    with pytest.raises(AssertionError, match=words):
        check_detector(Returns(found))


def test_a_detector_that_draws_on_the_image_is_noticed():
    class Draws:
        def detect(self, frame):
            frame.rgb[:5] = 255
            return SEEN

    with pytest.raises(AssertionError, match="Draws: detect changed the image"):
        check_detector(Draws())


def test_a_detector_that_is_not_repeatable_is_noticed():
    class Rolls:
        def __init__(self):
            self._rng = np.random.default_rng(0)

        def detect(self, frame):
            return replace(SEEN, scores=self._rng.random(1))

    with pytest.raises(AssertionError, match="other detections the second time"):
        check_detector(Rolls())
    check_detector(Rolls(), deterministic=False)


def test_something_else_is_noticed():
    with pytest.raises(AssertionError, match="object: has no method detect"):
        check_detector(object())
