"""How much masks (N, H, W) of one image overlap; masks whose rectangles are apart cost nothing."""

import cv2
import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray


def tight_boxes(masks: BoolArray) -> IntArray:
    """Return (N, 4) the rectangle around each mask, x0, y0, x1, y1 in pixels, the end not included; zeros for an empty one."""
    out = np.zeros((len(masks), 4), dtype=np.int64)
    for row, mask in enumerate(masks):
        x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
        out[row] = x, y, x + width, y + height
    return out


def mask_areas(masks: BoolArray) -> IntArray:
    """Return (N,) pixels in each mask."""
    return np.array([cv2.countNonZero(mask.view(np.uint8)) for mask in masks], dtype=np.int64)


def shared_pixels(a: BoolArray, b: BoolArray) -> IntArray:
    """Return (N, M) pixels that each mask of ``a`` (N, H, W) shares with each of ``b`` (M, H, W)."""
    boxes_a, boxes_b = tight_boxes(a), tight_boxes(b)
    low = np.maximum(boxes_a[:, None, :2], boxes_b[None, :, :2])
    high = np.minimum(boxes_a[:, None, 2:], boxes_b[None, :, 2:])
    out = np.zeros((len(a), len(b)), dtype=np.int64)
    for i, j in np.argwhere((high > low).all(axis=2)):
        (x0, y0), (x1, y1) = low[i, j], high[i, j]
        both = a[i, y0:y1, x0:x1] & b[j, y0:y1, x0:x1]
        out[i, j] = np.count_nonzero(both)
    return out


def mask_iou(shared: IntArray, areas_a: IntArray, areas_b: IntArray) -> FloatArray:
    """Return (N, M) intersection over union, from ``shared_pixels`` and areas (N,) and (M,)."""
    union = areas_a[:, None] + areas_b[None, :] - shared
    return np.asarray(shared / np.maximum(union, 1), dtype=np.float64)


def disjoint(masks: BoolArray) -> BoolArray:
    """Return masks of which no two share a pixel: the larger of two loses what they share; of two alike, the later."""
    out = masks.copy()
    boxes, areas = tight_boxes(masks), mask_areas(masks)
    taken = np.zeros(masks.shape[1:], dtype=np.bool_)
    for row in np.argsort(areas, kind="stable"):
        x0, y0, x1, y1 = boxes[row]
        place = (slice(y0, y1), slice(x0, x1))
        out[row][place] &= ~taken[place]
        taken[place] |= out[row][place]
    return out
