"""The factor graph over camera poses and landmark positions (SEO-SLAM Eq 1), solved incrementally by GTSAM's ISAM2.

GTSAM has no pose-to-point factor, so a measured point is given as bearing and range, its covariance ``Gamma`` carried over by
``J Gamma J^T`` with ``J = [B^T / r; u^T]`` (u the unit direction, B a basis of the plane across it, r the range).
"""

from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from seo_slam.backends.joint_covariance import JointCovariance
from seo_slam.backends.measurement_checks import require_covariances, require_measurements
from seo_slam.config import SmootherSettings
from seo_slam.errors import OptimizationError, UnknownLandmarkError
from seo_slam.geometry import FloatArray, adjoint, diagonal_blocks, inverse, require_transform, transform_points
from seo_slam.types import BoolArray, Estimate, IntArray, Landmarks, Motion, Observations

_JOINT_AT_ONCE = 40

_CARRIED_LANDMARKS = 100
"""Up to so many landmarks the joint covariance is carried along; its cost grows with their number squared."""

_CARRIED_KEYFRAMES = 10
"""After so many it is recovered anew, since relinearisation and robust weights have moved on."""

_SETTLING = 4
"""Updates after a split at most: what was a blend of two places has bad linearisation points."""


@dataclass(slots=True)
class _Measurement:
    """A measurement, and which factor of the graph it is."""

    keyframe: int
    p_camera: FloatArray
    cov_camera: FloatArray
    robust: bool
    index: int = -1


@dataclass(slots=True)
class _Prior:
    """What a continued map knew, and which factor of the graph it is."""

    p_world: FloatArray
    cov_world: FloatArray
    index: int = -1


@dataclass(slots=True)
class _LandmarkFactors:
    """What is needed to take a landmark out, or to give its measurements to another."""

    measurements: list[_Measurement] = field(default_factory=list)
    priors: list[_Prior] = field(default_factory=list)

    @property
    def indices(self) -> list[int]:
        return [prior.index for prior in self.priors] + [measurement.index for measurement in self.measurements]


