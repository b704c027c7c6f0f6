"""From where a thing in a home can be seen by somebody who stands on the free floor."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.casting import parts_of
from seo_slam.simulation.free_space import ROBOT_RADIUS_M, FreeSpace, home_caster
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.world import Thing, World
from seo_slam.types import BoolArray

EYE_M = 1.3
"""Height of the camera."""

SEEN_SHARE = 0.4
"""A thing counts as seen if this share of the points that stand for it is."""

_POINTS = np.array(
    [[0, 0, 0], [0.6, 0.6, 0.5], [0.6, -0.6, 0.5], [-0.6, 0.6, 0.5], [-0.6, -0.6, 0.5], [0, 0, 0.8], [0, 0, -0.5]]
)  # of half a box


class Standpoints:
    """Lines of sight in a home. Furniture and structure are what they are; things that are carried about hide others by their boxes."""

    def __init__(self, world: World, free: FreeSpace) -> None:
        """Take a world and where its floor is free."""
        self._free = free
        self._main_parts: dict[float, BoolArray] = {}
        self._carried = tuple(thing for thing in world.things if thing.kind == "volatile")
        bare = replace(world, things=tuple(thing for thing in world.things if thing.kind != "volatile"))
        self._caster = home_caster(bare)
        self._owner_ids = np.array([thing.id for thing, _ in parts_of(bare)] + [-1])

    def seen_shares(self, thing: Thing, eyes_world: FloatArray, carried: Sequence[Thing] | None = None) -> FloatArray:
        """Return (N,) how much of a thing is seen from points (N, 3): the share of a few points of its box with nothing before them.

        Args:
            thing: of this world, or to be placed in it.
            eyes_world: (N, 3) metres.
            carried: what is carried about, instead of the world's own.
        """
        low, high = thing.bounds_world
        points = (low + high) / 2.0 + _POINTS * (high - low) / 2.0
        starts = np.repeat(eyes_world, len(points), axis=0)
        rays = np.tile(points, (len(eyes_world), 1)) - starts
        hits = self._caster.cast(starts, rays)
        seen = (self._owner_ids[hits.part] == thing.id) | (hits.t > 0.999)
        for other in self._carried if carried is None else carried:
            if other.id != thing.id:
                low, high = other.bounds_world
                x, y, z = (float(size) for size in high - low)
                seen &= Box((x, y, z)).intersect(starts - other.p_world, rays) > 0.999
        return np.asarray(seen.reshape(len(eyes_world), len(points)).mean(axis=1))

    def near(
        self,
        thing: Thing,
        most_m: float,
        least_m: float = 0.0,
        radius_m: float = ROBOT_RADIUS_M,
        every_m: float = 0.1,
        to_box: bool = False,
    ) -> FloatArray:
        """Return (N, 3) eyes on the free floor between two distances from a thing's middle, in the plane.

        Args:
            thing: what to stand near.
            most_m: largest distance in the plane.
            least_m: smallest one.
            radius_m: clearance that the place must have, in the main part of the floor.
            every_m: spacing of the places.
            to_box: measure from the edge of its box and not from its middle.
        """
        low, high = (corner[:2] for corner in thing.bounds_world)
        if not to_box:
            low = high = (low + high) / 2.0
        step = max(round(every_m / self._free.cell_m), 1)
        grid = np.zeros_like(self._free.occupied)
        grid[step // 2 :: step, step // 2 :: step] = True
        first, last = self._free.cells(np.stack([low - most_m, high + most_m]))
        window = np.zeros_like(grid)
        window[first[0] : last[0] + 1, first[1] : last[1] + 1] = True
        xy = self._free.middles(np.argwhere(window & grid & self._main(radius_m)))
        away = np.linalg.norm(np.maximum(np.maximum(low - xy, xy - high), 0.0), axis=1)
        xy = xy[(away <= most_m) & (away >= least_m)]
        return np.column_stack([xy, np.full(len(xy), EYE_M)])

    def can_be_reached(self, thing: Thing, carried: Sequence[Thing] | None = None, within_m: float = 1.0) -> bool:
        """Whether a robot can stand within a distance of a thing's middle, in the plane, and see it from there."""
        eyes = self.near(thing, within_m)
        return bool(len(eyes)) and bool((self.seen_shares(thing, eyes, carried) >= SEEN_SHARE).any())

    def _main(self, radius_m: float) -> BoolArray:
        if radius_m not in self._main_parts:
            self._main_parts[radius_m] = self._free.main_part(radius_m)
        return self._main_parts[radius_m]
