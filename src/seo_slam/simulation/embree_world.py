"""A world made ready for Embree: its trees, its paint, and what rays from a camera see of it."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.casting import parts_of
from seo_slam.simulation.embree_scene import Floats32, Ints32, RayScene, TriangleHits
from seo_slam.simulation.embree_shading import Band, light_up, paint_flat, paint_round, paint_sky
from seo_slam.simulation.face_paint import FacePaint
from seo_slam.simulation.renderer import holds_the_room
from seo_slam.simulation.world import STRUCTURE_ID, World
from seo_slam.types import BoolArray

_BAND, _FEWEST = 40_000, 4_000
"""Most rays that are drawn together: few enough for the processor's cache. Fewer than 4000 are not divided."""
_MOST_THREADS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Eye:
    """Where rays start.

    Attributes:
        T_world_camera: (4, 4).
        pixel_at_1m: width of a pixel at 1 m, metres.
    """

    T_world_camera: FloatArray
    pixel_at_1m: float


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What N rays meet.

    Attributes:
        t: (N,) depth along z; infinity where there is nothing.
        part: (N,) index into ``parts_of(world)``; -1 where there is nothing.
        colours: (3, N), 0 to 255.
        lit: (N,) whether light falls there.
    """

    t: Floats32
    part: Ints32
    colours: Floats32
    lit: BoolArray


class CompiledWorld:
    """The trees and the paint of a world.

    Room and furnishings are trees of their own, since only furnishings throw shadows; a second tree with both would take long to build.

    Attributes:
        ids: (P + 1,) thing id of every part; ``STRUCTURE_ID`` for none, the last.
    """

    def __init__(self, world: World) -> None:
        """Build them."""
        self._light, parts = world.light, parts_of(world)
        self._parts = [part for _, part in parts]
        self._poses = [thing.T_world_thing @ part.T_thing_part for thing, part in parts]
        rooms = [holds_the_room(thing) for thing, _ in parts]
        self._room, self._room_parts = self._tree([k for k, room in enumerate(rooms) if room])
        self._furnishings, self._furnishing_parts = self._tree([k for k, room in enumerate(rooms) if not room])
        self._paint = FacePaint(self._parts)
        self._glow = np.array([part.glow for part in self._parts] + [1.0], dtype=np.float32)  # the sky glows
        self.ids: Ints32 = np.array([thing.id for thing, _ in parts] + [STRUCTURE_ID], dtype=np.int32)

    def look(self, x: Floats32, y: Floats32, eye: Eye, shadows: bool) -> View:
        """Return what the rays ``(x, y, 1)`` of the camera frame, (N,) each, meet. Uses all processors of this process."""
        count = len(x)
        view = View(np.empty(count, np.float32), np.empty(count, np.int32), np.empty((3, count), np.float32), np.empty(count, np.bool_))

        def draw(rays: slice) -> None:
            self._draw(x[rays], y[rays], eye, shadows, View(view.t[rays], view.part[rays], view.colours[:, rays], view.lit[rays]))

        bands = _bands(count)
        threads = min(_threads(), len(bands))
        if threads > 1:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(draw, bands))
        else:
            for band in bands:
                draw(band)
        return view

    def _tree(self, indices: Sequence[int]) -> tuple[RayScene, Ints32]:
        """Return a tree over some parts, and the part of each shape in it (-1 last)."""
        return RayScene([(self._parts[k], self._poses[k]) for k in indices]), np.array([*indices, -1], dtype=np.int32)

    def _draw(self, x: Floats32, y: Floats32, eye: Eye, shadows: bool, out: View) -> None:
        """Fill in a band of a view."""
        T = eye.T_world_camera.astype(np.float32)
        directions = np.empty((len(x), 3), dtype=np.float32)
        for axis in range(3):
            directions[:, axis] = x * T[axis, 0] + y * T[axis, 1] + T[axis, 2]
        hits, part = self._cast(T[:3, 3], directions)
        band = Band.of(T[:3, 3], directions, hits, part, eye.pixel_at_1m)
        paint_sky(band)
        paint_flat(band, self._paint)
        paint_round(band, self._paint.covers, self._parts, self._poses)
        out.lit[:] = light_up(band, self._light, self._glow, self._furnishings if shadows else None)
        out.t[:], out.part[:], out.colours[:] = hits.t, part, band.colours

    def _cast(self, start: Floats32, directions: Floats32) -> tuple[TriangleHits, Ints32]:
        """Return the nearest hits and the part of each."""
        origins = np.empty_like(directions)
        origins[:] = start
        hits = self._furnishings.cast(origins, directions)
        part = self._furnishing_parts[hits.geometry]
        if not self._room.is_empty:
            walls = self._room.cast(origins, directions)
            nearer = walls.t < hits.t
            np.copyto(part, self._room_parts[walls.geometry], where=nearer)
            hits.take(walls, nearer)
        return hits, part


@lru_cache(maxsize=4)
def compiled(world: World) -> CompiledWorld:
    """Return a world made ready; the last few are kept."""
    return CompiledWorld(world)


def _bands(count: int) -> list[slice]:
    """Divide rays into an even number of bands of one size. It does not depend on the machine: the same input gives the same bytes."""
    number = 1 if count < _FEWEST else 2 * -(-count // (2 * _BAND))
    edges = [count * k // number for k in range(number + 1)]
    return [slice(first, end) for first, end in pairwise(edges)]


def _threads() -> int:
    """How many processors this process may use."""
    free = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(free, _MOST_THREADS)
