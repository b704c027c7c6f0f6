"""From boxes to masks."""

from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.perception.mask_clouds import box_masks
from seo_slam.types import BoolArray, Frame


@runtime_checkable
class Masker(Protocol):
    """Turns boxes into masks: a network that is prompted with boxes, or ``DepthMasker``."""

    def masks(self, frame: Frame, boxes_px: FloatArray) -> BoolArray:
        """Return (N, H, W) the pixels of the thing in each box (N, 4) of a frame; none True where it cannot tell."""
        ...


class DepthMasker:
    """The thing in a box is the connected piece in its middle, of what is at the distance that ``mask_clouds.box_masks`` finds.

    Needs no network. It cannot part a thing from what it touches at the same distance: of a book on a table the table comes along.
    """

    def __init__(self, max_depth_m: float = 6.0) -> None:
        """Make one.

        Args:
            max_depth_m: farther depth is ignored.

        Raises:
            ConfigError: it is not above 0.
        """
        if not max_depth_m > 0:
            raise ConfigError(f"depth masker: max_depth_m is {max_depth_m}, wanted above 0")
        self._max_depth_m = max_depth_m

    def masks(self, frame: Frame, boxes_px: FloatArray) -> BoolArray:
        """Return (N, H, W) masks, each inside its box; the whole box where no depth is known."""
        height, width = frame.depth_m.shape
        out = box_masks(boxes_px, frame.depth_m, frame.camera, self._max_depth_m)
        for mask, box_px in zip(out, boxes_px, strict=True):
            x0, y0 = np.maximum(np.floor(box_px[:2]).astype(int), 0)
            x1, y1 = np.minimum(np.ceil(box_px[2:]).astype(int), (width, height))
            inside = mask[y0:y1, x0:x1]
            mask[y0:y1, x0:x1] = _heaviest_piece(inside) if inside.any() else True
        return out


def _heaviest_piece(inside: BoolArray) -> BoolArray:
    """The connected piece of what is inside a box (h, w) that has the most of its middle, its pinholes closed."""
    closed = cv2.morphologyEx(inside.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), dtype=np.uint8))
    count, pieces = cv2.connectedComponents(closed, connectivity=8)
    height, width = inside.shape
    v, u = (np.arange(height) + 0.5) / height - 0.5, (np.arange(width) + 0.5) / width - 0.5
    middle = np.exp(-8.0 * v**2)[:, None] * np.exp(-8.0 * u**2)[None, :]  # a quarter of the side wide, as in lifting
    weight = np.where(pieces > 0, middle, 0.0)
    weights = np.bincount(pieces.ravel(), weights=weight.ravel(), minlength=count)
    return np.asarray(pieces == int(np.argmax(weights)))
