"""A mapper that is told what it sees: what navigation can do at best, and what a map from noisy detections is held against."""

import numpy as np

from seo_slam.driving.robot import Filmed
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.interfaces import Embedder, Odometry
from seo_slam.map import Map
from seo_slam.perception.voxels import cell_order, voxel_cells, voxel_means
from seo_slam.records import FeatureRecipe, StepResult
from seo_slam.simulation.detector import View
from seo_slam.simulation.world import STRUCTURE_ID
from seo_slam.types import Frame, IntArray, Landmark

_ONE_KEYFRAME_M2 = 1e-4 * np.eye(3)  # nobody asks how sure the truth is


class TrueMapper:
    """Maps the pixels of every true thing, with its word; as a pipeline does, with ``step`` and ``snapshot``.

    It makes no mistake of detection, association or words, and sees no more than the camera does: things are known by what was in view.
    Every frame is a keyframe.
    """

    def __init__(
        self,
        filmed: Filmed,
        odometry: Odometry,
        embedder: Embedder,
        voxel_m: float = 0.03,
        farthest_m: float = 5.0,
        least_px: int = 12,
        stable_after: int = 2,
    ) -> None:
        """Watch what is filmed from now on.

        Args:
            filmed: a tour or a robot.
            odometry: where the camera is.
            embedder: of the words.
            voxel_m: one point, the mean, a cube of this side.
            farthest_m: pixels with more depth are not mapped.
            least_px: pixels of a thing that count as seeing it.
            stable_after: frames that must have seen it.
        """
        filmed.show_to(self)
        self._odometry, self._embedder = odometry, embedder
        self._voxel_m, self._farthest_m, self._least_px, self._stable_after = voxel_m, farthest_m, least_px, stable_after
        self._view: tuple[float, View] | None = None
        self._labels: dict[int, str] = {}
        self._seen: dict[int, list[float]] = {}
        self._p_world = np.zeros((0, 3))
        self._owners = np.zeros(0, dtype=np.int64)
        self._vectors: dict[str, FloatArray] = {}
        self._keyframes = 0

    def show(self, timestamp_s: float, view: View) -> None:
        """Take what is in the frame of this stamp."""
        self._view = (timestamp_s, view)

    def step(self, frame: Frame) -> StepResult:
        """Map the frame that was drawn last."""
        motion = self._odometry.update(frame)
        T_world_camera = np.eye(4) if motion.T_world_camera is None else motion.T_world_camera
        if self._view is not None and self._view[0] == frame.timestamp_s:
            self._add(self._view[1], frame, T_world_camera)
        self._keyframes += 1
        return StepResult(frame.index, frame.timestamp_s, T_world_camera, motion.status, self._keyframes - 1)

    def snapshot(self) -> Map:
        """Return everything seen so far; ids are those of the things."""
        rows = (self._landmark(thing_id) for thing_id in self._seen)
        return Map(rows, "poses", self._embedder.name, features=FeatureRecipe(0.0, 1.0))

    def close(self) -> None:
        """Nothing is to be released."""

    def _add(self, view: View, frame: Frame, T_world_camera: FloatArray) -> None:
        drawn = view.rendered
        v, u = np.nonzero((drawn.instance_ids != STRUCTURE_ID) & (drawn.depth_m > 0) & (drawn.depth_m < self._farthest_m))
        ids, counts = np.unique(drawn.instance_ids[v, u], return_counts=True)
        seen = ids[counts >= self._least_px]
        for thing_id in (int(i) for i in seen):
            self._labels[thing_id] = view.world.thing(thing_id).label
            self._seen.setdefault(thing_id, []).append(frame.timestamp_s)
        kept = np.isin(drawn.instance_ids[v, u], seen)
        v, u = v[kept], u[kept]
        p_camera = view.camera.back_project(np.stack([u, v], axis=-1).astype(np.float64), drawn.depth_m[v, u].astype(np.float64))
        p_world = np.concatenate([self._p_world, transform_points(T_world_camera, p_camera)])
        owners: IntArray = np.concatenate([self._owners, drawn.instance_ids[v, u].astype(np.int64)])
        order, starts = cell_order(voxel_cells(p_world, self._voxel_m), owners)
        self._p_world, self._owners = voxel_means(p_world, order, starts), owners[order][starts]

    def _landmark(self, thing_id: int) -> Landmark:
        cloud_world = self._p_world[self._owners == thing_id]
        low, high = cloud_world.min(axis=0), cloud_world.max(axis=0)
        label, stamps_s = self._labels[thing_id], self._seen[thing_id]
        if label not in self._vectors:
            self._vectors[label] = self._embedder.embed_text([label])[0]
        return Landmark(
            id=thing_id,
            label=label,
            labels={label: 1.0},
            position_m=(low + high) / 2.0,
            covariance_m2=_ONE_KEYFRAME_M2,
            size_m=high - low,
            embedding=self._vectors[label],
            observations=len(stamps_s),
            first_seen_s=stamps_s[0],
            last_seen_s=stamps_s[-1],
            state="stable" if len(stamps_s) >= self._stable_after else "tentative",
            cloud_world=cloud_world,
        )
