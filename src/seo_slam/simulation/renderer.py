"""A small ray caster: colour, depth and instance of every pixel, exact for the shapes of ``primitives``.

Every thing is first held against the rays by its box, then its parts are cast at what is left. Light is Lambert's, from one direction,
with hard shadows; pixels on an edge are averaged over four rays, in colour only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse
from seo_slam.simulation.primitives import row_dots
from seo_slam.simulation.world import STRUCTURE_ID, Part, Thing, World, box_corners
from seo_slam.types import BoolArray, IntArray

SUBPIXELS = np.array([[-0.35, -0.12], [0.28, -0.25], [0.07, 0.37]])  # beside the ray through the middle
SKY = np.array([0.75, 0.82, 0.9])


@dataclass(frozen=True, slots=True, eq=False)
class Rendered:
    """What a perfect camera sees.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) float32, along z; 0 where a ray meets nothing.
        instance_ids: (H, W) int32, id of the thing in each pixel; ``STRUCTURE_ID`` elsewhere.
        covered_px: thing id -> pixels that it would cover if nothing stood before it; only things in view.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    instance_ids: NDArray[np.int32]
    covered_px: Mapping[int, int] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class _Hits:
    """Nearest hit of each ray: distance along it and index of the part (-1: none)."""

    t: FloatArray
    part: IntArray
    covered_px: dict[int, int]


def render(world: World, camera: Camera, T_world_camera: FloatArray, smooth_edges: bool = True) -> Rendered:
    """Return what ``camera`` sees from ``T_world_camera`` (4, 4).

    Args:
        world: what there is.
        camera: intrinsics and image size; lens distortion is honoured.
        T_world_camera: (4, 4).
        smooth_edges: whether pixels on an edge get the mean colour of four rays.
    """
    xy = camera.rays().reshape(-1, 2)
    parts = [(thing, part) for thing in world for part in thing.parts]
    hits = _cast(world, xy, T_world_camera)
    colours, lit = _shade(world, parts, hits, xy, T_world_camera, 1.0 / camera.fx)
    size = (camera.height, camera.width)
    if smooth_edges:
        _average_edges(world, parts, camera, T_world_camera, hits, lit, colours)
    ids = np.array([thing.id for thing, _ in parts] + [STRUCTURE_ID], dtype=np.int32)
    return Rendered(
        rgb=np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8).reshape(*size, 3),
        depth_m=np.where(np.isfinite(hits.t), hits.t, 0.0).astype(np.float32).reshape(size),
        instance_ids=ids[hits.part].reshape(size),
        covered_px=hits.covered_px,
    )


def _cast(world: World, xy: FloatArray, T_world_camera: FloatArray) -> _Hits:
    """Cast the rays ``(x, y, 1)`` of the camera frame (N, 2) at everything; t is then the depth along z.

    Parts are numbered as ``for thing in world: for part in thing.parts`` meets them.
    """
    directions = np.concatenate([xy, np.ones((len(xy), 1))], axis=1)
    best = _Hits(np.full(len(xy), np.inf), np.full(len(xy), -1, dtype=np.int64), {})
    T_camera_world = inverse(T_world_camera)
    index = 0
    for thing in world:
        T_camera_thing = T_camera_world @ thing.T_world_thing
        rays = _rays_at_box(xy, *thing.bounds_thing, T_camera_thing)
        own_t = np.full(len(rays), np.inf)
        own_part = np.full(len(rays), -1, dtype=np.int64)
        for part in thing.parts:
            T_camera_part = T_camera_thing @ part.T_thing_part
            some = _rays_at_box(xy[rays], *part.shape.bounds(), T_camera_part) if len(thing.parts) > 1 else np.arange(len(rays))
            R, p = T_camera_part[:3, :3], T_camera_part[:3, 3]
            t = part.shape.intersect(-p @ R, _turned(directions[rays[some]], R.T))
            nearer = t < own_t[some]
            own_t[some[nearer]] = t[nearer]
            own_part[some[nearer]] = index
            index += 1
        covered = int(np.isfinite(own_t).sum())
        if covered and thing.id != STRUCTURE_ID:
            best.covered_px[thing.id] = covered
        nearer = own_t < best.t[rays]
        best.t[rays[nearer]] = own_t[nearer]
        best.part[rays[nearer]] = own_part[nearer]
    return best


