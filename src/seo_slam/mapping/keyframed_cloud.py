"""The cloud of a landmark, kept relative to keyframes: a loop closure moves it (DualMap III-B2, and what it lists as its limitation)."""

from typing import Self

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray
from seo_slam.perception.cloud import Cloud
from seo_slam.perception.voxels import cell_order, voxel_cells, voxel_means
from seo_slam.types import BoolArray, IntArray

MOST_COUNTED = 50
"""A point weighs at most as so many views: what is seen later still counts a fiftieth, so that a cloud follows slow changes."""

STALE_SHARE = 0.25
"""A cloud is given out again as it is until poses may have moved, or averages have moved, one of its points by this share of a voxel."""


class KeyframedCloud:
    """Points of a landmark, one a voxel of the world, each kept in the frame of the keyframe that first saw it.

    Seeing a place again averages the new points into those that are there: memory stays as it is. Depth noise would still fill voxel
    after voxel before and behind a surface seen from afar; so a point in an empty voxel is left out if a point that was there before is
    within the noise. Where a change of the poses brings points into one voxel they are folded into the oldest of them with the next
    ``add``.

    Attributes:
        voxel_m: side of a voxel.
        noise_at_1m_m: that noise, times squared depth; 0: every voxel that holds a point is kept.
        keyframe: (M,) int32, the keyframe that each point moves with: a row of ``poses``.
        p_keyframe: (M, 3) float32, the points in the frames of those, metres.
        count: (M,) int32, in how many views, at most ``MOST_COUNTED``.
    """

    def __init__(self, voxel_m: float, noise_at_1m_m: float = 0.0) -> None:
        """Make an empty cloud."""
        if not voxel_m > 0 or not noise_at_1m_m >= 0:
            raise ValueError(f"cloud: got voxel_m {voxel_m} and noise_at_1m_m {noise_at_1m_m}, wanted above 0, and at least 0")
        self.voxel_m = voxel_m
        self.noise_at_1m_m = noise_at_1m_m
        self.keyframe: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self.p_keyframe: NDArray[np.float32] = np.zeros((0, 3), dtype=np.float32)
        self.count: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self._placed: _Placed | None = None
        self._shown: _Placed | None = None

    def __len__(self) -> int:
        return len(self.keyframe)

    def add(self, keyframe: int, p_camera: FloatArray, poses: FloatArray) -> None:
        """Average points into the voxels that hold some, and append the others.

        Args:
            keyframe: a row of ``poses``: who saw them.
            p_camera: (N, 3) in its frame, metres.
            poses: (T, 4, 4) ``T_world_camera`` of all keyframes as estimated now.

        Raises:
            FrameError: points are not (N, 3) or not finite, or there is no such keyframe.
        """
        if p_camera.ndim != 2 or p_camera.shape[1] != 3 or not np.isfinite(p_camera).all():
            raise FrameError(f"cloud of keyframe {keyframe}: got points {p_camera.shape}, wanted finite (N, 3)")
        if not 0 <= keyframe < len(poses):
            raise FrameError(f"cloud: got keyframe {keyframe}, wanted one of the {len(poses)} that have a pose")
        if not len(p_camera):
            return
        seen = type(self)(self.voxel_m, self.noise_at_1m_m)
        seen.keyframe = np.full(len(p_camera), keyframe, dtype=np.int32)
        seen.p_keyframe = p_camera.astype(np.float32)
        seen.count = np.ones(len(p_camera), dtype=np.int32)
        seen._fold(poses)  # so that a voxel counts once a view, however many points of the view are in it
        seen.count[:] = 1
        self._take(seen.subset(self._tells_something(seen, poses)) if len(self) and self.noise_at_1m_m else seen, poses)

    def merged(self, other: "KeyframedCloud", poses: FloatArray) -> Self:
        """Return the cloud of both; in a voxel of both the one with the older keyframe gives its frame."""
        out = self.copy()
        out._take(other, poses)
        return out

    def subset(self, chosen: BoolArray | IntArray) -> Self:
        """Return the points of a mask (M,) or of rows."""
        out = type(self)(self.voxel_m, self.noise_at_1m_m)
        out.keyframe, out.p_keyframe, out.count = self.keyframe[chosen], self.p_keyframe[chosen], self.count[chosen]
        return out

    def copy(self) -> Self:
        """Return one that changes by itself; arrays are shared until one of the two does."""
        out = type(self)(self.voxel_m, self.noise_at_1m_m)
        out.keyframe, out.p_keyframe, out.count = self.keyframe, self.p_keyframe, self.count
        out._placed, out._shown = self._placed, self._shown
        return out

    def world(self, poses: FloatArray) -> Cloud:
        """Return the cloud in the world, at most one point a voxel.

        The same object, so that its tree need not be built again, until there is a new point, or one has moved by more than
        ``STALE_SHARE`` of a voxel: by the averages, or by the poses since it was computed.
        """
        if self._shown is None or not self._shown.holds(poses, STALE_SHARE * self.voxel_m):
            self._shown = self._placing(poses)
        return self._shown.cloud

    def _tells_something(self, seen: "KeyframedCloud", poses: FloatArray) -> BoolArray:
        """Which points of a view are in voxels that hold some already, or farther from all points than noise would move them."""
        mine, theirs = self._placing(poses), seen._placing(poses)
        order, starts = cell_order(np.concatenate([mine.cells, theirs.cells]))
        alone = order[starts][np.diff(starts, append=len(order)) == 1] - len(self)
        alone = alone[alone >= 0]
        noise_m = self.noise_at_1m_m * seen.p_keyframe[alone, 2].astype(np.float64) ** 2
        nearest_m, _ = self.world(poses).tree.query(theirs.p_world[alone], distance_upper_bound=float(noise_m.max(initial=0.0)))
        out = np.ones(len(seen), dtype=np.bool_)
        out[alone[nearest_m < noise_m]] = False
        return out

    def _placing(self, poses: FloatArray) -> "_Placed":
        if self._placed is None or not self._placed.holds(poses, 0.0):
            self._placed = _Placed(self, _to_world(self.keyframe, self.p_keyframe, poses), None, poses)
        return self._placed

    def _take(self, other: "KeyframedCloud", poses: FloatArray) -> None:
        mine, theirs = self._placing(poses), other._placing(poses)
        self.keyframe = np.concatenate([self.keyframe, other.keyframe])
        self.p_keyframe = np.concatenate([self.p_keyframe, other.p_keyframe])
        self.count = np.concatenate([self.count, other.count])
        p_world, cells = np.concatenate([mine.p_world, theirs.p_world]), np.concatenate([mine.cells, theirs.cells])
        self._fold(poses, p_world, cells)
        if self._shown is not None and not self._shown.resembles(self._placing(poses), STALE_SHARE * self.voxel_m):
            self._shown = None

    def _fold(self, poses: FloatArray, p_world: FloatArray | None = None, cells: IntArray | None = None) -> None:
        """Make one point of those in one voxel, in the frame of the oldest keyframe among them."""
        if p_world is None or cells is None:
            p_world = _to_world(self.keyframe, self.p_keyframe, poses)
            cells = voxel_cells(p_world, self.voxel_m)
        order, starts = cell_order(cells)
        sizes = np.diff(starts, append=len(order))
        keeper, shared = order[starts], sizes > 1
        rows, ends = order[np.repeat(shared, sizes)], np.cumsum(sizes[shared])
        begins = ends - sizes[shared]
        if len(begins):
            group = np.repeat(np.arange(len(begins)), sizes[shared])
            keeper[shared] = rows[np.lexsort((self.keyframe[rows], group))[begins]]
        # A point that is alone in its voxel stays exactly as it is, so that nothing creeps.
        means, counts = np.take(p_world, keeper, axis=0), self.count[keeper]
        keyframe, p_keyframe = self.keyframe[keeper], np.take(self.p_keyframe, keeper, axis=0)
        if len(begins):
            means[shared] = voxel_means(p_world, rows, begins, self.count.astype(np.float64))
            counts[shared] = np.minimum(np.add.reduceat(self.count[rows], begins), MOST_COUNTED)
            p_keyframe[shared] = _to_keyframe(keyframe[shared], means[shared], poses)
        self.keyframe, self.p_keyframe, self.count = keyframe, p_keyframe, counts
        self._placed = _Placed(self, means, np.take(cells, keeper, axis=0), poses)


