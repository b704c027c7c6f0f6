"""Contract of an ``Associator``."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Associator
from seo_slam.testing.clauses import require, require_array
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_landmarks, tiny_observations
from seo_slam.types import NEW, REJECTED, Association, Estimate, IntArray, Landmarks, Observations

_POSE_SIGMA = 1e-3
_AWAY_M = np.array([0.0, 0.0, 1.5])


def check_associator(associator: Associator) -> None:
    """Check an associator on the tiny world: exact measurements find their landmarks, what is elsewhere finds none.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(associator, Associator), associator, "is not a subclass of seo_slam.interfaces.Associator")
    landmarks = tiny_landmarks()
    labels = tuple(next(iter(words)) for words in landmarks.labels)
    nothing, none = tiny_observations(np.zeros((0, 3)), ()), landmarks[np.zeros(0, dtype=np.int64)]
    everything = tiny_observations(landmarks.p_world, labels)
    for observations, known in ((nothing, none), (nothing, landmarks), (everything, none)):
        ids = _associate(associator, observations, known)
        require(bool((ids < 0).all()), associator, f"gave the ids {ids.tolist()} though there is nothing to match")
    ids = _associate(associator, everything, landmarks)
    require(np.array_equal(ids, landmarks.ids), associator, f"exact measurements of {landmarks.ids.tolist()} went to {ids.tolist()}")
    order = np.array([3, 1, 0, 2])
    ids = _associate(associator, everything[order], landmarks)
    require(
        np.array_equal(ids, landmarks.ids[order]), associator, f"in another order, {landmarks.ids[order].tolist()} went to {ids.tolist()}"
    )
    far = tiny_observations(landmarks.p_world + _AWAY_M, labels)
    ids = _associate(associator, far, landmarks)
    require(bool((ids < 0).all()), associator, f"measurements {_AWAY_M[2]} m off any landmark were given to {ids.tolist()}")
    unnamed = tiny_observations(landmarks.p_world[:2], (None, None))
    _associate(associator, unnamed, landmarks)
    _check_more_observations_than_landmarks(associator, landmarks, everything)


def tiny_estimate(landmarks: Landmarks) -> Estimate:
    """Return the first tiny camera, 1 mm and 1 mrad sure, independent of the landmarks."""

    def joint_covariance(landmark_ids: IntArray) -> FloatArray:
        out = _POSE_SIGMA**2 * np.eye(6 + 3 * len(landmark_ids))
        for k, landmark_id in enumerate(landmark_ids):
            rows = slice(6 + 3 * k, 9 + 3 * k)
            out[rows, rows] = landmarks.cov_world[int(np.flatnonzero(landmarks.ids == landmark_id)[0])]
        return out

    return Estimate(T_WORLD_FIRST, joint_covariance)


def _associate(associator: Associator, observations: Observations, landmarks: Landmarks) -> IntArray:
    before = observations.p_camera.copy(), landmarks.p_world.copy()
    result = associator.associate(observations, landmarks, tiny_estimate(landmarks))
    again = associator.associate(observations, landmarks, tiny_estimate(landmarks))
    K = len(observations)
    require(isinstance(result, Association), associator, f"associate returned {type(result).__name__}, wanted an Association")
    ids, costs = result.landmark_ids, result.costs
    require_array(ids, (K,), "i", associator, f"landmark_ids of {K} observations")
    require(costs.shape == (K,), associator, f"costs are {costs.shape}, wanted ({K},)")
    strange = set(ids.tolist()) - {*landmarks.ids.tolist(), NEW, REJECTED}
    require(not strange, associator, f"gave the ids {sorted(strange)}, which are not in the map, nor NEW (-1) or REJECTED (-2)")
    require(np.array_equal(np.isfinite(costs), ids >= 0), associator, "costs must be finite where matched, NaN where NEW or REJECTED")
    unchanged = np.array_equal(before[0], observations.p_camera) and np.array_equal(before[1], landmarks.p_world)
    require(unchanged, associator, "associate changed its arguments")
    require(np.array_equal(ids, again.landmark_ids), associator, "the same question twice got two answers")
    return np.asarray(ids, dtype=np.int64)


def _check_more_observations_than_landmarks(associator: Associator, landmarks: Landmarks, observations: Observations) -> None:
    ids = _associate(associator, observations, landmarks[np.array([2])])
    require(
        int((ids == landmarks.ids[2]).sum()) == 1 and ids[2] == landmarks.ids[2],
        associator,
        f"of two books side by side only one is in the map, as {landmarks.ids[2]}; the measurements went to {ids.tolist()}",
    )
