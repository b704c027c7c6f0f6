"""The Embree renderer and caster: meshes and primitives alike, as triangles. Needs the extra ``sim``."""

from collections.abc import Iterator, Mapping
from functools import cached_property

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse
from seo_slam.simulation.casting import RayHits
from seo_slam.simulation.embree_scene import Floats32, own_scene
from seo_slam.simulation.embree_shading import compiled
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.world import Thing, World, box_corners
from seo_slam.types import IntArray


class EmbreeRenderer:
    """Draws worlds of primitives and meshes."""

    name = "embree"

    def __init__(self, shadows: bool = True) -> None:
        """Choose.

        Args:
            shadows: whether things throw shadows; about a third of the time.
        """
        self.shadows = shadows

    def __call__(self, world: World, camera: Camera, T_world_camera: FloatArray, smooth_edges: bool = True) -> Rendered:
        """See ``Renderer``."""
        scene = compiled(world)
        size = (camera.height, camera.width)
        xy = camera.rays().reshape(-1, 2)
        view = scene.look(xy, T_world_camera, 1.0 / camera.fx, self.shadows)
        depth_m = np.where(np.isfinite(view.hits.t), view.hits.t, np.float32(0.0)).reshape(size)
        ids = scene.ids[view.hits.geometry].reshape(size)
        rgb = np.clip(view.colours * np.float32(255.0) + np.float32(0.5), 0.0, 255.0).astype(np.uint8).reshape(*size, 3)
        return Rendered(rgb, depth_m, ids, CoveredPixels(world, camera, T_world_camera, depth_m, ids))


class CoveredPixels(Mapping[int, int]):
    """Thing id -> pixels it would cover if nothing stood before it; cast when first asked for.

    Only pixels that show something nearer than the far side of the thing's box need a ray; where it is seen, it is counted.
    """

    def __init__(self, world: World, camera: Camera, T_world_camera: FloatArray, depth_m: Floats32, ids: np.ndarray) -> None:
        """Keep what was drawn."""
        self._world, self._camera = world, camera
        self._T_camera_world = inverse(T_world_camera)
        self._depth_m, self._ids = depth_m, ids

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
        xy = self._camera.rays()[rows, columns][hidden]
        R = T_camera_thing[:3, :3]
        directions = np.empty((len(xy), 3), dtype=np.float32)
        for axis in range(3):
            directions[:, axis] = xy[:, 0] * R[0, axis] + xy[:, 1] * R[1, axis] + R[2, axis]
        start = -(T_camera_thing[:3, 3] @ R)
        return int(seen.sum() + own_scene(thing.parts).blocked(np.tile(start.astype(np.float32), (len(xy), 1)), directions).sum())

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
            origins, turned = (p_world - p) @ R, directions @ R
            rows = _rays_through_box(origins, turned, *thing.bounds_thing)
            hits = own_scene(thing.parts).cast(origins[rows].astype(np.float32), turned[rows].astype(np.float32))
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
