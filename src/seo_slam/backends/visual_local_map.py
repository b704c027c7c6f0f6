"""Keyframes and map points that visual odometry measures against."""

from dataclasses import dataclass, field

import numpy as np

from seo_slam import geometry
from seo_slam.backends.visual_features import SCALE_FACTOR, DescriptorArray, Features
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

_MIN_FOUND_SHARE = 0.25
_VISIBLE_BEFORE_CULL = 10
_TURN_OF_ONE_DEPTH_RAD = 1.0


@dataclass(slots=True, eq=False)
class Keyframe:
    """A frame that the map remembers.

    Attributes:
        T_world_camera: (4, 4).
        features: its N features that belong to a map point.
        points: (N,) row of the map point of each.
        camera: intrinsics.
    """

    T_world_camera: FloatArray
    features: Features
    points: IntArray
    camera: Camera


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """P map points that the camera may see, each with the descriptor seen from the nearest of the chosen keyframes.

    Attributes:
        points: (P,) rows of the map.
        p_world: (P, 3).
        descriptors: (P, 4) uint64.
        octaves: (P,) level that each was seen on.
        distance_m: (P,) from the camera that saw it.
    """

    points: IntArray
    p_world: FloatArray
    descriptors: DescriptorArray
    octaves: IntArray
    distance_m: FloatArray

    def predict(self, T_world_camera: FloatArray, camera: Camera, margin_px: float) -> tuple[IntArray, FloatArray, FloatArray]:
        """Rows of the candidates that fall into the image, their undistorted pixels (K, 2) and pyramid levels (K,)."""
        p = geometry.transform_points(geometry.inverse(T_world_camera), self.p_world)
        z = np.maximum(p[:, 2], 1e-3)
        u, v = camera.fx * p[:, 0] / z + camera.cx, camera.fy * p[:, 1] / z + camera.cy
        inside = (p[:, 2] > 0.1) & (np.abs(u - camera.width / 2) < camera.width / 2 + margin_px)
        rows = np.flatnonzero(inside & (np.abs(v - camera.height / 2) < camera.height / 2 + margin_px))
        nearer = self.distance_m[rows] / np.linalg.norm(p[rows], axis=1)
        octaves = self.octaves[rows] + np.log(nearer) / np.log(SCALE_FACTOR)
        return rows, np.stack([u[rows], v[rows]], axis=1), octaves


