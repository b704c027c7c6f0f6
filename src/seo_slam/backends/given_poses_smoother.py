"""Landmarks from camera poses that are given and taken as they are: DualMap's assumption. No pose is ever corrected.

A landmark stands at the information-weighted mean of its measurements, each carried to the world by the pose of its keyframe.
"""

import numpy as np

from seo_slam.backends.measurement_checks import require_covariances, require_measurements
from seo_slam.backends.robust_means import COLUMNS, cauchy_weights, robust_means, rows_of, square
from seo_slam.config import SmootherSettings
from seo_slam.errors import OptimizationError, UnknownLandmarkError
from seo_slam.geometry import FloatArray, adjoint, inverse, require_transform, transform_points
from seo_slam.types import BoolArray, Estimate, IntArray, Landmarks, Motion, Observations

_RENEWED_EVERY = 16
"""A landmark's robust weights are found anew when it has a sixteenth more measurements: at each of the first 32, then ever less often.

So a keyframe costs about the same however long a landmark has been seen. In between a new measurement is weighed where the landmark
stands, and those before it keep their weights.
"""


class _Measured:
    """The measurements of one landmark, what a continued map knew of it first."""

    __slots__ = ("_rows", "count", "due", "priors")

    def __init__(self, rows: FloatArray, priors: int) -> None:
        """Hold rows (N, COLUMNS) of ``robust_means``, of which the first ``priors`` are no measurements."""
        self._rows = rows.copy()
        self.count = len(rows)
        self.priors = priors
        self.due = self.count

    @property
    def rows(self) -> FloatArray:
        """(N, COLUMNS), in the order in which they came."""
        return self._rows[: self.count]

    def add(self, row: FloatArray) -> bool:
        """Append one; return whether the weights of all are to be found anew."""
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty((max(4, self.count // 2), COLUMNS))])
        self._rows[self.count] = row
        self.count += 1
        return self.count >= self.due

    def renewed(self) -> None:
        """Say when the weights are to be found anew next."""
        self.due = self.count + max(1, self.count // _RENEWED_EVERY)


class _Poses:
    """(T, 4, 4) poses in an array with room for more: to give out all of them at every keyframe must not cost more and more."""

    __slots__ = ("_rows", "count")

    def __init__(self) -> None:
        """Hold none."""
        self._rows = np.empty((16, 4, 4))
        self.count = 0

    @property
    def all(self) -> FloatArray:
        """A read-only view (T, 4, 4); it stays as it is when more are appended."""
        view = self._rows[: self.count]
        view.flags.writeable = False
        return view

    @property
    def newest(self) -> FloatArray:
        """(4, 4), read-only.

        Raises:
            OptimizationError: there is none.
        """
        if not self.count:
            raise OptimizationError("the smoother has not been started")
        return np.asarray(self.all[-1], dtype=np.float64)

    def append(self, T: FloatArray) -> None:
        """Append one."""
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self.count] = T
        self.count += 1


class GivenPosesSmoother:
    """``interfaces.Smoother`` for poses that are known already: ground truth, a good odometry, another SLAM.

    A keyframe's pose is ``Motion.T_world_camera`` where the odometry gives one (in the frame of the pose it started at), so that no
    rounding adds up; else the last pose composed with the motion. Each pose is as uncertain as the first one was said to be, and as the
    motion says on top where the odometry was lost; that is part of every measurement's covariance. Poses and landmarks are
    taken to be independent, so joint covariances are block-diagonal. The loss is the Cauchy loss of the graph
    (``SmootherSettings.cauchy_k``); how it is solved is told in ``robust_means``.
    """

    def __init__(self, settings: SmootherSettings | None = None) -> None:
        """Make it empty."""
        self._looseness = 1.0 / (settings or SmootherSettings()).cauchy_k ** 2
        self._poses = _Poses()
        self._first_covariance = np.eye(6)
        self._covariance = np.eye(6)  # of the newest pose
        self._measured: dict[int, _Measured] = {}
        self._ids = np.zeros(0, dtype=np.int64)  # rising; the arrays below have a row for each
        self._p_world = np.zeros((0, 3))
        self._information = np.zeros((0, 3, 3))
        self._cov_world = np.zeros((0, 3, 3))

    def start(self, T_world_camera: FloatArray, covariance: FloatArray, landmarks: Landmarks | None = None) -> Estimate:
        """See ``interfaces.Smoother``; landmarks of a continued map count as measurements without a loss."""
        if self._poses.count:
            raise OptimizationError("the smoother has been started already")
        T = require_transform(T_world_camera, "first camera pose")
        require_covariances("covariance of the first camera pose", covariance[None])
        if landmarks is not None and len(landmarks):
            require_covariances("covariance of a landmark to be continued", landmarks.cov_world)
            information = np.asarray(np.linalg.inv(landmarks.cov_world), dtype=np.float64)
            rows = rows_of(landmarks.p_world, information, 0.0)
            for landmark_id, row in zip(landmarks.ids, rows, strict=True):
                self._put(int(landmark_id), _Measured(row[None], priors=1))
            self._renew(landmarks.ids.tolist())
        self._poses.append(T)
        self._first_covariance = self._covariance = np.array(covariance, dtype=np.float64)
        return self._estimate(T, self._covariance)

    def predict(self, motion: Motion) -> Estimate:
        """See ``interfaces.Smoother``."""
        carry = adjoint(inverse(motion.T_previous_current))
        return self._estimate(self._after(motion), carry @ self._covariance @ carry.T + motion.covariance)

    def update(self, motion: Motion | None, observations: Observations, landmark_ids: IntArray, robust: bool = True) -> Estimate:
        """See ``interfaces.Smoother``; also raises FrameError, before anything changes, where a covariance is none."""
        require_covariances("cov_camera", observations.cov_camera)
        if motion is not None:
            require_covariances("covariance of the motion from odometry", motion.covariance[None])
            self._poses.append(self._after(motion))
            self._covariance = self._first_covariance + (motion.covariance if motion.status == "lost" else 0.0)
        T_world_camera = self._poses.newest
        if len(landmark_ids):
            self._measure(self._rows_world(observations, self._looseness if robust else 0.0), landmark_ids)
        return self._estimate(T_world_camera, self._covariance)

    def remove(self, landmark_id: int) -> None:
        """See ``interfaces.Smoother``."""
        self._known(landmark_id)
        self._drop(landmark_id)

    def merge(self, keep_id: int, drop_id: int) -> None:
        """See ``interfaces.Smoother``."""
        if keep_id == drop_id:
            raise UnknownLandmarkError(f"landmark {keep_id} cannot be merged with itself")
        keep, drop = self._known(keep_id), self._known(drop_id)
        parts = [keep.rows[: keep.priors], drop.rows[: drop.priors], keep.rows[keep.priors :], drop.rows[drop.priors :]]
        self._drop(drop_id)
        self._measured[keep_id] = _Measured(np.concatenate(parts), keep.priors + drop.priors)
        self._renew([keep_id])

    def split(self, landmark_id: int, new_id: int, measurements: IntArray) -> None:
        """See ``interfaces.Smoother``. After a merge those of the landmark that stayed come first; a rename keeps their order."""
        old = self._known(landmark_id)
        self._free(new_id, f"landmark {landmark_id} cannot be split into {new_id}")
        chosen = np.array(require_measurements(landmark_id, measurements, old.count - old.priors, old.priors > 0), dtype=np.int64)
        moved = old.rows[old.priors + chosen]
        self._measured[landmark_id] = _Measured(np.delete(old.rows, old.priors + chosen, axis=0), old.priors)
        self._put(new_id, _Measured(moved, priors=0))
        self._renew([landmark_id, new_id])

    def rename(self, old_id: int, new_id: int) -> None:
        """See ``interfaces.Smoother``."""
        measured = self._known(old_id)
        self._free(new_id, f"landmark {old_id} cannot be named {new_id}")
        old = self._slots(np.array([old_id], dtype=np.int64))
        state = self._p_world[old], self._information[old], self._cov_world[old]
        self._drop(old_id)
        self._put(new_id, measured)
        new = self._slots(np.array([new_id], dtype=np.int64))
        self._p_world[new], self._information[new], self._cov_world[new] = state

    def positions(self) -> tuple[IntArray, FloatArray]:
        """See ``interfaces.Smoother``."""
        return self._ids.copy(), self._p_world.copy()

    def covariances(self, landmark_ids: IntArray) -> FloatArray:
        """See ``interfaces.Smoother``."""
        return np.asarray(self._cov_world[self._slots(landmark_ids)], dtype=np.float64)

    def poses(self) -> FloatArray:
        """See ``interfaces.Smoother``; a read-only view, since no pose is ever corrected."""
        return self._poses.all

    def _after(self, motion: Motion) -> FloatArray:
        last = self._poses.newest
        if motion.T_world_camera is not None:
            return motion.T_world_camera.copy()
        return require_transform(last @ motion.T_previous_current, "predicted camera pose")

    def _estimate(self, T_world_camera: FloatArray, pose_covariance: FloatArray) -> Estimate:
        def joint_covariance(landmark_ids: IntArray) -> FloatArray:
            m = len(landmark_ids)
            joint = np.zeros((6 + 3 * m, 6 + 3 * m))
            joint[:6, :6] = pose_covariance
            rows = 6 + np.arange(3 * m).reshape(m, 3)
            joint[rows[:, :, None], rows[:, None, :]] = self.covariances(landmark_ids)
            return joint

        return Estimate(T_world_camera=T_world_camera.copy(), joint_covariance=joint_covariance)

    def _rows_world(self, observations: Observations, looseness: float) -> FloatArray:
        """(K, COLUMNS) rows of what the newest camera measured; its own uncertainty counts, too."""
        T, p_camera = self._poses.newest, observations.p_camera
        J = np.zeros((len(p_camera), 3, 6))  # of the point in the camera frame, by the pose
        for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # [-skew(p), I]
            J[:, a, b], J[:, b, a], J[:, a, 3 + a] = p_camera[:, c], -p_camera[:, c], 1.0
        cov_camera = observations.cov_camera + J @ self._covariance @ J.transpose(0, 2, 1)
        R = T[:3, :3]
        return rows_of(transform_points(T, p_camera), R @ np.linalg.inv(cov_camera) @ R.T, looseness)

    def _measure(self, rows: FloatArray, landmark_ids: IntArray) -> None:
        """Take in rows (K, COLUMNS) of landmarks (K,), known or new."""
        anew = np.ones(len(rows), dtype=np.bool_)
        for k, landmark_id in enumerate(landmark_ids.tolist()):
            if landmark_id in self._measured:
                anew[k] = self._measured[landmark_id].add(rows[k])
            else:
                self._put(landmark_id, _Measured(rows[k : k + 1], priors=0))
        self._weigh_in(rows, landmark_ids, ~anew)
        if anew.any():
            self._renew(landmark_ids[anew].tolist())

    def _weigh_in(self, rows: FloatArray, landmark_ids: IntArray, which: BoolArray) -> None:
        """Add single measurements where the landmarks stand now, whose other weights stay."""
        if not which.any():
            return
        slots, upper = self._slots(landmark_ids[which]), rows[which, 3:9]
        residual = rows[which, :3] - self._p_world[slots]
        added = cauchy_weights(residual, upper, rows[which, 9])[:, None, None] * square(upper)
        np.add.at(self._information, slots, added)  # not +=: several measurements may be of one landmark
        self._cov_world[slots] = np.linalg.inv(self._information[slots])
        np.add.at(self._p_world, slots, (self._cov_world[slots] @ added @ residual[..., None])[..., 0])

    def _renew(self, landmark_ids: list[int]) -> None:
        """Find position and information of landmarks from all their measurements."""
        measured = [self._measured[landmark_id] for landmark_id in landmark_ids]
        p_world, information = robust_means(np.concatenate([m.rows for m in measured]), [m.count for m in measured])
        slots = self._slots(np.array(landmark_ids, dtype=np.int64))
        self._p_world[slots], self._information[slots] = p_world, information
        self._cov_world[slots] = np.linalg.inv(information)
        for m in measured:
            m.renewed()

    def _put(self, landmark_id: int, measured: _Measured) -> None:
        """Make room for a landmark; where it stands is for the caller to say."""
        self._measured[landmark_id] = measured
        slot = int(np.searchsorted(self._ids, landmark_id))
        self._ids = np.insert(self._ids, slot, landmark_id)
        self._p_world = np.insert(self._p_world, slot, 0.0, axis=0)
        self._information = np.insert(self._information, slot, 0.0, axis=0)
        self._cov_world = np.insert(self._cov_world, slot, 0.0, axis=0)

    def _drop(self, landmark_id: int) -> None:
        del self._measured[landmark_id]
        slot = int(np.searchsorted(self._ids, landmark_id))
        self._ids = np.delete(self._ids, slot)
        self._p_world = np.delete(self._p_world, slot, axis=0)
        self._information = np.delete(self._information, slot, axis=0)
        self._cov_world = np.delete(self._cov_world, slot, axis=0)

    def _slots(self, landmark_ids: IntArray) -> IntArray:
        for landmark_id in landmark_ids.tolist():
            self._known(landmark_id)
        return np.searchsorted(self._ids, landmark_ids)

    def _known(self, landmark_id: int) -> _Measured:
        if landmark_id not in self._measured:
            raise UnknownLandmarkError(f"landmark {landmark_id} is not in the map of the smoother")
        return self._measured[landmark_id]

    def _free(self, landmark_id: int, why_wanted: str) -> None:
        if landmark_id in self._measured:
            raise UnknownLandmarkError(f"{why_wanted}: the smoother holds one of that id")
