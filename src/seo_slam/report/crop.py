"""Pictures of single objects, cut out of frames."""

from dataclasses import dataclass

import cv2
import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import Frame

LONGER_SIDE_PX = 160
_JPEG_QUALITY = 82
_PADDING_SHARE = 0.12
_HALF_VALUE_AREA_SHARE = 0.01  # a box of 1 % of the image is worth half of a very large one


@dataclass(frozen=True, slots=True)
class Crop:
    """A picture of one object.

    Attributes:
        jpeg: the file's bytes, at most 160 px on the longer side.
        width_px, height_px: of the picture.
        box_share: left, top, right, bottom of the object's box, as shares (0..1) of the picture's width and height.
        timestamp_s: stamp of the frame it was cut from.
        value: how good it is, see ``crop_value``.
    """

    jpeg: bytes
    width_px: int
    height_px: int
    box_share: tuple[float, float, float, float]
    timestamp_s: float
    value: float


def crop_value(score: float, truncated_sides: int, box_area_px: float, image_area_px: float) -> float:
    """How well a box shows its object: score x visibility, in [0, 1).

    Visibility halves with every side cut by the image border, and grows with the box's area towards 1.
    """
    area = box_area_px / (box_area_px + _HALF_VALUE_AREA_SHARE * image_area_px)
    return float(score * 0.5**truncated_sides * area)


def cut_crop(frame: Frame, box_px: FloatArray, value: float) -> Crop | None:
    """Cut a box (4,) with some padding out of the image and compress it; None if nothing of it lies in the image."""
    height, width = frame.rgb.shape[:2]
    pad = 4.0 + _PADDING_SHARE * max(box_px[2] - box_px[0], box_px[3] - box_px[1])
    x0, y0 = max(int(box_px[0] - pad), 0), max(int(box_px[1] - pad), 0)
    x1, y1 = min(int(np.ceil(box_px[2] + pad)), width), min(int(np.ceil(box_px[3] + pad)), height)
    if x1 - x0 < 2 or y1 - y0 < 2:
        return None
    image = frame.rgb[y0:y1, x0:x1]
    shrink = LONGER_SIDE_PX / max(x1 - x0, y1 - y0)
    if shrink < 1.0:
        size = (max(round((x1 - x0) * shrink), 1), max(round((y1 - y0) * shrink), 1))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    ok, jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not ok:
        return None
    share = (box_px - np.array([x0, y0, x0, y0])) / np.array([x1 - x0, y1 - y0, x1 - x0, y1 - y0])
    left, top, right, bottom = (float(s) for s in np.clip(share, 0.0, 1.0))
    return Crop(jpeg.tobytes(), image.shape[1], image.shape[0], (left, top, right, bottom), frame.timestamp_s, value)
