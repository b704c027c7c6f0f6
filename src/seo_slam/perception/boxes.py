"""Axis-aligned boxes in pixels, rows ``x0, y0, x1, y1``."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray


def areas(boxes_px: FloatArray) -> FloatArray:
    """Return (N,) areas in square pixels."""
    sides = np.maximum(boxes_px[:, 2:] - boxes_px[:, :2], 0.0)
    return np.asarray(sides[:, 0] * sides[:, 1], dtype=np.float64)


def intersections(a_px: FloatArray, b_px: FloatArray) -> FloatArray:
    """Return (N, M) areas shared by each box of ``a_px`` (N, 4) with each of ``b_px`` (M, 4)."""
    low = np.maximum(a_px[:, None, :2], b_px[None, :, :2])
    high = np.minimum(a_px[:, None, 2:], b_px[None, :, 2:])
    sides = np.maximum(high - low, 0.0)
    return np.asarray(sides[..., 0] * sides[..., 1], dtype=np.float64)


def iou(a_px: FloatArray, b_px: FloatArray) -> FloatArray:
    """Return (N, M) intersection over union."""
    shared = intersections(a_px, b_px)
    union = areas(a_px)[:, None] + areas(b_px)[None, :] - shared
    return shared / np.maximum(union, 1e-12)


def containment(a_px: FloatArray, b_px: FloatArray) -> FloatArray:
    """Return (N, M) intersection over the smaller area: 1 where one box lies in the other."""
    smaller = np.minimum(areas(a_px)[:, None], areas(b_px)[None, :])
    return intersections(a_px, b_px) / np.maximum(smaller, 1e-12)


def truncated_sides(boxes_px: FloatArray, width: int, height: int, margin_share: float = 0.015) -> BoolArray:
    """Return (N, 4) bool: the box touches the left, top, right, bottom border of the image.

    Detectors let the box of a cut object end some pixels before the border, so a share of the longer image side counts as touching.
    """
    margin_px = margin_share * max(width, height)
    limits = np.array([margin_px, margin_px, width - 1 - margin_px, height - 1 - margin_px])
    out = np.empty(boxes_px.shape, dtype=np.bool_)
    out[:, :2] = boxes_px[:, :2] <= limits[:2]
    out[:, 2:] = boxes_px[:, 2:] >= limits[2:]
    return out
