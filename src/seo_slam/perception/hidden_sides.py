"""Which sides of a thing are hidden behind something nearer: its mask ends there, the thing does not."""

import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray

BESIDE_PX = 2
"""How far outside the mask the depth is looked at, in an image 320 pixels wide; in wider ones as much farther."""

NEARER_M, NEARER_SHARE = 0.04, 0.02
"""What is nearer by this and this share of the depth stands before the thing; the table on which it rests comes nearer more slowly."""

LEAST_SHARE = 0.3
"""Share of a side along which something nearer must adjoin."""


def hidden_sides(mask: BoolArray, depth_m: NDArray[np.float32], box_px: FloatArray) -> BoolArray:
    """Return (4,) bool: whether the left, top, right and bottom side of a mask is where something nearer begins.

    Args:
        mask: (H, W).
        depth_m: (H, W), 0 = no return.
        box_px: (4,) the mask's box.
    """
    height, width = mask.shape
    beside = max(1, round(BESIDE_PX * width / 320))
    x0, y0 = max(int(box_px[0]) - beside, 0), max(int(box_px[1]) - beside, 0)
    x1, y1 = min(int(np.ceil(box_px[2])) + beside, width), min(int(np.ceil(box_px[3])) + beside, height)
    own, depth = mask[y0:y1, x0:x1], depth_m[y0:y1, x0:x1]
    turned = ((own, depth), (own.T, depth.T), (own[:, ::-1], depth[:, ::-1]), (own[::-1].T, depth[::-1].T))
    return np.array([_begins_nearer(part, image, beside) for part, image in turned])


def _begins_nearer(own: BoolArray, depth: NDArray[np.float32], beside: int) -> bool:
    """Whether, left of the first pixel of each row of a mask, something nearer adjoins in enough of the rows."""
    rows = np.flatnonzero(own.any(axis=1))
    if not len(rows):
        return False
    first = own[rows].argmax(axis=1)
    inside = depth[rows, np.minimum(first + 1, own.shape[1] - 1)]
    outside = depth[rows, np.maximum(first - beside, 0)]
    known = (inside > 0) & (outside > 0) & (first >= beside)
    nearer = known & (outside < (1.0 - NEARER_SHARE) * inside - NEARER_M)
    return bool(nearer.sum() >= LEAST_SHARE * len(rows))
