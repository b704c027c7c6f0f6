"""The neighbourhood of a box in colour and depth, small enough that looking at it costs a fraction of a millisecond."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, Frame, IntArray

AROUND = 1.0
"""Width of what is looked at around a box, as a share of its longer side."""

LEAST_AROUND_PX = 6.0

GAP = 0.2
"""Share of the longer side next to a box that counts neither as inside nor as outside: boxes are never quite where things end."""

MOST_CELLS = 36
"""A neighbourhood is shrunk until its longer side has so many cells."""

LEAST_SIDE_PX = 4
"""Fewer pixels of a neighbourhood, either way, show nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A box and what is around it, shrunk to (h, w) cells.

    Attributes:
        lab: (h, w, 3) float32, CIE L*a*b* (0 to 100, and about -100 to 100).
        inverse_depth: (h, w) float32, 1/m, 0 where unknown. A plane is linear in it, and the noise of a stereo or structured-light
            sensor is the same everywhere.
        inside: (h, w) cells of the box.
        outside: (h, w) cells farther from it than ``GAP``.
        origin_px: (2,) x and y of the first cell's corner, pixels of the frame.
        cell_px: (2,) width and height of a cell, pixels of the frame.
    """

    lab: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]
    inside: BoolArray
    outside: BoolArray
    origin_px: FloatArray
    cell_px: FloatArray

    def cells_at(self, uv: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
        """Return row and column of the cells at pixels (N, 2) of the frame, and (N,) whether they are in the patch (else 0, 0)."""
        h, w = self.inside.shape
        at = np.floor((uv - self.origin_px) / self.cell_px)
        within = np.asarray(((at >= 0) & (at < [w, h])).all(axis=1), dtype=np.bool_)
        column, row = np.where(within[:, None], at, 0.0).astype(np.int64).T
        return row, column, within


def cut_patch(frame: Frame, box_px: FloatArray) -> Patch | None:
    """Return the neighbourhood of a box (4,), clipped to the image; None if next to nothing of it is in the image."""
    height, width = frame.depth_m.shape
    bx0, by0, bx1, by1 = (float(value) for value in box_px)
    side = max(bx1 - bx0, by1 - by0)
    margin = max(AROUND * side, LEAST_AROUND_PX)
    x0, y0 = max(math.floor(bx0 - margin), 0), max(math.floor(by0 - margin), 0)
    x1, y1 = min(math.ceil(bx1 + margin), width), min(math.ceil(by1 + margin), height)
    if x1 - x0 < LEAST_SIDE_PX or y1 - y0 < LEAST_SIDE_PX:
        return None
    rgb, inverse = frame.rgb[y0:y1, x0:x1], _inverse(frame.depth_m[y0:y1, x0:x1])
    shrink = max(1.0, max(x1 - x0, y1 - y0) / MOST_CELLS)
    w, h = max(round((x1 - x0) / shrink), 2), max(round((y1 - y0) / shrink), 2)
    if shrink > 1.0:
        rgb, inverse = cv2.resize(rgb, (w, h), interpolation=cv2.INTER_AREA), _shrunk(inverse, (w, h))
    cell_px = np.array([(x1 - x0) / w, (y1 - y0) / h])
    u, v = x0 + (np.arange(w) + 0.5) * cell_px[0], y0 + (np.arange(h) + 0.5) * cell_px[1]
    beyond = np.maximum(np.maximum(bx0 - u, u - bx1), np.maximum(by0 - v, v - by1)[:, None])
    return Patch(
        lab=np.asarray(cv2.cvtColor(rgb.astype(np.float32) * np.float32(1.0 / 255.0), cv2.COLOR_RGB2Lab), dtype=np.float32),
        inverse_depth=inverse,
        inside=beyond <= 0.0,
        outside=beyond > max(GAP * side, 1.0),
        origin_px=np.array([x0, y0], dtype=np.float64),
        cell_px=cell_px,
    )


def _inverse(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    inverse = np.zeros_like(depth_m)
    np.divide(np.float32(1.0), depth_m, out=inverse, where=depth_m > 0)
    return inverse


def _shrunk(inverse: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Mean of what is known, where that is more than half."""
    known = cv2.resize((inverse > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(inverse, size, interpolation=cv2.INTER_AREA) / np.maximum(known, np.float32(0.5))
    return np.asarray(np.where(known > 0.5, mean, 0.0), dtype=np.float32)
