"""The Embree renderer and caster: meshes and primitives alike, as triangles. Needs the extra ``sim``."""

from collections.abc import Iterator, Mapping
from functools import cached_property, lru_cache

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse
from seo_slam.simulation.casting import RayHits
from seo_slam.simulation.embree_scene import Floats32, Ints32, own_scene, turned
from seo_slam.simulation.embree_world import CompiledWorld, Eye, View, compiled
from seo_slam.simulation.renderer import SUBPIXELS, Rendered
from seo_slam.simulation.world import Thing, World, box_corners
from seo_slam.types import IntArray


class EmbreeRenderer:
    """Draws worlds of primitives and meshes.

    Attributes:
        shadows: whether things throw shadows: a fifth of the time.
    """

    name = "embree"

    def __init__(self, shadows: bool = True) -> None:
        """Choose whether things throw shadows."""
        self.shadows = shadows

    def __call__(self, world: World, camera: Camera, T_world_camera: FloatArray, smooth_edges: bool = True) -> Rendered:
        """See ``Renderer``. Edges are smoothed between parts; not at shadows nor inside one mesh."""
        scene, eye = compiled(world), Eye(T_world_camera, 1.0 / camera.fx)
        size = (camera.height, camera.width)
        x, y = _slopes(camera)
        view = scene.look(x, y, eye, self.shadows)
        if smooth_edges:
            self._average_edges(scene, eye, camera, view)
        colours = np.clip(view.colours + np.float32(0.5), 0.0, 255.0)
        rgb = np.empty((*size, 3), dtype=np.uint8)
        for channel in range(3):
            rgb[..., channel] = colours[channel].reshape(size)
        depth_m = np.where(view.part >= 0, view.t, np.float32(0.0)).reshape(size)
        ids = scene.ids[view.part].reshape(size)
        return Rendered(rgb, depth_m, ids, CoveredPixels(world, camera, T_world_camera, depth_m, ids))

    def _average_edges(self, scene: CompiledWorld, eye: Eye, camera: Camera, view: View) -> None:
        """Replace, in place, the colours of pixels beside another part by the mean over four rays."""
        key = view.part.reshape(camera.height, camera.width)
        edge = np.zeros(key.shape, dtype=np.bool_)
        beside, below = key[:, 1:] != key[:, :-1], key[1:] != key[:-1]
        for part, differs in ((edge[:, 1:], beside), (edge[:, :-1], beside), (edge[1:], below), (edge[:-1], below)):
            part |= differs
        v, u = np.nonzero(edge)
        if not len(u):
            return
        uv = (np.stack([u, v], axis=-1)[None, :, :] + SUBPIXELS[:, None, :]).reshape(-1, 2)
        x, y = np.ascontiguousarray(camera.undistort(uv).T, dtype=np.float32)
        more = scene.look(x, y, eye, self.shadows).colours.reshape(3, len(SUBPIXELS), len(u)).sum(axis=1)
        here = v * camera.width + u
        view.colours[:, here] = (view.colours[:, here] + more) / np.float32(1 + len(SUBPIXELS))


@lru_cache(maxsize=8)
def _slopes(camera: Camera) -> tuple[Floats32, Floats32]:
    """The slopes x/z and y/z of all pixels, row by row, (N,) each."""
    rays = camera.rays().reshape(-1, 2).astype(np.float32)
    return np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])


