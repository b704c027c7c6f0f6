"""Along a path, one command a frame: a waypoint for robots that take waypoints, and the same as a velocity."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.navigation.outcomes import Command
from seo_slam.navigation.parts import Grid
from seo_slam.settings.navigation import NavigationSettings

_TURN_GAIN_HZ = 2.0  # so much of the difference is turned off a second
_ON_COURSE_RAD = 0.6  # farther off its course a robot turns on the spot
_SAMPLE_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Stance:
    """Where a robot is on the floor, world frame.

    Attributes:
        xy_world: (2,) metres.
        yaw_rad: where it looks.
    """

    xy_world: FloatArray
    yaw_rad: float

    @classmethod
    def of(cls, T_world_camera: FloatArray) -> "Stance":
        """Return the stance of a robot whose camera (looking along z) has this pose (4, 4)."""
        return cls(T_world_camera[:2, 3].copy(), float(np.arctan2(T_world_camera[1, 2], T_world_camera[0, 2])))


class Follower:
    """Follows one path by heading for a point a little ahead on it, as far as that can be seen over free floor (pure pursuit)."""

    def __init__(self, path_world: FloatArray, grid: Grid, settings: NavigationSettings) -> None:
        """Take a path (N, 2), world frame, and the free floor."""
        self._path = _dense(np.asarray(path_world, dtype=np.float64).reshape(-1, 2))
        self._grid = grid
        self._settings = settings
        self._at = 0

    @property
    def left_m(self) -> float:
        """Length of the path from the point nearest to the robot."""
        return float(np.linalg.norm(np.diff(self._path[self._at :], axis=0), axis=1).sum())

    def command(self, stance: Stance) -> Command | None:
        """Return what to do now; None when the end is reached."""
        settings = self._settings
        end = self._path[-1]
        if np.linalg.norm(end - stance.xy_world) <= settings.reach_m:
            return None
        window = self._path[self._at : self._at + int(2.0 * settings.look_ahead_m / _SAMPLE_M) + 2]
        self._at += int(np.argmin(np.linalg.norm(window - stance.xy_world, axis=1)))  # only forward: a path may cross itself
        return towards(self._target(stance.xy_world), stance, settings)

    def _target(self, xy: FloatArray) -> FloatArray:
        """The farthest point within the look-ahead to which the floor is free in a straight line, at least the next one."""
        nearest = self._at
        last = min(nearest + max(round(self._settings.look_ahead_m / _SAMPLE_M), 1), len(self._path) - 1)
        for k in range(last, nearest + 1, -1):
            if self._grid.is_clear(xy, self._path[k]):
                return np.asarray(self._path[k])
        return np.asarray(self._path[min(nearest + 1, len(self._path) - 1)])


def towards(xy_world: FloatArray, stance: Stance, settings: NavigationSettings) -> Command:
    """Return the command that drives a robot to a point (2,): first turning on the spot if it is far off its course."""
    way = xy_world - stance.xy_world
    off = turned_by(stance.yaw_rad, float(np.arctan2(way[1], way[0])))
    forward = 0.0 if abs(off) > _ON_COURSE_RAD else min(settings.speed_m_s, _TURN_GAIN_HZ * float(np.linalg.norm(way))) * float(np.cos(off))
    return Command("go", xy_world.copy(), None, forward, _turning(off, settings))


def turn_to(yaw_rad: float, stance: Stance, settings: NavigationSettings) -> Command | None:
    """Return the command that turns a robot to a heading; None when it has it."""
    off = turned_by(stance.yaw_rad, yaw_rad)
    if abs(off) <= settings.turned_rad:
        return None
    return Command("turn", stance.xy_world.copy(), wrapped(yaw_rad), 0.0, _turning(off, settings))


def wait(stance: Stance) -> Command:
    """Return the command to stay and look on: a turn to where the robot looks already."""
    return Command("turn", stance.xy_world.copy(), stance.yaw_rad)


def stop(stance: Stance) -> Command:
    """Return the command that ends a drive."""
    return Command("stop", stance.xy_world.copy())


def turned_by(from_rad: float, to_rad: float) -> float:
    """Return the turn from one heading to another, in [-pi, pi)."""
    return wrapped(to_rad - from_rad)


def wrapped(angle_rad: float) -> float:
    """Return an angle in [-pi, pi)."""
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def path_length_m(path_world: FloatArray) -> float:
    """Return the length of a path (N, 2)."""
    return float(np.linalg.norm(np.diff(path_world, axis=0), axis=1).sum())


def _turning(off_rad: float, settings: NavigationSettings) -> float:
    return float(np.clip(_TURN_GAIN_HZ * off_rad, -settings.turn_rad_s, settings.turn_rad_s))


def _dense(path: FloatArray) -> FloatArray:
    """The path with a point at least every ``_SAMPLE_M``."""
    pieces = [path[:1]]
    for a, b in pairwise(path):
        count = max(int(np.ceil(np.linalg.norm(b - a) / _SAMPLE_M)), 1)
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)
