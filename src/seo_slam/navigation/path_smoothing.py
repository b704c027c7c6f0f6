"""Short cuts: fewer corners in a way, and none of them nearer to a wall than the way was."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.navigation.grid import NavigationGrid


def shortened(path_world: FloatArray, grid: NavigationGrid, comfort_m: float) -> FloatArray:
    """Return a way (M, 2) over some points of a way (N, 2), both ends kept, by the longest short cuts that are clear.

    A short cut keeps ``comfort_m`` from everything; where the part that it replaces came nearer than that, it keeps what that had.

    Args:
        path_world: a clear way.
        grid: on which it is clear.
        comfort_m: distance to keep if the way did.
    """
    points = without_repeats(path_world)
    if len(points) == 1:
        return np.asarray(path_world[[0, -1]])  # both ends are one place
    clearance_m = grid.clearance_along(points)
    kept, here, last = [0], 0, len(points) - 1
    while here < last:
        least_m = np.minimum(np.minimum.accumulate(clearance_m[here:]), comfort_m)
        here = _farthest(points, here, least_m, grid)
        kept.append(here)
    return points[kept]


def _farthest(points: FloatArray, here: int, least_m: FloatArray, grid: NavigationGrid) -> int:
    """Index of a far point that can be seen from point ``here``: steps twice as long while they succeed, then the gap is halved."""
    last = len(points) - 1
    good, reach = here + 1, 2
    while good < last:
        wanted = min(here + reach, last)
        if not grid.is_clear(points[here], points[wanted], float(least_m[wanted - here])):
            break
        good, reach = wanted, 2 * reach
    else:
        return good
    bad = wanted
    while bad - good > 1:
        middle = (good + bad) // 2
        if grid.is_clear(points[here], points[middle], float(least_m[middle - here])):
            good = middle
        else:
            bad = middle
    return good


def without_repeats(path_world: FloatArray) -> FloatArray:
    """Return a way (N, 2) without points that repeat the one before; the first and the last stay what they are."""
    moved = np.linalg.norm(np.diff(path_world, axis=0), axis=1) > 1e-9
    points = path_world[np.concatenate([[True], moved])]
    if len(points) > 1:
        points[-1] = path_world[-1]
    return np.asarray(points)
