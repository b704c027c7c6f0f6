"""How high the floor is, from the points seen."""

import numpy as np

from seo_slam.geometry import FloatArray

_SLICE_M = 0.02
_AREA_CELL_M = 0.1
_DOMINANT = 0.25  # of the area of the largest level: less is no floor, but noise below it or a hole in it
_BELOW_EYES_M = 0.3
_BAND_M = 0.04
_BANDS_M = (0.15, 0.1, 0.06, _BAND_M)  # around the floor, as the fit of its slope gets better
_LEAST_AREA_M2 = 3.0
_STEEPEST = np.tan(np.radians(3.0))


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


def floor_plane(p_world: FloatArray, way_world: FloatArray) -> FloatArray:
    """Return a, b, c (3,) of the floor's height a x + b y + c under points (N, 3), N > 0; drifting poses make it lean.

    Half a degree is 9 cm on 10 m: more than what a robot steps over. Where too little floor was seen, or the fit leans by more than 3
    degrees, the floor is level. ``way_world`` as of ``floor_height_m``.
    """
    level = np.array([0.0, 0.0, floor_height_m(p_world, way_world)])
    cells = _middles_near(p_world, level[2])
    plane = level
    ones = np.ones((len(cells), 1))
    for band_m in _BANDS_M:
        near = np.abs(cells[:, 2] - np.hstack([cells[:, :2], ones]) @ plane) <= band_m
        if near.sum() * _AREA_CELL_M**2 < _LEAST_AREA_M2:
            return level
        plane = np.linalg.lstsq(np.hstack([cells[near, :2], ones[near]]), cells[near, 2], rcond=None)[0]
    return level if np.hypot(plane[0], plane[1]) > _STEEPEST else np.asarray(plane)


def heights_above(plane: FloatArray, p_world: FloatArray) -> FloatArray:
    """Return (N,) the height of points (N, 3) above a floor (3,)."""
    return np.asarray(p_world[:, 2] - (p_world[:, :2] @ plane[:2] + plane[2]))


def _middles_near(p_world: FloatArray, level_m: float) -> FloatArray:
    """Mean (K, 3) of the points near the floor in each cell of the floor: all area counts alike, however often it was seen."""
    p = p_world[np.abs(p_world[:, 2] - level_m) <= _BANDS_M[0]]
    _, cell = np.unique(np.floor(p[:, :2] / _AREA_CELL_M).astype(np.int64), axis=0, return_inverse=True)
    counts = np.bincount(cell.ravel())
    return np.stack([np.bincount(cell.ravel(), p[:, axis]) for axis in range(3)], axis=1) / np.maximum(counts, 1)[:, None]
