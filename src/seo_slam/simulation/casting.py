"""Rays into a world: where a thing would come to rest, whether a wall stands between two points."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.world import Part, Thing, World
from seo_slam.types import IntArray


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """The nearest hit of each of N rays.

    Attributes:
        t: (N,) in lengths of the ray's direction; infinity where it meets nothing.
        part: (N,) index into ``parts_of(world)``; -1 where it meets nothing.
    """

    t: FloatArray
    part: IntArray


class Caster(Protocol):
    """Casts rays at one world."""

    def cast(self, p_world: FloatArray, directions: FloatArray) -> RayHits:
        """Cast rays from points (N, 3) along directions (N, 3), world frame."""
        ...


def parts_of(world: World) -> list[tuple[Thing, Part]]:
    """Return every part of a world with its thing, in the order that renderers and casters number them."""
    return [(thing, part) for thing in world for part in thing.parts]


class PrimitiveCaster:
    """Casts rays at the exact shapes of a world without meshes; for some hundred rays at a time."""

    def __init__(self, world: World) -> None:
        """Take the world."""
        self._parts = parts_of(world)

    def cast(self, p_world: FloatArray, directions: FloatArray) -> RayHits:
        """See ``Caster``."""
        best = RayHits(np.full(len(p_world), np.inf), np.full(len(p_world), -1, dtype=np.int64))
        for index, (thing, part) in enumerate(self._parts):
            T = thing.T_world_thing @ part.T_thing_part
            R = T[:3, :3]
            t = part.shape.intersect((p_world - T[:3, 3]) @ R, directions @ R)
            nearer = t < best.t
            best.t[nearer], best.part[nearer] = t[nearer], index
        return best


def caster_for(world: World) -> Caster:
    """Return what casts rays at this world: Embree's if it is installed, else the one for primitives.

    Raises:
        MissingBackendError: the world holds meshes and the extra ``sim`` is not installed.
    """
    from seo_slam.simulation.rendering import embree_is_installed, require_embree

    if embree_is_installed() or any(part.shape.is_mesh for _, part in parts_of(world)):
        require_embree("casting rays at meshes")
        from seo_slam.simulation.embree import EmbreeCaster

        return EmbreeCaster(world)
    return PrimitiveCaster(world)
