"""What both planners ask of the two ends of a way before they search."""

from dataclasses import dataclass

import numpy as np

from seo_slam.errors import FrameError, NoPathError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.grid import NavigationGrid


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """Two places that a way exists between.

    Attributes:
        escape: (1, 2) where a robot stands that is too near to something, to be put before the way; (0, 2) for one that is not.
        start, goal: (2,) free places of one connected part.
    """

    escape: FloatArray
    start: FloatArray
    goal: FloatArray


def ends_of(grid: NavigationGrid, start_xy: FloatArray, goal_xy: FloatArray) -> Ends:
    """Return the ends of a way.

    Raises:
        FrameError: a point is not two finite numbers.
        NoPathError: the start is not free and cannot be left, the goal is not free, or they are in different parts of the floor.
    """
    start, goal = _point(start_xy, "start"), _point(goal_xy, "goal")
    left = grid.way_out(start)
    if left is None:
        raise NoPathError(f"start {_place(start)}: {_how_far(grid, start)}")
    if not grid.is_free(goal[None])[0]:
        raise NoPathError(f"goal {_place(goal)}: {_how_far(grid, goal)}")
    if not grid.same_part(left, goal):
        raise NoPathError(
            f"no way from {_place(start)} to {_place(goal)}: the known free floor between them is interrupted "
            f"for a robot of radius {grid.radius_m:.2f} m"
        )
    escape = np.zeros((0, 2)) if left is start or np.array_equal(left, start) else start[None]
    return Ends(escape, left, goal)


def _point(xy_world: FloatArray, what: str) -> FloatArray:
    xy = np.asarray(xy_world, dtype=np.float64)
    if xy.shape not in ((2,), (3,)) or not np.isfinite(xy).all():
        raise FrameError(f"{what}: got {xy.tolist()}, wanted two finite numbers, metres in the world frame")
    return np.asarray(xy[:2])


def _place(xy: FloatArray) -> str:
    return f"({xy[0]:.2f}, {xy[1]:.2f})"


def _how_far(grid: NavigationGrid, xy: FloatArray) -> str:
    place = grid.nearest_free(xy, np.inf)
    if place is None:
        return f"got a layout without any free floor for a robot of radius {grid.radius_m:.2f} m"
    away_m = float(np.linalg.norm(place - xy))
    return f"not on the free floor; the nearest free cell is {away_m:.2f} m away, at {_place(place)}"