def _rays_at_box(xy: FloatArray, low: FloatArray, high: FloatArray, T_camera_box: FloatArray) -> IntArray:
    """Return indices of the rays that pass the rectangle around a box in the image; all of them if it reaches behind the camera."""
    corners = box_corners(low, high) @ T_camera_box[:3, :3].T + T_camera_box[:3, 3]
    z = corners[:, 2]
    if z.max() <= 0:
        return np.zeros(0, dtype=np.int64)
    if z.min() <= 1e-3:
        return np.arange(len(xy))
    flat = corners[:, :2] / z[:, None]
    (x0, y0), (x1, y1) = flat.min(axis=0), flat.max(axis=0)
    return np.flatnonzero((xy[:, 0] >= x0) & (xy[:, 0] <= x1) & (xy[:, 1] >= y0) & (xy[:, 1] <= y1))


def _turned(v: FloatArray, R: FloatArray) -> FloatArray:
    """Return ``R @ v`` for rows v (N, 3), laid out column by column: shapes work on one coordinate at a time.

    Written out, since a matrix product of this form wakes the threads of the linear algebra library: twice the processor time.
    """
    x, y, z = v[:, 0], v[:, 1], v[:, 2]
    out = np.empty((3, len(v)))
    for row, (a, b, c) in zip(out, R, strict=True):
        np.multiply(x, a, out=row)
        row += b * y
        row += c * z
    return out.T


def _shade(
    world: World,
    parts: Sequence[tuple[Thing, Part]],
    hits: _Hits,
    xy: FloatArray,
    T_world_camera: FloatArray,
    pixel_at_1m: float,
) -> tuple[FloatArray, BoolArray]:
    """Return colours (N, 3) in 0..1 and whether light falls on each point (N,)."""
    colours = np.broadcast_to(SKY, (len(xy), 3)).copy()
    facing, glow = np.zeros(len(xy)), np.zeros(len(xy))
    p_camera = np.concatenate([xy, np.ones((len(xy), 1))], axis=1) * np.where(np.isfinite(hits.t), hits.t, 1.0)[:, None]
    p_world = _turned(p_camera, T_world_camera[:3, :3]) + T_world_camera[:3, 3]
    lifted = p_world.copy()
    order = np.argsort(hits.part, kind="stable")
    starts = np.searchsorted(hits.part[order], np.arange(len(parts) + 1))
    for index, (thing, part) in enumerate(parts):
        rows = order[starts[index] : starts[index + 1]]
        if not len(rows):
            continue
        T_world_part = thing.T_world_thing @ part.T_thing_part
        R = T_world_part[:3, :3]
        p_part = _turned(p_world[rows] - T_world_part[:3, 3], R.T)
        normals = part.shape.normals(p_part)
        n_world = _turned(normals, R)
        to_camera = T_world_camera[:3, 3] - p_world[rows]
        towards = row_dots(n_world, to_camera)
        n_world *= np.where(towards < 0, -1.0, 1.0)[:, None]  # the inside of an open cup faces us as well
        slant = np.abs(towards) / np.sqrt(row_dots(to_camera, to_camera))
        footprint_m = hits.t[rows] * pixel_at_1m / np.sqrt(np.clip(slant, 0.1, 1.0))
        colours[rows] = part.texture.colours(p_part, normals, footprint_m)
        facing[rows] = np.clip(row_dots(n_world, world.light.direction_world), 0.0, 1.0)
        glow[rows] = part.glow
        lifted[rows] += 1e-4 * n_world
    lit = facing > 0
    lit[lit] = ~_in_shadow(world, lifted[lit])
    ambient = world.light.ambient
    brightness = np.where(hits.part < 0, 1.0, ambient + (1.0 - ambient) * facing * lit * 1.25)
    return colours * (glow + (1.0 - glow) * brightness)[:, None], lit