class CoveredPixels(Mapping[int, int]):
    """Thing id -> pixels it would cover if nothing stood before it; cast when first asked for.

    Only pixels that show something nearer than the far side of the thing's box need a ray; where it is seen, it is counted.
    """

    def __init__(self, world: World, camera: Camera, T_world_camera: FloatArray, depth_m: Floats32, ids: Ints32) -> None:
        """Keep what was drawn."""
        self._world, self._camera = world, camera
        self._T_camera_world = inverse(T_world_camera)
        self._depth_m, self._ids = depth_m.copy(), ids.copy()  # who draws noise into the picture must not change the truth

    def __getitem__(self, thing_id: int) -> int:
        return self._counts[thing_id]

    def __iter__(self) -> Iterator[int]:
        return iter(self._counts)

    def __len__(self) -> int:
        return len(self._counts)

    @cached_property
    def _counts(self) -> dict[int, int]:
        counts = {thing.id: self._count(thing) for thing in self._world.things}
        return {thing_id: count for thing_id, count in counts.items() if count}

    def _count(self, thing: Thing) -> int:
        T_camera_thing = self._T_camera_world @ thing.T_world_thing
        low, high = thing.bounds_thing
        corners = box_corners(low, high) @ T_camera_thing[:3, :3].T + T_camera_thing[:3, 3]
        rows, columns = self._window(corners)
        ids = self._ids[rows, columns]
        seen = ids == thing.id
        depth_m = self._depth_m[rows, columns]
        hidden = ~seen & (depth_m > 0) & (depth_m < corners[:, 2].max())
        if not hidden.any():
            return int(seen.sum())
        xy = self._camera.rays()[rows, columns][hidden]
        R = T_camera_thing[:3, :3]
        directions = np.empty((len(xy), 3), dtype=np.float32)
        for axis in range(3):
            directions[:, axis] = xy[:, 0] * R[0, axis] + xy[:, 1] * R[1, axis] + R[2, axis]
        starts = np.empty_like(directions)
        starts[:] = -(T_camera_thing[:3, 3] @ R)
        return int(seen.sum() + own_scene(thing.parts).blocked(starts, directions).sum())

    def _window(self, corners: FloatArray) -> tuple[slice, slice]:
        """Return rows and columns of the rectangle around corners (8, 3), camera frame."""
        height, width = self._depth_m.shape
        z = corners[:, 2]
        if z.max() <= 0:
            return slice(0, 0), slice(0, 0)
        if z.min() <= 1e-3 or any(self._camera.distortion):
            return slice(0, height), slice(0, width)
        uv = self._camera.project(corners)
        (u0, v0), (u1, v1) = np.floor(uv.min(axis=0)), np.ceil(uv.max(axis=0)) + 1
        u0, u1 = np.clip((u0, u1), 0, width)
        v0, v1 = np.clip((v0, v1), 0, height)
        return slice(int(v0), int(v1)), slice(int(u0), int(u1))


class EmbreeCaster:
    """Casts rays at a world of primitives and meshes; both sides of a triangle count.

    Every thing is a tree of its own that is shared by all worlds, so that a world with one thing moved costs nothing.
    """

    def __init__(self, world: World) -> None:
        """Take the world."""
        self._things: list[tuple[Thing, int]] = []
        first = 0
        for thing in world:
            self._things.append((thing, first))
            first += len(thing.parts)

    def cast(self, p_world: FloatArray, directions: FloatArray) -> RayHits:
        """See ``Caster``."""
        best = RayHits(np.full(len(p_world), np.inf), np.full(len(p_world), -1, dtype=np.int64))
        for thing, first in self._things:
            R, p = thing.T_world_thing[:3, :3], thing.T_world_thing[:3, 3]
            origins, along = turned(p_world - p, R.T), turned(directions, R.T)
            rows = _rays_through_box(origins, along, *thing.bounds_thing)
            hits = own_scene(thing.parts).cast(origins[rows].astype(np.float32), along[rows].astype(np.float32))
            nearer = hits.t < best.t[rows]
            best.t[rows[nearer]] = hits.t[nearer]
            best.part[rows[nearer]] = hits.geometry[nearer] + first
        return best


def _rays_through_box(origins: FloatArray, directions: FloatArray, low: FloatArray, high: FloatArray) -> IntArray:
    """Return indices of the rays that pass a box, a millimetre larger than it is."""
    enter, leave = np.zeros(len(origins)), np.full(len(origins), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):
            a = (low[axis] - 1e-3 - origins[:, axis]) / directions[:, axis]
            b = (high[axis] + 1e-3 - origins[:, axis]) / directions[:, axis]
            enter, leave = np.fmax(enter, np.fmin(a, b)), np.fmin(leave, np.fmax(a, b))
    return np.flatnonzero(enter <= leave)