class _Placed:
    """Where the points of a cloud are in the world by certain poses."""

    def __init__(self, owner: KeyframedCloud, p_world: FloatArray, cells: IntArray | None, poses: FloatArray) -> None:
        """Take the points (M, 3); ``cells``, their voxels, are given where there is one point in each."""
        self.p_world = p_world
        self.cells = voxel_cells(p_world, owner.voxel_m) if cells is None else cells
        if cells is None:
            p_world = voxel_means(p_world, *cell_order(self.cells), owner.count.astype(np.float64))
        self.cloud = Cloud(p_world)
        reach_m = np.full(len(poses), -1.0)
        x, y, z = (owner.p_keyframe[:, axis].astype(np.float64) for axis in range(3))
        np.maximum.at(reach_m, owner.keyframe, np.sqrt(x * x + y * y + z * z))
        self._keyframes = np.flatnonzero(reach_m >= 0.0)
        self._poses = np.array(poses[self._keyframes], dtype=np.float64)
        self._reach_m = reach_m[self._keyframes]

    def holds(self, poses: FloatArray, tolerance_m: float) -> bool:
        """Whether no point has moved by more than the tolerance (bounded from above: by shift, and turn times reach, of its keyframe)."""
        now = poses[self._keyframes]
        if (now == self._poses).all():  # as they mostly are, and this is asked of every cloud at every keyframe
            return True
        change = now - self._poses
        turn = np.sqrt(np.einsum("nij,nij->n", change[:, :3, :3], change[:, :3, :3]))
        shift_m = np.sqrt(np.einsum("ni,ni->n", change[:, :3, 3], change[:, :3, 3]))
        return bool((shift_m + turn * self._reach_m <= tolerance_m).all())

    def resembles(self, other: "_Placed", tolerance_m: float) -> bool:
        """Whether its cloud has the points of the other's, none off by more than the tolerance. Both are in the order of their voxels."""
        if len(self.cloud) != len(other.cloud):
            return False
        offset = self.cloud.p_world - other.cloud.p_world
        return bool((np.einsum("ni,ni->n", offset, offset) <= tolerance_m**2).all())


def _to_world(keyframe: NDArray[np.int32], p_keyframe: NDArray[np.float32], poses: FloatArray) -> FloatArray:
    # einsum, not a matrix product: the last digit must not depend on how many points are asked for at once
    T = poses[keyframe]
    return np.asarray(np.einsum("nij,nj->ni", T[:, :3, :3], p_keyframe.astype(np.float64)) + T[:, :3, 3], dtype=np.float64)


def _to_keyframe(keyframe: NDArray[np.int32], p_world: FloatArray, poses: FloatArray) -> NDArray[np.float32]:
    T = poses[keyframe]
    p_keyframe: FloatArray = np.einsum("nji,nj->ni", T[:, :3, :3], p_world - T[:, :3, 3])
    return p_keyframe.astype(np.float32)
