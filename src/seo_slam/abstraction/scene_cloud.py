"""The scene cloud: what was seen at large, for the layout of the floor (DualMap III-A4)."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.abstraction.layout import layout_of
from seo_slam.abstraction.seen_over import View
from seo_slam.abstraction.voxels import KnownVoxels, Voxels
from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray, inverse, require_transform, so3_log, transform_points
from seo_slam.settings.planning import LayoutSettings

_LOG = logging.getLogger(__name__)

_WAY_STEP_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """What a frame gave, in its own camera's frame, so that it moves with its pose.

    Attributes:
        key: by which a new pose may come.
        T_world_camera: the pose it came with.
        p_camera: (N, 3) float32, averaged in cubes.
        counts: (N,) pixels behind each.
        way_camera: where the camera was from then on until the next frame was taken.
    """

    key: int
    T_world_camera: FloatArray
    p_camera: NDArray[np.float32]
    counts: NDArray[np.int32]
    way_camera: list[FloatArray] = field(default_factory=list)


class SceneCloud:
    """Points of frames between which the camera moved or turned much.

    Each is kept in the frame of its camera: a loop closure moves the cloud with the poses given to ``layout``. A frame that shows
    little that is not well known is not kept, so memory is bounded by the space seen, not by the time.
    """

    def __init__(self, settings: LayoutSettings | None = None) -> None:
        """Start with nothing."""
        self.settings = settings or LayoutSettings()
        self._kept: list[_Kept] = []
        self._known = KnownVoxels(self.settings.voxel_m, self.settings.enough_points)
        self._last: FloatArray | None = None
        self._walked: set[tuple[int, int]] = set()

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def nbytes(self) -> int:
        """Memory of all points, bytes."""
        return sum(kept.p_camera.nbytes + kept.counts.nbytes for kept in self._kept)

    def has_moved(self, T_world_camera: FloatArray) -> bool:
        """Return whether a frame of this pose would be looked at: moved or turned enough since the last one that was."""
        return self._last is None or far_apart(self._last, T_world_camera, self.settings)

    def add(self, depth_m: NDArray[np.float32], camera: Camera, T_world_camera: FloatArray, key: int | None = None) -> bool:
        """Take a frame if its pose is far enough from the last one taken and it shows something that is not well known.

        Call it with every frame or keyframe: the camera's way is noted as well, since the floor under it can be walked on.

        Args:
            depth_m: (H, W) metres, 0 = no return.
            camera: of the depth image.
            T_world_camera: (4, 4) its pose.
            key: a name for the pose, for ``layout(poses)``; None: how many frames were kept before.

        Returns:
            Whether its points were kept.

        Raises:
            FrameError: an image of another size than the camera's, or no transform.
        """
        T = checked_pose(depth_m, camera, T_world_camera)
        if not self.has_moved(T):
            self.note_way(T)
            return False
        self._last = T
        p_camera = points_of(depth_m, camera, self.settings)
        p_world = transform_points(T, p_camera)
        if len(p_world) and self._known.share_of_new(p_world) >= self.settings.new_share:
            self._known.add(p_world)
            fine = Voxels.of(p_camera, self.settings.voxel_m / 2.0)
            name = len(self._kept) if key is None else key
            self._kept.append(_Kept(name, T, fine.p_world.astype(np.float32), fine.counts.astype(np.int32)))
            self.note_way(T)
            return True
        self.note_way(T)
        return False

    def voxels(self, poses: Mapping[int, FloatArray] | None = None) -> Voxels:
        """Return the points, world frame, averaged in cubes of ``voxel_m``.

        Args:
            poses: newer poses T_world_camera of frames, by key; a frame without one stays where it was.
        """
        if not self._kept:
            return Voxels(np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
        p_world = np.concatenate([transform_points(_pose(kept, poses), kept.p_camera) for kept in self._kept])
        return Voxels.of(p_world, self.settings.voxel_m, np.concatenate([kept.counts for kept in self._kept]))

    def way_world(self, poses: Mapping[int, FloatArray] | None = None) -> FloatArray:
        """Return (N, 3) places where the camera was, about every 0.1 m."""
        ways = [transform_points(_pose(kept, poses), np.stack(kept.way_camera)) for kept in self._kept if kept.way_camera]
        return np.concatenate([np.zeros((0, 3)), *ways])

    def layout(self, poses: Mapping[int, FloatArray] | None = None, warn: Callable[[str], None] = _LOG.warning) -> Layout:
        """Return the layout of what was seen so far; see ``voxels`` for ``poses``, ``layout_of`` for ``warn``. No rooms yet."""
        at = [(_pose(kept, poses), kept.p_camera) for kept in self._kept]
        views = [View(T[:3, 3], transform_points(T, p_camera)) for T, p_camera in at]
        return layout_of(self.voxels(poses), self.way_world(poses), self.settings, views, warn)

    def note_way(self, T_world_camera: FloatArray) -> None:
        """Remember that the camera was there; ``add`` does so as well. Nothing is remembered before the first frame that is kept."""
        cell = way_cell(T_world_camera)
        if self._kept and cell not in self._walked:
            self._walked.add(cell)
            self._kept[-1].way_camera.append(transform_points(inverse(self._kept[-1].T_world_camera), T_world_camera[:3, 3]))


def checked_pose(depth_m: NDArray[np.float32], camera: Camera, T_world_camera: FloatArray) -> FloatArray:
    """Return the pose (4, 4).

    Raises:
        FrameError: an image of another size than the camera's, or no transform.
    """
    if np.shape(depth_m) != (camera.height, camera.width):
        raise FrameError(f"depth_m: got shape {np.shape(depth_m)}, wanted {(camera.height, camera.width)} as the camera says")
    return require_transform(T_world_camera, "T_world_camera")


def way_cell(T_world_camera: FloatArray) -> tuple[int, int]:
    """Return the cell, of about 0.1 m, of which one place is remembered as the camera's way."""
    x, y = np.floor(T_world_camera[:2, 3] / _WAY_STEP_M)
    return int(x), int(y)


def far_apart(T_world_a: FloatArray, T_world_b: FloatArray, settings: LayoutSettings) -> bool:
    """Return whether two poses are ``move_m`` or ``turn_deg`` apart."""
    step = inverse(T_world_a) @ T_world_b
    turned_rad = float(np.linalg.norm(so3_log(step[:3, :3])))
    return bool(np.linalg.norm(step[:3, 3]) >= settings.move_m or turned_rad >= np.radians(settings.turn_deg))


def points_of(depth_m: NDArray[np.float32], camera: Camera, settings: LayoutSettings) -> FloatArray:
    """Return (N, 3) points, camera frame, of every n-th pixel with depth that is not too far, n by ``frame_points``."""
    rows, columns = np.nonzero(np.isfinite(depth_m) & (depth_m > 0))
    nth = max(round(len(rows) / settings.frame_points), 1)
    rows, columns = rows[::nth], columns[::nth]
    z = depth_m[rows, columns].astype(np.float64)
    near = z <= settings.farthest_m
    rows, columns, z = rows[near], columns[near], z[near]
    return np.concatenate([camera.rays()[rows, columns] * z[:, None], z[:, None]], axis=1)


def _pose(kept: _Kept, poses: Mapping[int, FloatArray] | None) -> FloatArray:
    return kept.T_world_camera if poses is None else np.asarray(poses.get(kept.key, kept.T_world_camera), dtype=np.float64)
