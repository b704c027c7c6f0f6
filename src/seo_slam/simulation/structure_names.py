"""What the structure of a simulated world is called: walls, floor and ceiling by where they are, the rest by its own name."""

import re

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.world import Thing, World
from seo_slam.types import IntArray

WALL, FLOOR, CEILING = "wall", "floor", "ceiling"
_SHELLS = ("room", "walls")  # one thing for several sides of a room
_PARTS = (WALL, FLOOR, CEILING, "window")  # "house wall b" is a wall
_NEAR_M = 0.015


class StructureNames:
    """Tells the pieces of structure of a world apart, which all have one id in an instance image.

    Attributes:
        names: of the pieces; the first three are the wall, the floor and the ceiling.
    """

    def __init__(self, world: World) -> None:
        """Take the structure of a world; the smaller of two pieces is asked first whether a point is on it."""
        own = [thing for thing in world.structure if _name_of(thing) not in (WALL, FLOOR, CEILING)]
        self._pieces = sorted(own, key=lambda thing: float(np.prod(np.maximum(np.subtract(*thing.bounds_world[::-1]), 1e-3))))
        self.names: tuple[str, ...] = (WALL, FLOOR, CEILING, *(_name_of(piece) for piece in self._pieces))
        shell = [thing.bounds_world for thing in world.structure if _name_of(thing) in (WALL, FLOOR, CEILING)]
        self._floor_m = min(
            (float(high[2]) for thing in world.structure if _name_of(thing) == FLOOR for _, high in (thing.bounds_world,)), default=0.0
        )
        ceilings = [float(thing.bounds_world[0][2]) for thing in world.structure if _name_of(thing) == CEILING]
        self._ceiling_m = min(ceilings, default=max((float(high[2]) for _, high in shell), default=np.inf))

    def piece_of(self, p_world: FloatArray) -> IntArray:
        """Return (N,) which of ``names`` each point (N, 3) of structure is on."""
        piece = np.zeros(len(p_world), dtype=np.int64)
        piece[p_world[:, 2] <= self._floor_m + _NEAR_M] = 1
        piece[p_world[:, 2] >= self._ceiling_m - _NEAR_M] = 2
        for index in range(len(self._pieces) - 1, -1, -1):  # the smallest has the last word
            low, high = self._pieces[index].bounds_world
            inside = ((p_world >= low - _NEAR_M) & (p_world <= high + _NEAR_M)).all(axis=1)
            piece[inside & (piece != 1)] = 3 + index
        return piece


def _name_of(thing: Thing) -> str:
    if thing.label in _SHELLS:
        return WALL
    for part in _PARTS:
        if re.search(rf"\b{part}\b", thing.label):
            return part
    return re.sub(r" [a-z]$", "", thing.label)  # "light c": the third of its kind
