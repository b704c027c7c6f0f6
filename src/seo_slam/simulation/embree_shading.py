"""A world made ready for Embree, and the colours of what rays meet in it."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.simulation.casting import parts_of
from seo_slam.simulation.embree_scene import Floats32, RayScene, TriangleHits
from seo_slam.simulation.mesh_paint import PaintBox
from seo_slam.simulation.meshes import MeshShape
from seo_slam.simulation.primitives import row_dots
from seo_slam.simulation.renderer import _SKY as SKY
from seo_slam.simulation.world import STRUCTURE_ID, Thing, World
from seo_slam.types import BoolArray, IntArray

_LIFT_M = np.float32(3e-4)  # rays towards the light start this far above the surface
_ROOM_M = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What N rays meet: hits, colours (N, 3) in 0..1 and whether light falls there (N,)."""

    hits: TriangleHits
    colours: Floats32
    lit: BoolArray


class CompiledWorld:
    """The trees and the paint of a world."""

    def __init__(self, world: World) -> None:
        """Build them."""
        self._light = world.light
        self._parts = parts_of(world)
        self._poses = [thing.T_world_thing @ part.T_thing_part for thing, part in self._parts]
        placed = [(part, T) for (_, part), T in zip(self._parts, self._poses, strict=True)]
        self._all = RayScene(placed)
        self._shading = RayScene([pair for pair, (thing, _) in zip(placed, self._parts, strict=True) if not _holds_the_room(thing)])
        self._paints = PaintBox([part.shape.paint if isinstance(part.shape, MeshShape) else None for part, _ in placed], placed)
        self.ids = np.array([thing.id for thing, _ in self._parts] + [STRUCTURE_ID], dtype=np.int32)
        self._glow = np.array([part.glow for part, _ in placed] + [1.0], dtype=np.float32)  # the sky glows

    def look(self, xy: FloatArray, T_world_camera: FloatArray, pixel_at_1m: float, shadows: bool) -> View:
        """Return what the rays ``(x, y, 1)`` of the camera frame (N, 2) meet."""
        R, start = T_world_camera[:3, :3], T_world_camera[:3, 3].astype(np.float32)
        directions = np.empty((len(xy), 3), dtype=np.float32)
        for axis in range(3):
            directions[:, axis] = xy[:, 0] * R[axis, 0] + xy[:, 1] * R[axis, 1] + R[axis, 2]
        origins = np.empty_like(directions)
        origins[:] = start
        hits = self._all.cast(origins, directions)
        return self._shaded(hits, origins, directions, pixel_at_1m, shadows)

    def _shaded(self, hits: TriangleHits, origins: Floats32, directions: Floats32, pixel_at_1m: float, shadows: bool) -> View:
        met = hits.geometry >= 0
        t = np.where(met, hits.t, np.float32(1.0))
        p_world = origins + directions * t[:, None]
        normals = _unit(hits.normals)
        normals[~met] = (0.0, 0.0, 1.0)
        slant = np.abs(row_dots(normals, directions)) / np.sqrt(row_dots(directions, directions))
        footprint_m = t * np.float32(pixel_at_1m) / np.sqrt(np.clip(slant, 0.1, 1.0))
        colours = np.empty((len(t), 3), dtype=np.float32)
        colours[~met] = SKY
        painted = np.flatnonzero(self._paints.covers[hits.geometry])
        colours[painted] = self._paints.colours(
            hits.geometry[painted], hits.triangle[painted], hits.u[painted], hits.v[painted], footprint_m[painted]
        )
        others = np.flatnonzero(met & ~self._paints.covers[hits.geometry])
        self._shade_primitives(hits, others, p_world, footprint_m, normals, colours)
        away = row_dots(normals, directions) > 0
        normals[away] *= np.float32(-1.0)
        facing = np.clip(row_dots(normals, self._light.direction_world.astype(np.float32)), 0.0, 1.0)
        lit = met & (facing > 0)
        if shadows:
            rows = np.flatnonzero(lit)
            to_light = np.empty((len(rows), 3), dtype=np.float32)
            to_light[:] = self._light.direction_world
            lit[rows] = ~self._shading.blocked(p_world[rows] + _LIFT_M * normals[rows], to_light)
        ambient = np.float32(self._light.ambient)
        brightness = ambient + (1 - ambient) * facing * lit * np.float32(1.25)
        glow = self._glow[hits.geometry]
        colours *= (glow + (1 - glow) * brightness)[:, None]
        return View(hits, colours, lit)

    def _shade_primitives(
        self, hits: TriangleHits, rows: IntArray, p_world: Floats32, footprint_m: Floats32, normals: Floats32, colours: Floats32
    ) -> None:
        """Fill in colours, and the exact normals in place of the triangles', of the pixels ``rows``."""
        geometry = hits.geometry[rows]
        order = np.argsort(geometry.astype(np.int16) if len(self._parts) < 32_000 else geometry, kind="stable")
        sorted_geometry = geometry[order]
        starts = np.flatnonzero(np.diff(sorted_geometry, prepend=-1))
        for start, end in zip(starts, [*starts[1:], len(order)], strict=True):
            some = rows[order[start:end]]
            index = int(sorted_geometry[start])
            part, T = self._parts[index][1], self._poses[index]
            R = T[:3, :3]
            p_part = _turned(p_world[some] - T[:3, 3], R.T)
            if part.shape.is_mesh:
                n_part = _turned(normals[some], R.T)
            else:
                n_part = part.shape.normals(p_part)
                normals[some] = _turned(n_part, R)
            colours[some] = part.texture.colours(p_part, n_part, footprint_m[some])


@lru_cache(maxsize=4)
def compiled(world: World) -> CompiledWorld:
    """Return a world made ready; the last few are kept."""
    return CompiledWorld(world)


def _turned(v: NDArray[np.floating], R: FloatArray) -> FloatArray:
    """Return ``R @ v`` for rows v (N, 3); see the same in ``renderer``."""
    out = np.empty((3, len(v)))
    for row, (a, b, c) in zip(out, R, strict=True):
        np.multiply(v[:, 0], a, out=row)
        row += b * v[:, 1]
        row += c * v[:, 2]
    return out.T


def _unit(v: Floats32) -> Floats32:
    return v / np.maximum(np.sqrt(row_dots(v, v)), np.float32(1e-30))[:, None]


def _holds_the_room(thing: Thing) -> bool:
    """Structure larger than 2.5 m across is wall or floor: light comes in through it."""
    low, high = thing.bounds_thing
    return thing.id == STRUCTURE_ID and float((high - low)[:2].max()) > _ROOM_M
