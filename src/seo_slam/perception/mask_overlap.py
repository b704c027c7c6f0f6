"""How much masks of one image overlap; masks whose rectangles are apart cost nothing."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class Masks:
    """Masks of one image, with what is asked of them again and again.

    Attributes:
        pixels: (N, H, W).
    """

    pixels: BoolArray

    def __len__(self) -> int:
        return len(self.pixels)

    def __getitem__(self, rows: IntArray | BoolArray) -> "Masks":
        some = Masks(self.pixels[rows])
        some.__dict__.update(boxes=self.boxes[rows], areas=self.areas[rows])  # they are known already
        return some

    @cached_property
    def boxes(self) -> IntArray:
        """(N, 4) the rectangle around each, x0, y0, x1, y1 in pixels, the end not included; zeros for an empty one."""
        out = np.zeros((len(self.pixels), 4), dtype=np.int64)
        for row, mask in enumerate(self.pixels):
            x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
            out[row] = x, y, x + width, y + height
        return out

    @cached_property
    def areas(self) -> IntArray:
        """(N,) pixels in each."""
        return np.array([cv2.countNonZero(mask.view(np.uint8)) for mask in self.pixels], dtype=np.int64)


def shared_pixels(a: Masks, b: Masks) -> IntArray:
    """Return (N, M) pixels that each of ``a`` shares with each of ``b``."""
    low = np.maximum(a.boxes[:, None, :2], b.boxes[None, :, :2])
    high = np.minimum(a.boxes[:, None, 2:], b.boxes[None, :, 2:])
    touch = (high > low).all(axis=2)
    out = np.zeros((len(a), len(b)), dtype=np.int64)
    if a is b:
        touch = np.triu(touch, 1)
    for i, j in np.argwhere(touch).tolist():
        (x0, y0), (x1, y1) = low[i, j].tolist(), high[i, j].tolist()
        out[i, j] = np.count_nonzero(a.pixels[i, y0:y1, x0:x1] & b.pixels[j, y0:y1, x0:x1])
    return out + out.T + np.diag(a.areas) if a is b else out


def mask_iou(shared: IntArray, a: Masks, b: Masks) -> FloatArray:
    """Return (N, M) intersection over union, from ``shared_pixels``."""
    union = a.areas[:, None] + b.areas[None, :] - shared
    return np.asarray(shared / np.maximum(union, 1), dtype=np.float64)


def disjoint(masks: Masks) -> BoolArray:
    """Return (N, H, W) masks of which no two share a pixel: the larger of two loses what they share; of two alike, the later."""
    out = masks.pixels.copy()
    taken = np.zeros(out.shape[1:], dtype=np.bool_)
    for row in np.argsort(masks.areas, kind="stable").tolist():
        x0, y0, x1, y1 = masks.boxes[row].tolist()
        place = (slice(y0, y1), slice(x0, x1))
        out[row][place] &= ~taken[place]
        taken[place] |= out[row][place]
    return out
