"""From boxes to masks."""

from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.perception.lifting import densest_window
from seo_slam.types import BoolArray, Frame

_SAMPLES = 400
_MARGIN_M = 0.01  # of the window, which was found on samples


@runtime_checkable
class Masker(Protocol):
    """Turns boxes into masks: a network that is prompted with boxes, or ``DepthMasker``."""

    def masks(self, frame: Frame, boxes_px: FloatArray) -> BoolArray:
        """Return (N, H, W) the pixels of the thing in each box (N, 4) of a frame; none True where it cannot tell."""
        ...


class DepthMasker:
    """The thing in a box is the largest piece at the distance at which most of the box's middle lies; see ``lifting``.

    Needs no network. It cannot part a thing from what it touches at the same distance: of a book on a table the table comes along.
    """

    def __init__(self, least_points: int = 20) -> None:
        """Make one.

        Args:
            least_points: sampled pixels with depth that a box needs.
        """
        self._least_points = least_points

    def masks(self, frame: Frame, boxes_px: FloatArray) -> BoolArray:
        """Return (N, H, W) masks, each inside its box; the whole box where too little depth is known."""
        height, width = frame.depth_m.shape
        out = np.zeros((len(boxes_px), height, width), dtype=np.bool_)
        for mask, box_px in zip(out, boxes_px, strict=True):
            x0, y0 = np.maximum(np.floor(box_px[:2]).astype(int), 0)
            x1, y1 = np.minimum(np.ceil(box_px[2:]).astype(int), (width, height))
            mask[y0:y1, x0:x1] = self._in_box(frame.depth_m[y0:y1, x0:x1], min(frame.camera.fx, frame.camera.fy))
        return out

    def _in_box(self, depth_m: np.ndarray[tuple[int, ...], np.dtype[np.float32]], focal_px: float) -> BoolArray:
        height, width = depth_m.shape
        step = max(1, int(np.ceil(np.sqrt(height * width / _SAMPLES))))
        weight = _middle_weight(height, width)
        sampled_m = depth_m[::step, ::step]
        known = sampled_m > 0
        if np.count_nonzero(known) < self._least_points:
            return np.ones(depth_m.shape, dtype=np.bool_)
        rising = np.argsort(sampled_m[known], kind="stable")
        values_m = sampled_m[known][rising].astype(np.float64)
        weights = weight[::step, ::step][known][rising]
        length_m = float(np.clip(0.5 * np.sqrt(height * width) / focal_px * np.median(values_m), 0.05, 1.0))
        window = values_m[densest_window(values_m, weights, length_m)]
        inside = (depth_m >= window[0] - _MARGIN_M) & (depth_m <= window[-1] + _MARGIN_M)
        return _heaviest_piece(inside, weight)


def _middle_weight(height: int, width: int) -> FloatArray:
    """(h, w) a Gaussian around the middle, a quarter of the side wide: there the thing is."""
    v = (np.arange(height) + 0.5) / height - 0.5
    u = (np.arange(width) + 0.5) / width - 0.5
    return np.asarray(np.exp(-8.0 * v**2)[:, None] * np.exp(-8.0 * u**2)[None, :], dtype=np.float64)


def _heaviest_piece(inside: BoolArray, weight: FloatArray) -> BoolArray:
    """The connected piece of a mask (h, w) with the most weight."""
    count, pieces = cv2.connectedComponents(inside.astype(np.uint8), connectivity=8)
    if count <= 2:
        return inside
    weights = np.bincount(pieces.ravel(), weights=np.where(inside, weight, 0.0).ravel(), minlength=count)
    return np.asarray(pieces == int(np.argmax(weights[1:])) + 1)
