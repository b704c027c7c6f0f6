"""Where a thing can come to rest, found by rays, and how close things stand."""

from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.casting import Caster, parts_of
from seo_slam.simulation.world import Thing, World

FLAT_M = 0.004
"""A surface to stand on rises and falls by no more than this."""

_RAY_STEP_M = 0.04


@dataclass(frozen=True, slots=True, eq=False)
class Footing:
    """What a thing rests on, or hangs on.

    Attributes:
        at_m: height of the surface; for a wall, its y.
        owner: the piece of structure.
    """

    at_m: float
    owner: Thing


class Surfaces:
    """The surfaces of a world's structure."""

    def __init__(self, world: World, caster: Caster) -> None:
        """Take a world and what casts rays at it."""
        self._caster = caster
        self._owners = [thing for thing, _ in parts_of(world)]

    def below(self, low_xy: FloatArray, high_xy: FloatArray, from_z_m: float) -> Footing | None:
        """Return what carries a footprint: one piece, level all over; None if there is no such thing straight below."""
        x, y = _grid(low_xy, high_xy)
        starts = np.stack([x, y, np.full_like(x, from_z_m)], axis=-1)
        t, owner = self._hits(starts, np.array([0.0, 0.0, -1.0]))
        return None if owner is None else Footing(float(from_z_m - t.min()), owner)

    def behind(self, low_xz: FloatArray, high_xz: FloatArray, from_y_m: float) -> Footing | None:
        """Return what is behind an upright rectangle, towards +y: one piece, even all over."""
        x, z = _grid(low_xz, high_xz)
        starts = np.stack([x, np.full_like(x, from_y_m), z], axis=-1)
        t, owner = self._hits(starts, np.array([0.0, 1.0, 0.0]))
        return None if owner is None else Footing(float(from_y_m + t.min()), owner)

    def _hits(self, starts: FloatArray, direction: FloatArray) -> tuple[FloatArray, Thing | None]:
        hits = self._caster.cast(starts, np.broadcast_to(direction, starts.shape).copy())
        if not np.isfinite(hits.t).all() or np.ptp(hits.t) > FLAT_M:
            return hits.t, None
        owner = self._owners[int(hits.part[0])]
        return hits.t, owner if all(self._owners[int(k)] is owner for k in np.unique(hits.part)) else None


def _grid(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    counts = [max(int(np.ceil((b - a) / _RAY_STEP_M)) + 1, 3) for a, b in zip(low, high, strict=True)]
    first, second = np.meshgrid(*(np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True)))
    return first.ravel(), second.ravel()


def box_gap_m(low: FloatArray, high: FloatArray, others_low: FloatArray, others_high: FloatArray) -> FloatArray:
    """Return the distances (N,) between a box and N others, all along the axes; 0 where they touch or overlap."""
    apart = np.maximum(np.maximum(others_low - high, low - others_high), 0.0)
    return np.asarray(np.linalg.norm(apart, axis=-1))


def gap_m(a: Thing, b: Thing) -> float:
    """Return the distance between the world boxes of two things."""
    low, high = b.bounds_world
    return float(box_gap_m(*a.bounds_world, low[None], high[None])[0])


def linked(things: list[Thing], most_m: float) -> bool:
    """Whether each of these can be reached from the first by steps between boxes of at most ``most_m``."""
    if not things:
        return True
    reached, rest = [things[0]], list(things[1:])
    while reached and rest:
        here = reached.pop()
        near = [thing for thing in rest if gap_m(here, thing) <= most_m]
        rest = [thing for thing in rest if all(thing is not n for n in near)]
        reached += near
    return not rest
