"""Which landmarks are near a point."""

import numpy as np
from numpy.typing import ArrayLike

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray


def require_point(p_world: ArrayLike, radius_m: float) -> FloatArray:
    """Return ``p_world`` as a (3,) float64 array.

    Raises:
        FrameError: it is no finite point (3,), or the radius is negative or NaN.
    """
    point = np.asarray(p_world, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise FrameError(f"p_world: got {np.asarray(p_world).tolist()}, wanted three finite metres [x, y, z]")
    if not radius_m >= 0:
        raise FrameError(f"radius_m: got {radius_m}, wanted 0 or more")
    return point


def rows_within(positions_m: FloatArray, ids: IntArray, p_world: ArrayLike, radius_m: float) -> IntArray:
    """Return the row numbers of all positions within a radius, nearest first, the lower id first on a tie.

    Args:
        positions_m: (N, 3), world frame.
        ids: (N,).
        p_world: (3,), world frame.
        radius_m: the border belongs to it.

    Raises:
        FrameError: as ``require_point``.
    """
    point = require_point(p_world, radius_m)
    distance_m = np.linalg.norm(positions_m.reshape(-1, 3) - point, axis=1)
    rows = np.lexsort((ids, distance_m))
    return np.asarray(rows[distance_m[rows] <= radius_m], dtype=np.int64)
