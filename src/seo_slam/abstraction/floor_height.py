"""How high the floor is, from the points seen."""

import numpy as np

from seo_slam.geometry import FloatArray

_SLICE_M = 0.02
_AREA_CELL_M = 0.1
_DOMINANT = 0.25  # of the area of the largest level: less is no floor, but noise below it or a hole in it
_BELOW_EYES_M = 0.3
_BAND_M = 0.04


def floor_height_m(p_world: FloatArray, way_world: FloatArray) -> float:
    """Return the height of the floor: the lowest level at which much area was seen.

    Args:
        p_world: (N, 3) points, N > 0, world frame, z up.
        way_world: (M, 3) where the camera was; the floor is below that. M may be 0.
    """
    z = p_world[:, 2]
    below = z < np.median(way_world[:, 2]) - _BELOW_EYES_M if len(way_world) else np.ones(len(z), dtype=np.bool_)
    if not below.any():
        return float(z.min())
    p, low = p_world[below], float(z.min())
    column = np.floor(p[:, :2] / _AREA_CELL_M).astype(np.int64)
    level = np.floor((p[:, 2] - low) / _SLICE_M).astype(np.int64)
    seen = np.unique(np.column_stack([level, column]), axis=0)  # points are dense where the camera was near: count area instead
    area = np.convolve(np.bincount(seen[:, 0]).astype(np.float64), np.ones(3), mode="same")
    first = int(np.argmax(area >= _DOMINANT * area.max()))
    peak = first + int(np.argmax(area[first : first + 4]))
    middle = low + (peak + 0.5) * _SLICE_M
    for _ in range(3):
        near = np.abs(p[:, 2] - middle) <= _BAND_M
        if not near.any():
            break
        middle = float(np.median(p[near, 2]))
    return middle
