"""Matching binary descriptors for visual odometry: near a predicted position, or anywhere."""

import numpy as np

from seo_slam.backends.visual_features import SCALE_FACTOR, DescriptorArray, Features
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

Matches = tuple[IntArray, IntArray]
"""Rows of the first set and rows of the second, one pair a match; no row of either twice."""

_OCTAVE_TOLERANCE = 1.5


def matches_near(
    uv_px: FloatArray,
    octaves: FloatArray,
    descriptors: DescriptorArray,
    features: Features,
    radius_px: float,
    max_distance: int = 64,
    ratio: float = 0.85,
) -> Matches:
    """Match P predicted points to features within ``radius_px`` of them (more on coarser levels).

    Args:
        uv_px: (P, 2) predicted positions, undistorted.
        octaves: (P,) predicted pyramid level.
        descriptors: (P, 4) uint64.
        features: of the image.
        radius_px: on the finest level; it grows with the scale of the predicted level.
        max_distance: bits that may differ.
        ratio: the best match must be this much better than the second one nearby.
    """
    if not len(features) or not len(uv_px):
        return _no_matches()
    radii_px = radius_px * SCALE_FACTOR ** np.clip(octaves, 0, 4)
    point, feature = _pairs_of_neighbouring_cells(uv_px, features.uv_px, float(radii_px.max()))
    near = np.flatnonzero(np.abs(octaves[point] - features.octaves[feature]) <= _OCTAVE_TOLERANCE)
    point, feature = point[near], feature[near]
    du_px = uv_px[:, 0][point] - features.uv_px[:, 0][feature]
    dv_px = uv_px[:, 1][point] - features.uv_px[:, 1][feature]
    near = np.flatnonzero(du_px * du_px + dv_px * dv_px < (radii_px * radii_px)[point])
    point, feature = point[near], feature[near]
    distance = _hamming(descriptors[point], features.descriptors[feature])
    return _best_pairs(point, feature, distance, max_distance, ratio)


def matches_anywhere(a: DescriptorArray, b: DescriptorArray, max_distance: int = 64, ratio: float = 0.8) -> Matches:
    """Match descriptors (A, 4) to (B, 4) by brute force with the ratio test, each row at most once."""
    if not len(a) or len(b) < 2:
        return _no_matches()
    distance = np.empty((len(a), len(b)), dtype=np.uint8)
    total = np.zeros((len(a), len(b)), dtype=np.uint16)
    for word in range(4):
        np.bitwise_count(a[:, word, None] ^ b[None, :, word], out=distance)
        total += distance
    two_best = np.argpartition(total, 1, axis=1)[:, :2]
    rows = np.repeat(np.arange(len(a)), 2)
    columns = two_best.ravel()
    return _best_pairs(rows, columns, total[rows, columns].astype(np.int64), max_distance, ratio)


def _pairs_of_neighbouring_cells(a_px: FloatArray, b_px: FloatArray, cell_px: float) -> tuple[IntArray, IntArray]:
    """All pairs (row of a, row of b) whose cells touch; holds every pair closer than ``cell_px``."""
    low = np.minimum(a_px.min(axis=0), b_px.min(axis=0)) - 2 * cell_px
    a_cell, b_cell = ((a_px - low) // cell_px).astype(np.int64), ((b_px - low) // cell_px).astype(np.int64)
    columns = int(max(a_cell[:, 0].max(), b_cell[:, 0].max())) + 2
    b_code = b_cell[:, 1] * columns + b_cell[:, 0]
    order = np.argsort(b_code, kind="stable")
    b_code = b_code[order]
    starts, counts = [], []
    for row in (-1, 0, 1):  # three cells side by side are one run of codes
        code = (a_cell[:, 1] + row) * columns + a_cell[:, 0]
        start = np.searchsorted(b_code, code - 1, side="left")
        starts.append(start)
        counts.append(np.searchsorted(b_code, code + 1, side="right") - start)
    start, count = np.concatenate(starts), np.concatenate(counts)
    a_rows = np.repeat(np.tile(np.arange(len(a_px)), 3), count)
    ends = np.cumsum(count)
    within = np.arange(int(ends[-1])) - np.repeat(ends - count, count)
    return a_rows, order[np.repeat(start, count) + within]


def _hamming(a: DescriptorArray, b: DescriptorArray) -> IntArray:
    return np.asarray(np.bitwise_count(a ^ b).sum(axis=1), dtype=np.int64)


def _best_pairs(a: IntArray, b: IntArray, distance: IntArray, max_distance: int, ratio: float) -> Matches:
    """The best b of every a if it passes the ratio test against the second, then the best a of every b."""
    order = np.argsort((a * 512 + distance) * (int(b.max(initial=0)) + 1) + b)
    a, b, distance = a[order], b[order], distance[order]
    first = np.flatnonzero(np.diff(a, prepend=-1))
    second = np.minimum(first + 1, len(a) - 1)
    has_rival = (second > first) & (a[second] == a[first])
    good = (distance[first] <= max_distance) & (~has_rival | (distance[first] <= ratio * distance[second]))
    kept = first[good]
    kept = kept[np.lexsort((a[kept], distance[kept], b[kept]))]
    kept = kept[np.flatnonzero(np.diff(b[kept], prepend=-1))]
    return a[kept], b[kept]


def _no_matches() -> Matches:
    return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
