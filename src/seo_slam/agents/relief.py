"""Does something stand out of the surfaces around a box?

What is around a box is explained by a few planes: a table, a wall, the floor. Where a landmark's own surface lies on one of them, there
is only that surface, going on. What stands before them and ends near the box is a thing of its own, measured or not.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.agents.local_patch import Patch
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray

PLANES = 3
"""So many planes are looked for around a box."""

TRIES = 24
"""Planes tried for each, through three points."""

POINTS = 100
"""Points around a box that vote, at most about twice as many."""

LEAST_POINTS = 20

LEAST_SUPPORT = 0.1
"""Share of the points that a plane must explain."""

VOTE_SIGMAS = 3.0
"""A point as near to a plane as this, in standard deviations of a pixel's inverse depth, votes for it."""

ON_PLANE_SIGMAS = 2.0
"""A cell as near to a plane lies on it: cells are means of nine pixels or more, so this is six of theirs, or 3 cm at 2.8 m."""

JUMP_SIGMAS = 4.0
"""Cells that differ more from their neighbours are at an edge, where a mean would be of neither side."""

MOST_BEYOND = 0.3
"""A region with a larger part of itself outside goes on beyond the box."""

HIDDEN_M = 0.03
"""A surface point is hidden by what is nearer by this, and three standard deviations."""

LEAST_KNOWN = 0.5
"""Share of a box that must have depth."""

LEAST_SURFACE = 8
"""Surface points that must be seen; and a third of all."""


_RIDGE = 1e-9 * np.eye(3)
_DRAWS = np.random.default_rng(0).random((PLANES, TRIES, 3))


@dataclass(frozen=True, slots=True)
class Relief:
    """What the depth at a box is.

    Attributes:
        going_on: share of the landmark's surface that lies on a plane around the box; of the box, where no surface is known.
        own: share of the box that stands before those planes, and ends near the box.
    """

    going_on: float
    own: float


def relief_of(patch: Patch, surface_px: FloatArray, noise: float) -> Relief | None:
    """Return what stands out in a patch; None where too little is known or seen.

    Args:
        patch: the neighbourhood of a box.
        surface_px: (M, 3) points of the landmark's surface: pixel column, row, and depth in metres, all in front of the camera.
        noise: standard deviation of a pixel's inverse depth, 1/m: the factor of a depth noise that grows with depth squared.
    """
    known = patch.inverse_depth > 0
    inside = patch.inside & known
    if inside.sum() < max(LEAST_KNOWN * patch.inside.sum(), 1):
        return None
    smooth = _smoothed(patch.inverse_depth, known, JUMP_SIGMAS * noise)
    planes = _planes_around(smooth, patch.outside & known, VOTE_SIGMAS * noise)
    if not len(planes):
        return None
    before = smooth - _predicted(planes, smooth.shape)
    tolerance = ON_PLANE_SIGMAS * noise
    flat = (np.abs(before) <= tolerance).any(axis=0) & known
    own = _ending_near((before > tolerance).any(axis=0) & ~flat & known, patch)
    if len(surface_px):
        row, column, within = patch.cells_at(surface_px[:, :2])
        limit = 1.0 / np.maximum(surface_px[:, 2] - HIDDEN_M, 0.05) + 3.0 * noise
        seen = within & known[row, column] & (smooth[row, column] <= limit)
        if seen.sum() < max(LEAST_SURFACE, len(surface_px) / 3):
            return None
        going_on = float(flat[row[seen], column[seen]].mean())
    else:
        going_on = float(flat[inside].mean())
    return Relief(going_on, float(own[inside].mean()))


def _planes_around(smooth: NDArray[np.float32], around: BoolArray, tolerance: float) -> FloatArray:
    """(P, 3) planes in inverse depth that explain the cells around a box."""
    row, column = np.nonzero(around)
    if len(row) < LEAST_POINTS:
        return np.zeros((0, 3))
    step = max(len(row) // POINTS, 1)
    row, column = row[::step], column[::step]
    h, w = smooth.shape
    points = np.stack([column / w - 0.5, row / h - 0.5, np.ones(len(row))], axis=1)
    return planes_through(points, smooth[row, column].astype(np.float64), tolerance)


def planes_through(points: FloatArray, values: FloatArray, tolerance: float) -> FloatArray:
    """Return (P, 3) planes ``value = point @ plane``, P <= ``PLANES``, that explain most of N points, the best supported first.

    Planes through random triplets are voted on, as in RANSAC; the draws are the same for every call.

    Args:
        points: (N, 3), the last coordinate 1.
        values: (N,).
        tolerance: largest difference that counts as explained.
    """
    found: list[FloatArray] = []
    least = max(LEAST_SUPPORT * len(values), 8.0)
    for k in range(PLANES):
        if len(values) < least:
            break
        chosen = (_DRAWS[k] * len(values)).astype(np.int64)
        tried = _through_triplets(points[chosen], values[chosen])
        votes = (np.abs(points @ tried.T - values[:, None]) <= tolerance).sum(axis=0)
        plane = tried[int(votes.argmax())] if len(votes) else np.zeros(3)
        on = np.abs(points @ plane - values) <= tolerance
        for _ in range(2):
            if np.count_nonzero(on) < least:
                break
            explained = points[on]
            plane = np.linalg.solve(explained.T @ explained + _RIDGE, explained.T @ values[on])
            on = np.abs(points @ plane - values) <= tolerance
        if np.count_nonzero(on) < least:
            break
        found.append(plane)
        points, values = points[~on], values[~on]
    return np.array(found, dtype=np.float64).reshape(-1, 3)


def _through_triplets(corners: FloatArray, values: FloatArray) -> FloatArray:
    """(T, 3) planes through T triplets of points (T, 3, 3) with values (T, 3), by Cramer's rule; those nearly on a line are left out."""
    ab, ac = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    rise = values[:, 1:] - values[:, :1]
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    good = np.abs(area) > 5e-3
    area = area[good]
    a = (rise[good, 0] * ac[good, 1] - rise[good, 1] * ab[good, 1]) / area
    b = (rise[good, 1] * ab[good, 0] - rise[good, 0] * ac[good, 0]) / area
    return np.stack([a, b, values[good, 0] - a * corners[good, 0, 0] - b * corners[good, 0, 1]], axis=1)


def _predicted(planes: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """(P, h, w) inverse depth of planes."""
    h, w = shape
    u, v = np.arange(w) / w - 0.5, np.arange(h) / h - 0.5
    return np.asarray(planes[:, 0, None, None] * u + (planes[:, 1, None, None] * v[:, None] + planes[:, 2, None, None]), dtype=np.float64)


def _ending_near(mask: BoolArray, patch: Patch) -> BoolArray:
    """The cells of those connected regions of a mask that end near the box."""
    if not mask.any():
        return mask
    count, region = cv2.connectedComponents(mask.view(np.uint8), connectivity=4)
    sizes = np.bincount(region.ravel(), minlength=count)
    beyond = np.bincount(region[patch.outside], minlength=count)
    ends = beyond <= MOST_BEYOND * sizes
    ends[0] = False
    return np.asarray(ends[region], dtype=np.bool_)


def _smoothed(inverse: NDArray[np.float32], known: BoolArray, jump: float) -> NDArray[np.float32]:
    """Mean of the known cells around each, but for cells at an edge."""
    mean = cv2.blur(inverse, (3, 3)) / np.maximum(cv2.blur(known.astype(np.float32), (3, 3)), np.float32(1e-6))
    plain = known & (np.abs(mean - inverse) < jump)
    return np.asarray(np.where(plain, mean, inverse), dtype=np.float32)
