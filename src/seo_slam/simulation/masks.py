"""Masks of some pixels of an image: only the rectangle around them is kept."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, Detections


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Some pixels of an image.

    Attributes:
        row, column: where the rectangle begins in the image.
        pixels: (h, w) which of the rectangle's pixels.
    """

    row: int
    column: int
    pixels: BoolArray

    @classmethod
    def ellipse(cls, box_px: FloatArray) -> Self:
        """Return the ellipse that touches the sides of a box: what a mask without an object behind it looks like."""
        rows, columns = pixels_of(box_px)
        middle, half = (box_px[:2] + box_px[2:]) / 2.0, (box_px[2:] - box_px[:2]) / 2.0
        v = (np.arange(rows.start, rows.stop) + 0.5 - middle[1]) / half[1]
        u = (np.arange(columns.start, columns.stop) + 0.5 - middle[0]) / half[0]
        pixels = v[:, None] ** 2 + u[None, :] ** 2 <= 1.0
        pixels[len(v) // 2, len(u) // 2] = True  # of a box that is hardly a pixel wide
        return cls(rows.start, columns.start, pixels)

    def joined(self, other: "Patch") -> "Patch":
        """Return the pixels of both."""
        row, column = min(self.row, other.row), min(self.column, other.column)
        height = max(patch.row + patch.pixels.shape[0] for patch in (self, other)) - row
        width = max(patch.column + patch.pixels.shape[1] for patch in (self, other)) - column
        pixels = np.zeros((height, width), dtype=np.bool_)
        for patch in (self, other):
            h, w = patch.pixels.shape
            pixels[patch.row - row : patch.row - row + h, patch.column - column : patch.column - column + w] |= patch.pixels
        return Patch(row, column, pixels)

    def inside(self, box_px: FloatArray) -> "Patch | None":
        """Return the pixels that a box touches; None if there are none."""
        rows, columns = pixels_of(box_px)
        height, width = self.pixels.shape
        top, left = max(rows.start - self.row, 0), max(columns.start - self.column, 0)
        pixels = self.pixels[top : max(min(rows.stop - self.row, height), 0), left : max(min(columns.stop - self.column, width), 0)]
        return Patch(self.row + top, self.column + left, pixels) if pixels.any() else None

    def box_px(self) -> FloatArray:
        """Return the (4,) box of its rectangle, x0, y0, x1, y1."""
        height, width = self.pixels.shape
        return np.array([self.column, self.row, self.column + width, self.row + height], dtype=np.float64)


def pixels_of(box_px: FloatArray) -> tuple[slice, slice]:
    """Return rows and columns that a box touches; pixel i reaches from i to i + 1."""
    x0, y0 = (int(value) for value in np.floor(box_px[:2]))
    x1, y1 = (int(value) for value in np.ceil(box_px[2:]))
    return slice(y0, y1), slice(x0, x1)


def patches_of(ids: NDArray[np.int32]) -> dict[int, Patch]:
    """Return id -> its pixels in an image of ids (H, W), for all ids above 0; the rectangles are tight."""
    found = {}
    for below, place in enumerate(ndimage.find_objects(ids)):
        if place is not None:
            found[below + 1] = Patch(place[0].start, place[1].start, ids[place] == below + 1)
    return found


class PackedMasks:
    """Masks of one image at an eighth of a byte a pixel of their rectangles: a whole recording of them fits into memory."""

    def __init__(self, patches: Sequence[Patch], height: int, width: int) -> None:
        """Pack masks of an image of this size; they must lie within it."""
        self._size = (height, width)
        self._packed = [(patch.row, patch.column, patch.pixels.shape, np.packbits(patch.pixels)) for patch in patches]

    def unpacked(self) -> BoolArray:
        """Return the (N, H, W) masks."""
        masks = np.zeros((len(self._packed), *self._size), dtype=np.bool_)
        for mask, (row, column, (height, width), bits) in zip(masks, self._packed, strict=True):
            pixels = np.unpackbits(bits, count=height * width).reshape(height, width)
            mask[row : row + height, column : column + width] = pixels
        return masks


@dataclass(frozen=True, slots=True, eq=False)
class KeptDetections:
    """The detections of one frame, small enough to keep those of a whole recording.

    Attributes:
        boxes_px: (N, 4).
        labels: N words, or None each.
        scores: (N,).
        masks: N masks.
    """

    boxes_px: FloatArray
    labels: tuple[str | None, ...]
    scores: FloatArray
    masks: PackedMasks

    def detections(self) -> Detections:
        """Return them, masks unpacked."""
        return Detections(self.boxes_px.copy(), self.labels, self.scores.copy(), self.masks.unpacked())
