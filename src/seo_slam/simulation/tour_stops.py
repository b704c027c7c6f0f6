"""Where a tour of a home stops, so that all furniture and all that stands on it is seen."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.free_space import FreeSpace
from seo_slam.simulation.standpoints import SEEN_SHARE, Standpoints
from seo_slam.simulation.world import Thing, World

STOP_CLEARANCE_M = 0.31
"""Room around a place to stop: more than the path needs, so that it is smooth there."""

_FROM_BOX_M = (0.45, 1.7)  # distance from a piece of furniture; from a small thing it is half as much more
_BEST_M = 0.95
_GROUP_M = 1.3  # what stands together is looked at together
_HALF_VIEW_RAD = 0.42


@dataclass(frozen=True, eq=False)
class Stop:
    """A place to stop, and what to look at from there.

    Attributes:
        xy_world: (2,) metres.
        look_at_world: (3,) metres.
        seen_ids: what is seen from there.
    """

    xy_world: FloatArray
    look_at_world: FloatArray
    seen_ids: tuple[int, ...]


def stops_for(world: World, free: FreeSpace, things: Iterable[Thing]) -> list[Stop]:
    """Return stops from which some things of a world are seen, each by a stop of its own or together with its neighbours.

    What no stop can see is passed over: a path cannot go where there is no room.
    """
    standpoints = Standpoints(world, free)
    left = sorted(things, key=lambda thing: thing.id)
    stops = []
    while left:
        first = left[0]
        group = [thing for thing in left if thing is first or _apart_m(thing, first) < _GROUP_M]
        stop = _best_stop(standpoints, first, group)
        seen = set() if stop is None else set(stop.seen_ids)
        if stop is not None:
            stops.append(stop)
        left = [thing for thing in left if thing is not first and thing.id not in seen]
    return stops


def _apart_m(a: Thing, b: Thing) -> float:
    return float(np.linalg.norm(a.p_world - b.p_world))


def _best_stop(standpoints: Standpoints, first: Thing, group: Sequence[Thing]) -> Stop | None:
    """The place that sees the first thing, most of its neighbours in the same view, and stands at a good distance."""
    eyes = standpoints.near(first, _FROM_BOX_M[1], _FROM_BOX_M[0], STOP_CLEARANCE_M, 0.2, to_box=True)
    if not len(eyes):
        return None
    shares = np.stack([standpoints.seen_shares(thing, eyes) for thing in group])
    bearings = np.stack([_bearing(eyes, thing.p_world) for thing in group])
    own = group.index(first)
    off = np.abs((bearings - bearings[own] + np.pi) % (2.0 * np.pi) - np.pi)
    seen = (shares >= SEEN_SHARE) & (off < _HALF_VIEW_RAD)
    away = np.linalg.norm(eyes[:, :2] - first.p_world[:2], axis=1)
    score = seen.sum(axis=0) + 2.0 * seen[own] + 0.8 * shares[own] - 0.8 * np.abs(away - _BEST_M - 0.25 * _width_m(first))
    best = int(np.argmax(score))
    if not seen[own, best]:
        return None
    together = [thing for thing, visible in zip(group, seen[:, best], strict=True) if visible]
    small = [thing for thing in together if thing.kind == "volatile"]
    middle = np.mean([thing.p_world for thing in (small if small and first.kind == "volatile" else together)], axis=0)
    return Stop(eyes[best, :2], middle, tuple(thing.id for thing in together))


def _bearing(eyes: FloatArray, p_world: FloatArray) -> FloatArray:
    return np.asarray(np.arctan2(p_world[1] - eyes[:, 1], p_world[0] - eyes[:, 0]))


def _width_m(thing: Thing) -> float:
    low, high = thing.bounds_world
    return float((high - low)[:2].max())
