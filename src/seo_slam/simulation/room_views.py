"""How well the things of a room are seen along a path: a small instance image for each of some poses, without light or colour."""

from collections.abc import Callable, Sequence

import numpy as np

from seo_slam.geometry import FloatArray, inverse
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.rendering import require_embree
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.world import STRUCTURE_ID, Part, Thing, World, box_corners
from seo_slam.types import IntArray

GOOD_SHARE = 0.2
"""A thing must be well seen in this share of the sampled views before and after the change: more than the promised 0.15 of the frames."""

_SIZE_PX = (160, 120)
_PIXELS = 3.0  # times the fewest that the detector needs
_UNHIDDEN = 0.5
_HIDES_NOTHING = ("room", "floor")

OwnRays = Callable[[tuple[Part, ...], FloatArray, FloatArray], FloatArray]
"""Casts rays from a point (3,) along directions (N, 3) at parts, all in their thing's frame: lengths (N,), infinity where they miss."""


class RoomViews:
    """The sampled poses of a path. What each thing covers in each of them is kept, so that a room with one thing moved costs little."""

    def __init__(self, halves: Sequence[FloatArray], meshes: bool) -> None:
        """Take the poses (N, 4, 4), ``T_world_camera``, of each part of a path.

        Whether there are meshes decides how rays are cast, not what is installed: so that a layout does not depend on that.

        Raises:
            MissingBackendError: meshes, and the extra ``sim`` is not installed.
        """
        camera = simulated_camera(*_SIZE_PX)
        slopes = camera.rays()  # (H, W, 2); without distortion, rows and columns are straight
        self._columns, self._rows = slopes[0, :, 0], slopes[:, 0, 1]
        self._directions = np.concatenate([slopes, np.ones((*slopes.shape[:2], 1))], axis=2).reshape(-1, 3)
        self._enough_px = _PIXELS * DetectorKnobs().smallest_px * camera.width * camera.height / (640 * 480)
        self._halves = [[inverse(pose) for pose in poses] for poses in halves]
        self._own_rays = _embree_rays() if meshes else _exact_rays
        self._covered: dict[tuple[int, int, int], tuple[Thing, IntArray, FloatArray]] = {}

    def well_seen(self, world: World, half: int) -> dict[int, float]:
        """Return thing id -> share of the poses of a half that see it well: large enough, and at least half of it unhidden."""
        good = dict.fromkeys((thing.id for thing in world.things), 0)
        for k, T_camera_world in enumerate(self._halves[half]):
            nearest = np.full(len(self._directions), np.inf)
            ids = np.full(len(self._directions), STRUCTURE_ID, dtype=np.int64)
            covered = {}
            for thing in world:
                if thing.label in _HIDES_NOTHING and thing.id == STRUCTURE_ID:
                    continue
                rays, t = self._seen_alone(thing, half, k, T_camera_world)
                covered[thing.id] = len(rays)
                nearer = t < nearest[rays]
                nearest[rays[nearer]], ids[rays[nearer]] = t[nearer], thing.id
            counts = np.bincount(ids, minlength=max(good, default=0) + 1)
            for thing_id in good:
                good[thing_id] += int(counts[thing_id] >= max(self._enough_px, _UNHIDDEN * covered[thing_id]))
        return {thing_id: count / len(self._halves[half]) for thing_id, count in good.items()}

    def _seen_alone(self, thing: Thing, half: int, k: int, T_camera_world: FloatArray) -> tuple[IntArray, FloatArray]:
        """Rays that meet a thing if nothing stands before it, and their lengths."""
        key = (id(thing), half, k)  # the thing is kept too, so that its id is not given to another
        if key not in self._covered:
            T_camera_thing = T_camera_world @ thing.T_world_thing
            rays = self._rays_at(thing, T_camera_thing)
            R, p = T_camera_thing[:3, :3], T_camera_thing[:3, 3]
            t = self._own_rays(thing.parts, -p @ R, self._directions[rays] @ R)
            met = np.isfinite(t)
            self._covered[key] = thing, rays[met], t[met]
        return self._covered[key][1:]

    def _rays_at(self, thing: Thing, T_camera_thing: FloatArray) -> IntArray:
        """Indices of the rays through the rectangle around a thing's box."""
        corners = box_corners(*thing.bounds_thing) @ T_camera_thing[:3, :3].T + T_camera_thing[:3, 3]
        if corners[:, 2].max() <= 0:
            return np.zeros(0, dtype=np.int64)
        if corners[:, 2].min() <= 1e-3:
            return np.arange(len(self._directions))
        flat = corners[:, :2] / corners[:, 2:]
        (u0, v0), (u1, v1) = flat.min(axis=0), flat.max(axis=0)
        columns = np.arange(np.searchsorted(self._columns, u0), np.searchsorted(self._columns, u1, side="right"))
        rows = np.arange(np.searchsorted(self._rows, v0), np.searchsorted(self._rows, v1, side="right"))
        return np.asarray((rows[:, None] * len(self._columns) + columns).ravel())


def _exact_rays(parts: tuple[Part, ...], p_thing: FloatArray, directions: FloatArray) -> FloatArray:
    best = np.full(len(directions), np.inf)
    for part in parts:
        R, p = part.T_thing_part[:3, :3], part.T_thing_part[:3, 3]
        best = np.minimum(best, part.shape.intersect((p_thing - p) @ R, directions @ R))
    return best


def _embree_rays() -> OwnRays:
    require_embree("a room of meshes")
    from seo_slam.simulation.embree_scene import own_scene

    def cast(parts: tuple[Part, ...], p_thing: FloatArray, directions: FloatArray) -> FloatArray:
        starts = np.tile(p_thing.astype(np.float32), (len(directions), 1))
        return np.asarray(own_scene(parts).cast(starts, directions.astype(np.float32)).t, dtype=np.float64)

    return cast
