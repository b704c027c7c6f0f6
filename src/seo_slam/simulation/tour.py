"""A tour of a home: a camera that walks past all furniture, stops, and looks at what stands there."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.simulation.draws import generator
from seo_slam.simulation.free_space import FreeSpace
from seo_slam.simulation.standpoints import EYE_M
from seo_slam.simulation.tour_path import Line, Ways, smoothed, visiting_order
from seo_slam.simulation.tour_stops import Stop
from seo_slam.simulation.trajectory import look_at
from seo_slam.types import IntArray

RATE_HZ = 6.0
SPEED_M_S = 0.55
MOST_TURN_RAD_S = np.radians(45.0)

_TICK_S = 0.05
_STOP_S = 1.2
_LOOK_BEFORE_M, _LOOK_AFTER_M = 0.8, 0.25  # along the path, the camera is on what it stops for
_AHEAD_M = 1.2
_TOO_SHORT_M = 1.5  # no look ahead between two stops that are no farther apart than this
_LEVEL_RAD = -0.17  # how far it looks down while it walks
_PITCH_RAD = (-0.72, 0.0)
_TURN_SMOOTH_S, _WALK_SMOOTH_S = 0.45, 0.35
_EASE_TICKS = 9
_SWAY_M = 0.05


@dataclass(frozen=True, eq=False)
class Tour:
    """A walk, as poses at any time.

    Attributes:
        timestamps_s: (N,) of fine steps.
        p_world: (N, 3) where the camera is.
        yaw_rad, pitch_rad: (N,) where it looks; yaw is unwrapped.
        line: the path on the floor.
        legs_end_s: when each of its legs is over.
    """

    timestamps_s: FloatArray
    p_world: FloatArray
    yaw_rad: FloatArray
    pitch_rad: FloatArray
    line: Line
    legs_end_s: tuple[float, ...]

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.timestamps_s[-1])

    def trajectory(self, frames: int | None = None) -> Trajectory:
        """Return poses at even times; ``None`` means ``RATE_HZ`` a second.

        Raises:
            ConfigError: fewer than two frames.
        """
        if frames is not None and frames < 2:
            raise ConfigError(f"frames: got {frames}, wanted at least 2")
        stamps_s = np.round(
            np.arange(int(self.seconds * RATE_HZ) + 1) / RATE_HZ if frames is None else np.linspace(0.0, self.seconds, frames), 6
        )
        eyes = np.stack([np.interp(stamps_s, self.timestamps_s, self.p_world[:, k]) for k in range(3)], axis=-1)
        yaw, pitch = (np.interp(stamps_s, self.timestamps_s, angle) for angle in (self.yaw_rad, self.pitch_rad))
        poses = np.stack([look_at(eye, eye + ahead) for eye, ahead in zip(eyes, _direction(yaw, pitch), strict=True)])
        return Trajectory(stamps_s, poses)


def plan_tour(free: FreeSpace, legs: Sequence[Sequence[Stop]], seed: int) -> Tour:
    """Return a tour.

    Args:
        free: the floor.
        legs: stops; those of a leg are visited in the order that makes the way short, one leg after the other.
        seed: of the sway of the camera.

    Raises:
        ConfigError: nothing to stop at, or a stop that cannot be reached.
    """
    if not any(legs):
        raise ConfigError("tour: got no stops, wanted a home in which something can be seen from the free floor")
    ways = Ways(free)
    points, order, ends = _walked(ways, legs)
    line = Line(smoothed(points, free))
    at_m = _stops_along(line, order)
    walked_m, ends_tick = _pace(line.length_m, at_m, ends)
    yaw, pitch = _gaze(line, walked_m, order, at_m)
    xy = line.at(walked_m)
    turn = np.hypot(np.diff(yaw), np.diff(pitch))
    needed_s = np.maximum(_TICK_S, turn / (0.9 * MOST_TURN_RAD_S))  # turning takes its time, and one slows down for it
    steps_s = gaussian_filter1d(maximum_filter1d(needed_s, _EASE_TICKS), _EASE_TICKS / 3.0)
    stamps_s = np.concatenate([[0.0], np.cumsum(steps_s)])
    height = EYE_M + _sway(stamps_s, generator(seed, "tour sway"))
    p_world = np.column_stack([xy, height])
    return Tour(stamps_s, p_world, yaw, pitch, line, tuple(float(stamps_s[k]) for k in ends_tick))


def _walked(ways: Ways, legs: Sequence[Sequence[Stop]]) -> tuple[FloatArray, list[Stop], list[int]]:
    """The cells walked over, the stops in their order, and how many stops there are up to the end of each leg."""
    order: list[Stop] = []
    ends: list[int] = []
    points: list[FloatArray] = []
    for leg in legs:
        stops = [*order[-1:], *leg]
        if stops:
            nodes = ways.nodes(np.stack([stop.xy_world for stop in stops]))
            costs, previous = ways.between(nodes)
            if not np.isfinite(costs).all():
                raise ConfigError("tour: got a stop that cannot be reached, wanted free floor in one part")
            visit = visiting_order(costs)
            points += [ways.way(previous[a], int(nodes[a]), int(nodes[b])) for a, b in pairwise(visit)]
            order += [stops[k] for k in (visit[1:] if order else visit)]
        ends.append(len(order))
    if sum(len(p) for p in points) < 2:
        raise ConfigError("tour: got a single place to stop at, wanted at least two")
    return np.concatenate(points), order, ends


def _stops_along(line: Line, order: Sequence[Stop]) -> FloatArray:
    """How far along the line each stop is: in their order, each at the nearest point that is not far behind the one before."""
    walked_m = np.linspace(0.0, line.length_m, max(int(line.length_m / 0.02), 2))
    xy = line.at(walked_m)
    costs = np.linalg.norm(xy[None] - np.stack([stop.xy_world for stop in order])[:, None], axis=2)
    best = costs[0].copy()  # least sum of distances for stops in order, by dynamic programming
    came = []
    for row in costs[1:]:
        low = np.minimum.accumulate(best)
        came.append(np.maximum.accumulate(np.where(best <= low, np.arange(len(best)), 0)))
        best = low + row
    index = int(np.argmin(best))
    found = [index]
    for row in reversed(came):
        index = int(row[index])
        found.append(index)
    return np.asarray(walked_m[found[::-1]])


def _pace(length_m: float, at_m: FloatArray, ends: Sequence[int]) -> tuple[FloatArray, list[int]]:
    """How far one has come at each tick, stopping at every stop; and the tick at which each leg is over."""
    pieces: list[FloatArray] = []
    ends_tick: list[int] = []
    here_m, ticks = 0.0, 0
    waits = np.full(int(_STOP_S / _TICK_S), 0.0)
    for k, stop_m in enumerate([*at_m, length_m]):
        walk = here_m + np.arange(0.0, stop_m - here_m, SPEED_M_S * _TICK_S)
        pieces += [walk, stop_m + waits]
        ticks += len(walk) + len(waits)
        here_m = float(stop_m)
        ends_tick += [ticks - 1] * sum(end == k + 1 for end in ends)
    walked_m = gaussian_filter1d(np.concatenate(pieces), _WALK_SMOOTH_S / _TICK_S, mode="nearest")
    return np.asarray(walked_m), ends_tick


def _gaze(line: Line, walked_m: FloatArray, order: Sequence[Stop], at_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Yaw and pitch at each tick: on what the camera is about to stop for, else ahead."""
    eyes = line.at(walked_m)
    ahead = line.at(np.minimum(walked_m + _AHEAD_M, line.length_m)) - eyes
    behind = eyes - line.at(np.maximum(walked_m - _AHEAD_M, 0.0))
    ahead = np.where(np.linalg.norm(ahead, axis=1, keepdims=True) > 0.3, ahead, behind)
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    pitch = np.full(len(eyes), _LEVEL_RAD)
    looking = _stop_in_view(walked_m, at_m)
    for k, stop in enumerate(order):
        here = looking == k
        to_thing = stop.look_at_world[:2] - eyes[here]
        yaw[here] = np.arctan2(to_thing[:, 1], to_thing[:, 0])
        pitch[here] = np.clip(np.arctan2(stop.look_at_world[2] - EYE_M, np.linalg.norm(to_thing, axis=1)), *_PITCH_RAD)
    sigma = _TURN_SMOOTH_S / _TICK_S
    return (
        np.asarray(gaussian_filter1d(np.unwrap(yaw), sigma, mode="nearest")),
        np.asarray(gaussian_filter1d(pitch, sigma, mode="nearest")),
    )