@dataclass(slots=True, eq=False)
class LocalMap:
    """Map points (struct of arrays, one row each) and the keyframes that saw them, bounded in size.

    A point is the mean of its keyframes' measurements, weighted by the inverse variance of their depths. (A windowed bundle
    adjustment in its place was measured on a real recording and drifted more: what keyframes disagree on is mostly the time
    between colour and depth, which the adjustment takes for geometry.)

    Attributes:
        max_keyframes: the farthest keyframe is forgotten when there are more.
        keyframes: oldest first.
        p_world: (M, 3).
        weight: (M,) one over the variance of a point's depth, in 1/m^2.
        alive: (M,) False for points that are hardly ever found where they should be.
        visible, found: (M,) frames that should have seen a point, and that did.
    """

    max_keyframes: int
    keyframes: list[Keyframe] = field(default_factory=list)
    p_world: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    weight: FloatArray = field(default_factory=lambda: np.zeros(0))
    alive: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    visible: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    found: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def add_keyframe(self, T_world_camera: FloatArray, camera: Camera, features: Features, points: IntArray) -> Keyframe:
        """Remember a frame.

        Args:
            T_world_camera: its pose.
            camera: its intrinsics.
            features: all its F features.
            points: (F,) map point of each, -1 where it matched none; those with depth become new points.
        """
        points = points.copy()
        lifted = np.flatnonzero(features.has_depth)
        p_world = geometry.transform_points(T_world_camera, lift(features.take(lifted), camera))
        weight = (features.depth_weight * features.inverse_depth**2)[lifted] ** 2  # one over the variance of depth
        known = points[lifted] >= 0
        self._average(points[lifted[known]], p_world[known], weight[known])
        points[lifted[~known]] = len(self.p_world) + np.arange(int((~known).sum()))
        self._append(p_world[~known], weight[~known])
        used = np.flatnonzero(points >= 0)
        keyframe = Keyframe(T_world_camera, features.take(used), points[used], camera)
        self.keyframes.append(keyframe)
        if len(self.keyframes) > self.max_keyframes:
            self._forget_farthest(T_world_camera)
        return keyframe

    def candidates(self, keyframes: list[Keyframe]) -> Candidates:
        """The living points of these keyframes; of a point seen by several, the descriptor of the first keyframe."""
        if not keyframes:
            empty = np.zeros(0, dtype=np.int64)
            return Candidates(empty, np.zeros((0, 3)), np.zeros((0, 4), dtype=np.uint64), empty, np.zeros(0))
        all_points = np.concatenate([k.points for k in keyframes])
        points, first = np.unique(all_points, return_index=True)
        alive = self.alive[points]
        points, first = points[alive], first[alive]
        owner = np.repeat(np.arange(len(keyframes)), [len(k.points) for k in keyframes])[first]
        centres = np.stack([k.T_world_camera[:3, 3] for k in keyframes])
        p_world = self.p_world[points]
        return Candidates(
            points=points,
            p_world=p_world,
            descriptors=np.concatenate([k.features.descriptors for k in keyframes])[first],
            octaves=np.concatenate([k.features.octaves for k in keyframes])[first],
            distance_m=np.linalg.norm(p_world - centres[owner], axis=1),
        )

    def nearest(self, T_world_camera: FloatArray, depth_m: float, count: int) -> list[Keyframe]:
        """The keyframes that look at a scene ``depth_m`` away most alike, nearest first."""
        scores = [_view_distance(k.T_world_camera, T_world_camera, depth_m) for k in self.keyframes]
        return [self.keyframes[i] for i in np.argsort(scores, kind="stable")[:count]]

    def covisible(self, points: IntArray, count: int) -> list[Keyframe]:
        """The keyframes that share most points with ``points``, best first; only those that share any."""
        wanted = np.zeros(len(self.p_world), dtype=np.bool_)
        wanted[points] = True
        shared = np.array([np.count_nonzero(wanted[k.points]) for k in self.keyframes], dtype=np.int64)
        order = np.argsort(-shared, kind="stable")[:count]
        return [self.keyframes[i] for i in order if shared[i] > 0]

    def count_sightings(self, visible: IntArray, found: IntArray) -> None:
        """Note which points should have been seen and which were; drop those that are hardly ever found."""
        self.visible[visible] += 1
        self.found[found] += 1
        doubtful = visible[self.visible[visible] >= _VISIBLE_BEFORE_CULL]
        self.alive[doubtful[self.found[doubtful] < _MIN_FOUND_SHARE * self.visible[doubtful]]] = False

    def compact(self) -> None:
        """Take dead points, and those that no keyframe sees, out of the arrays; the rows in all keyframes change."""
        seen = np.zeros(len(self.p_world), dtype=np.bool_)
        for keyframe in self.keyframes:
            seen[keyframe.points] = True
        kept = self.alive & seen
        new_rows = np.where(kept, np.cumsum(kept) - 1, -1)
        for keyframe in self.keyframes:
            rows = np.flatnonzero(kept[keyframe.points])
            keyframe.features, keyframe.points = keyframe.features.take(rows), new_rows[keyframe.points[rows]]
        self.p_world, self.weight, self.alive = self.p_world[kept], self.weight[kept], self.alive[kept]
        self.visible, self.found = self.visible[kept], self.found[kept]

    def _average(self, points: IntArray, p_world: FloatArray, weight: FloatArray) -> None:
        total = self.weight[points] + weight
        self.p_world[points] += (weight / total)[:, None] * (p_world - self.p_world[points])
        self.weight[points] = total

    def _append(self, p_world: FloatArray, weight: FloatArray) -> None:
        n = len(p_world)
        self.p_world = np.concatenate([self.p_world, p_world])
        self.weight = np.concatenate([self.weight, weight])
        self.alive = np.concatenate([self.alive, np.ones(n, dtype=np.bool_)])
        self.visible = np.concatenate([self.visible, np.ones(n, dtype=np.int64)])
        self.found = np.concatenate([self.found, np.ones(n, dtype=np.int64)])

    def _forget_farthest(self, T_world_camera: FloatArray) -> None:
        scores = [_view_distance(k.T_world_camera, T_world_camera, 2.0) for k in self.keyframes]
        del self.keyframes[int(np.argmax(scores))]


def lift(features: Features, camera: Camera) -> FloatArray:
    """Points (N, 3), camera frame, of features that have a depth."""
    z = 1.0 / features.inverse_depth
    x = (features.uv_px[:, 0] - camera.cx) / camera.fx * z
    y = (features.uv_px[:, 1] - camera.cy) / camera.fy * z
    return np.stack([x, y, z], axis=1)


def turn_and_shift(T_a_b: FloatArray) -> tuple[float, float]:
    """Angle (rad) and length (m) of a motion."""
    return float(np.linalg.norm(geometry.so3_log(T_a_b[:3, :3]))), float(np.linalg.norm(T_a_b[:3, 3]))


def _view_distance(T_world_a: FloatArray, T_world_b: FloatArray, depth_m: float) -> float:
    cosine = 0.5 * (float((T_world_a[:3, :3] * T_world_b[:3, :3]).sum()) - 1.0)
    turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return turn / _TURN_OF_ONE_DEPTH_RAD + float(np.linalg.norm(T_world_a[:3, 3] - T_world_b[:3, 3])) / depth_m
