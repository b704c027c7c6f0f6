"""Contract of a ``Detector``."""

from collections.abc import Sequence

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.interfaces import Detector
from seo_slam.perception.adapters import to_detections
from seo_slam.testing.clauses import require
from seo_slam.testing.worlds import hard_frames, tiny_frames
from seo_slam.types import Detections, Frame


def check_detector(detector: Detector, frames: Sequence[Frame] | None = None, deterministic: bool = True) -> None:
    """Check that the pipeline can use what a detector returns.

    Args:
        detector: the one to check.
        frames: images to try it on; None for a few small made-up ones and some without depth, black and white.
        deterministic: whether the same image must give the same detections.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(detector, Detector), detector, "has no method detect(frame)")
    for frame in frames if frames is not None else (*tiny_frames(2), *hard_frames()):
        image, depth_m = frame.rgb.copy(), frame.depth_m.copy()
        first = _detect(detector, frame)
        unchanged = np.array_equal(image, frame.rgb) and np.array_equal(depth_m, frame.depth_m)
        require(unchanged, detector, f"detect changed the image or depth of frame {frame.index}; draw on a copy")
        if deterministic:
            require(
                _same(first, _detect(detector, frame)),
                detector,
                f"frame {frame.index} gave other detections the second time; a run could not be repeated (deterministic=False allows it)",
            )


def _detect(detector: Detector, frame: Frame) -> Detections:
    found = detector.detect(frame)
    require(found is not None, detector, f"detect returned None for frame {frame.index}; wanted empty detections where nothing is seen")
    try:
        return to_detections(found, frame, type(detector).__name__)
    except FrameError as error:
        raise AssertionError(f"detections do not fit the image: {error}") from error


def _same(a: Detections, b: Detections) -> bool:
    masks = (a.masks is None) == (b.masks is None) and (a.masks is None or b.masks is None or np.array_equal(a.masks, b.masks))
    return a.labels == b.labels and np.array_equal(a.boxes_px, b.boxes_px) and np.array_equal(a.scores, b.scores) and masks