def _in_shadow(world: World, p_world: FloatArray) -> BoolArray:
    """Return (N,) whether a thing or a piece of furniture stands between a point and the light.

    Parallel light is a camera without perspective: a part can only shade points inside the rectangle of its own box, seen along it.
    """
    to_light = world.light.direction_world
    across = np.linalg.svd(to_light[None, :])[2][1:]  # two axes at right angles to the light
    shaded = np.zeros(len(p_world), dtype=np.bool_)
    shading = [thing for thing in world if not holds_the_room(thing)]
    corners = [thing.corners_world() @ np.vstack([across, to_light]).T for thing in shading]
    if not shading:
        return shaded
    seen = _turned(p_world, np.vstack([across, to_light])).T
    near = _below_box(seen, np.concatenate(corners))  # most of a wall is far from anything that shades
    seen, p_near = seen[:, near], p_world[near]
    for thing, box in zip(shading, corners, strict=True):
        candidates = _below_box(seen, box)
        candidates = candidates[~shaded[near[candidates]]]
        for part in thing.parts:
            if not len(candidates):
                break
            T_world_part = thing.T_world_thing @ part.T_thing_part
            R = T_world_part[:3, :3]
            local = _turned(p_near[candidates] - T_world_part[:3, 3], R.T)
            hit = np.isfinite(part.shape.intersect(local, np.broadcast_to(to_light @ R, local.shape)))
            shaded[near[candidates[hit]]] = True
            candidates = candidates[~hit]
    return shaded


def _below_box(seen: FloatArray, corners: FloatArray) -> IntArray:
    """Return indices of points ``seen`` (3, N), the last row along the light, that a box of ``corners`` (M, 3) may shade."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    inside = (seen[0] >= low[0]) & (seen[0] <= high[0]) & (seen[1] >= low[1]) & (seen[1] <= high[1]) & (seen[2] <= high[2])
    return np.flatnonzero(inside)


def holds_the_room(thing: Thing) -> bool:
    """Structure larger than 2.5 m across is wall or floor: light comes in through it."""
    low, high = thing.bounds_thing
    return thing.id == STRUCTURE_ID and float((high - low)[:2].max()) > 2.5


def _average_edges(
    world: World,
    parts: Sequence[tuple[Thing, Part]],
    camera: Camera,
    T_world_camera: FloatArray,
    hits: _Hits,
    lit: BoolArray,
    colours: FloatArray,
) -> None:
    """Replace, in place, the colours of pixels beside another part or a shadow by the mean over four rays."""
    key = (2 * hits.part + lit).reshape(camera.height, camera.width)
    edge = np.zeros(key.shape, dtype=np.bool_)
    for axis in (0, 1):
        differs = np.diff(key, axis=axis) != 0
        if axis == 0:
            edge[:-1] |= differs
            edge[1:] |= differs
        else:
            edge[:, :-1] |= differs
            edge[:, 1:] |= differs
    v, u = np.nonzero(edge)
    if not len(u):
        return
    uv = np.stack([u, v], axis=-1)[:, None, :] + SUBPIXELS
    xy = camera.undistort(uv.reshape(-1, 2))
    shaded, _ = _shade(world, parts, _cast(world, xy, T_world_camera), xy, T_world_camera, 1.0 / camera.fx)
    total = colours[edge.ravel()] + shaded.reshape(len(u), len(SUBPIXELS), 3).sum(axis=1)
    colours[edge.ravel()] = total / (1.0 + len(SUBPIXELS))