class GtsamSmoother:
    """``interfaces.Smoother`` over ISAM2."""

    def __init__(self, settings: SmootherSettings | None = None) -> None:
        """Make an empty graph."""
        self._settings = settings or SmootherSettings()
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(0.01)
        parameters.relinearizeSkip = 1
        parameters.setFactorization("QR")  # Cholesky squares the spread of the information: a straight way of 200 m is enough to fail
        self._isam = gtsam.ISAM2(parameters)
        self._keyframes = 0
        self._landmarks: dict[int, _LandmarkFactors] = {}
        self._new_graph = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()
        self._new_records: list[_Measurement | _Prior | None] = []  # what is to be told the index of each factor in _new_graph
        self._T_last = np.eye(4)
        self._positions: tuple[IntArray, FloatArray] | None = None  # kept until the graph changes
        self._carried: JointCovariance | None = None
        self._carried_keyframes = 0

    def start(self, T_world_camera: FloatArray, covariance: FloatArray, landmarks: Landmarks | None = None) -> Estimate:
        """See ``interfaces.Smoother``."""
        T = require_transform(T_world_camera, "first camera pose")
        require_covariances("covariance of the first camera pose", covariance[None])
        if landmarks is not None:
            require_covariances("covariance of a landmark to be continued", landmarks.cov_world)
        self._add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(T), gtsam.noiseModel.Gaussian.Covariance(covariance)), None)
        self._new_values.insert(X(0), gtsam.Pose3(T))
        for row in range(len(landmarks) if landmarks is not None else 0):
            assert landmarks is not None
            self._add_prior(int(landmarks.ids[row]), _Prior(landmarks.p_world[row], landmarks.cov_world[row]))
        self._keyframes = 1
        self._flush([])
        return self._estimate()

    def predict(self, motion: Motion) -> Estimate:
        """See ``interfaces.Smoother``."""
        T_pl = inverse(motion.T_previous_current)
        carry = adjoint(T_pl)

        def joint_covariance(landmark_ids: IntArray) -> FloatArray:
            joint = self._joint(landmark_ids)
            joint[:6] = carry @ joint[:6]
            joint[:, :6] = joint[:, :6] @ carry.T
            joint[:6, :6] += motion.covariance
            return joint

        return Estimate(
            T_world_camera=self._T_last @ motion.T_previous_current,
            joint_covariance=joint_covariance,
        )

    def update(self, motion: Motion | None, observations: Observations, landmark_ids: IntArray, robust: bool = True) -> Estimate:
        """See ``interfaces.Smoother``; also raises FrameError, before anything changes, where a covariance is none."""
        require_covariances("cov_camera", observations.cov_camera)
        if motion is not None:
            require_covariances("covariance of the motion from odometry", motion.covariance[None])
            previous, current = self._keyframes - 1, self._keyframes
            T = require_transform(self._T_last @ motion.T_previous_current, "predicted camera pose")
            noise = gtsam.noiseModel.Gaussian.Covariance(motion.covariance)
            step = gtsam.Pose3(motion.T_previous_current)
            self._add(gtsam.BetweenFactorPose3(X(previous), X(current), step, noise), None)
            self._new_values.insert(X(current), gtsam.Pose3(T))
            self._keyframes += 1
            self._T_last = T
        new = np.array([int(i) not in self._landmarks for i in landmark_ids], dtype=np.bool_)
        for row, landmark_id in enumerate(landmark_ids):
            measurement = _Measurement(self._keyframes - 1, observations.p_camera[row], observations.cov_camera[row], robust)
            self._measure(int(landmark_id), measurement)
        carried, self._carried = self._carried, None  # lost, should the graph not be solved
        self._flush([])
        if carried is not None and motion is not None and self._carried_keyframes < _CARRIED_KEYFRAMES:
            self._carry(carried, motion, observations, landmark_ids, new, robust)
        return self._estimate()

    def _carry(
        self,
        carried: JointCovariance,
        motion: Motion,
        observations: Observations,
        landmark_ids: IntArray,
        new: BoolArray,
        robust: bool,
    ) -> None:
        """Bring the joint covariance to the keyframe that the graph has just taken in."""
        carried.predict(motion.T_previous_current, motion.covariance)
        ids, p_world = self.positions()
        p_camera = transform_points(inverse(self._T_last), p_world[np.searchsorted(ids, landmark_ids)])
        cov_camera = observations.cov_camera
        if robust:
            residual = observations.p_camera - p_camera
            squared = np.einsum("ki,ki->k", residual, np.linalg.solve(cov_camera, residual[..., None])[..., 0])
            cov_camera = cov_camera * (1.0 + squared / self._settings.cauchy_k**2)[:, None, None]
        carried.measure(landmark_ids[~new], p_camera[~new], cov_camera[~new], self._T_last[:3, :3])
        for row in np.flatnonzero(new):
            carried.add(int(landmark_ids[row]), p_camera[row], cov_camera[row], self._T_last)
        self._carried, self._carried_keyframes = carried, self._carried_keyframes + 1

    def remove(self, landmark_id: int) -> None:
        """See ``interfaces.Smoother``."""
        self._flush(self._take_out(landmark_id).indices)

    def merge(self, keep_id: int, drop_id: int) -> None:
        """See ``interfaces.Smoother``."""
        if keep_id == drop_id:
            raise UnknownLandmarkError(f"landmark {keep_id} cannot be merged with itself")
        self._known(keep_id)
        dropped = self._take_out(drop_id)
        indices = dropped.indices
        self._hand_over(dropped, keep_id)
        self._flush(indices)

    def split(self, landmark_id: int, new_id: int, measurements: IntArray) -> None:
        """See ``interfaces.Smoother``. After a merge those of the landmark that stayed come first; a rename keeps their order."""
        old = self._known(landmark_id)
        self._free(new_id, f"landmark {landmark_id} cannot be split into {new_id}")
        chosen = require_measurements(landmark_id, measurements, len(old.measurements), bool(old.priors))
        moved = _LandmarkFactors([old.measurements[n] for n in chosen])
        indices = moved.indices
        old.measurements = [measurement for n, measurement in enumerate(old.measurements) if n not in chosen]
        self._landmarks[new_id] = _LandmarkFactors()
        self._new_values.insert(L(new_id), self._middle(moved.measurements))
        self._hand_over(moved, new_id)
        self._flush(indices)
        self._settle()

    def rename(self, old_id: int, new_id: int) -> None:
        """See ``interfaces.Smoother``."""
        self._known(old_id)
        self._free(new_id, f"landmark {old_id} cannot be named {new_id}")
        p_world = self._isam.calculateEstimatePoint3(L(old_id))
        old = self._take_out(old_id)
        indices = old.indices
        self._landmarks[new_id] = _LandmarkFactors()
        self._new_values.insert(L(new_id), p_world)
        self._hand_over(old, new_id)
        self._flush(indices)

    def positions(self) -> tuple[IntArray, FloatArray]:
        """See ``interfaces.Smoother``."""
        if self._positions is None:
            ids = np.array(sorted(self._landmarks), dtype=np.int64)
            points = [self._isam.calculateEstimatePoint3(L(int(i))) for i in ids]
            self._positions = ids, np.array(points, dtype=np.float64).reshape(len(ids), 3)
        ids, points_world = self._positions
        return ids.copy(), points_world.copy()

    def covariances(self, landmark_ids: IntArray) -> FloatArray:
        """See ``interfaces.Smoother``."""
        out = np.zeros((len(landmark_ids), 3, 3))
        for start in range(0, len(landmark_ids), _JOINT_AT_ONCE):  # jointly is several times faster than one by one
            part = landmark_ids[start : start + _JOINT_AT_ONCE]
            out[start : start + len(part)] = diagonal_blocks(self._recover(part)[6:, 6:])
        return out

    def poses(self) -> FloatArray:
        """See ``interfaces.Smoother``."""
        rows = gtsam.utilities.extractPose3(self._isam.calculateEstimate())  # R row by row, then t; at once is faster than one by one
        out = np.tile(np.eye(4), (len(rows), 1, 1))
        out[:, :3, :3], out[:, :3, 3] = rows[:, :9].reshape(-1, 3, 3), rows[:, 9:]
        return out

    def _estimate(self) -> Estimate:
        return Estimate(
            T_world_camera=self._T_last.copy(),
            joint_covariance=self._joint,
        )

    def _joint(self, landmark_ids: IntArray) -> FloatArray:
        """The joint covariance of the newest pose and landmarks: carried along while there are few, else recovered."""
        for landmark_id in landmark_ids:
            self._known(int(landmark_id))
        if len(self._landmarks) > _CARRIED_LANDMARKS:
            return self._recover(landmark_ids)
        if self._carried is None:
            everything = np.array(sorted(self._landmarks), dtype=np.int64)
            self._carried, self._carried_keyframes = JointCovariance(everything, self._recover(everything)), 0
        return self._carried.of(landmark_ids)

    def _recover(self, landmark_ids: IntArray) -> FloatArray:
        """Recover the same from ISAM2's tree."""
        keys = [X(self._keyframes - 1), *(L(i) for i in landmark_ids.tolist() if self._known(i))]
        # In query order since GTSAM 4.3; a test holds it to that.
        return np.array(self._isam.jointMarginalCovariance(keys).fullMatrix(), dtype=np.float64)

    def _known(self, landmark_id: int) -> _LandmarkFactors:
        if landmark_id not in self._landmarks:
            raise UnknownLandmarkError(f"landmark {landmark_id} is not in the graph")
        return self._landmarks[landmark_id]

    def _take_out(self, landmark_id: int) -> _LandmarkFactors:
        factors = self._known(landmark_id)
        del self._landmarks[landmark_id]
        return factors

    def _free(self, landmark_id: int, why_wanted: str) -> None:
        if landmark_id in self._landmarks:
            raise UnknownLandmarkError(f"{why_wanted}: the graph holds one of that id")

    def _hand_over(self, factors: _LandmarkFactors, landmark_id: int) -> None:
        """Add factors to a landmark; those they replace are still in the graph."""
        for prior in factors.priors:
            self._add_prior(landmark_id, prior)
        for measurement in factors.measurements:
            self._measure(landmark_id, measurement)

    def _middle(self, measurements: list[_Measurement]) -> FloatArray:
        """Where measurements put a point: the mean in the world frame, by the poses as estimated now."""
        poses = [self._isam.calculateEstimatePose3(X(measurement.keyframe)).matrix() for measurement in measurements]
        points = [transform_points(T, measurement.p_camera) for T, measurement in zip(poses, measurements, strict=True)]
        return np.asarray(np.mean(points, axis=0), dtype=np.float64)

    def _add(self, factor: gtsam.NonlinearFactor, record: _Measurement | _Prior | None) -> None:
        self._new_graph.push_back(factor)
        self._new_records.append(record)

    def _add_prior(self, landmark_id: int, prior: _Prior) -> None:
        if landmark_id not in self._landmarks:
            self._landmarks[landmark_id] = _LandmarkFactors()
            self._new_values.insert(L(landmark_id), prior.p_world)
        self._landmarks[landmark_id].priors.append(prior)
        noise = gtsam.noiseModel.Gaussian.Covariance(prior.cov_world)
        self._add(gtsam.PriorFactorPoint3(L(landmark_id), prior.p_world, noise), prior)

    def _measure(self, landmark_id: int, measurement: _Measurement) -> None:
        p_camera = measurement.p_camera
        if landmark_id not in self._landmarks:
            self._landmarks[landmark_id] = _LandmarkFactors()
            self._new_values.insert(L(landmark_id), transform_points(self._T_last, p_camera))
        self._landmarks[landmark_id].measurements.append(measurement)
        distance = float(np.linalg.norm(p_camera))
        direction = gtsam.Unit3(p_camera)
        J = np.vstack([direction.basis().T / distance, p_camera[None] / distance])
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.Covariance(J @ measurement.cov_camera @ J.T)
        if measurement.robust:
            loss = gtsam.noiseModel.mEstimator.Cauchy.Create(self._settings.cauchy_k)
            noise = gtsam.noiseModel.Robust.Create(loss, noise)
        self._add(gtsam.BearingRangeFactor3D(X(measurement.keyframe), L(landmark_id), direction, distance, noise), measurement)

    def _flush(self, remove_indices: list[int]) -> None:
        """Give ISAM2 the pending factors and values, and take factors out."""
        self._positions = self._carried = None
        try:
            result = self._isam.update(self._new_graph, self._new_values, remove_indices)
            newest = self._isam.calculateEstimatePose3(X(self._keyframes - 1))
        except RuntimeError as error:
            raise OptimizationError(f"keyframe {self._keyframes - 1}: GTSAM could not solve the graph: {error}") from error
        for record, index in zip(self._new_records, result.getNewFactorsIndices(), strict=True):
            if record is not None:
                record.index = int(index)
        self._new_graph = gtsam.NonlinearFactorGraph()
        self._new_values = gtsam.Values()
        self._new_records = []
        self._T_last = require_transform(newest.matrix(), "estimated pose")  # removals and merges move the newest pose, too

    def _settle(self) -> None:
        """Relinearise what a change of hands has moved far, until nothing moves far any more."""
        for _ in range(_SETTLING):
            before = self._isam.getLinearizationPoint()
            self._flush([])
            if self._isam.getLinearizationPoint().equals(before, 1e-9):
                return