def _stop_in_view(walked_m: FloatArray, at_m: FloatArray) -> IntArray:
    """Index of the stop that the camera is on at each tick; -1 while it looks ahead, which it does only where there is time for it."""
    looking = np.full(len(walked_m), -1, dtype=np.int64)
    nearest = np.full(len(walked_m), np.inf)
    for k, stop_m in enumerate(at_m):
        off_m = walked_m - stop_m
        here = (off_m > -_LOOK_BEFORE_M) & (off_m < _LOOK_AFTER_M) & (np.abs(off_m) < nearest)
        nearest[here] = np.abs(off_m[here])
        looking[here] = k
    busy = np.flatnonzero(looking >= 0)
    for last, first in pairwise(busy):
        if first - last > 1 and walked_m[first] - walked_m[last] < _TOO_SHORT_M:
            middle = (last + first) // 2
            looking[last + 1 : middle], looking[middle:first] = looking[last], looking[first]
    return looking


def _direction(yaw: FloatArray, pitch: FloatArray) -> FloatArray:
    return np.stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)], axis=-1)


def _sway(stamps_s: FloatArray, draws: np.random.Generator) -> FloatArray:
    """Slow rise and fall of a carried camera, within ``_SWAY_M``."""
    phases = draws.uniform(0.0, 2.0 * np.pi, 2)
    return np.asarray(_SWAY_M * (0.6 * np.sin(0.55 * stamps_s + phases[0]) + 0.4 * np.sin(1.3 * stamps_s + phases[1])))
