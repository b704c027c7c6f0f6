"""Contract of a ``Smoother``."""

from collections.abc import Callable

import numpy as np

from seo_slam.errors import UnknownLandmarkError
from seo_slam.geometry import FloatArray, exp, inverse, log
from seo_slam.interfaces import Smoother
from seo_slam.testing.clauses import require, require_array, require_covariance
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_landmarks, tiny_observations, tiny_trajectory
from seo_slam.types import Estimate, IntArray, Landmarks, Motion

_FIRST_COVARIANCE = 1e-6 * np.eye(6)
_MOTION_COVARIANCE = 4e-4 * np.eye(6)
_MEASUREMENT_SIGMA_M = 0.005
_DRIFT = np.array([0.004, -0.004, 0.002, 0.008, 0.008, -0.006])
"""Error of each reported motion: rotation (rad) first, then translation (m)."""


def check_smoother(make_smoother: Callable[[], Smoother]) -> None:
    """Check a smoother on the tiny world, where odometry drifts and measurements are exact.

    Args:
        make_smoother: makes a new, empty smoother at each call.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(make_smoother(), Smoother), make_smoother(), "lacks methods of Smoother")
    for check in (_starts, _predicts, _corrects_drift, _removes, _merges, _renames, _continues_a_map, _bears_outliers):
        check(make_smoother())


def _start(smoother: Smoother, landmarks: Landmarks | None = None) -> Estimate:
    return smoother.start(T_WORLD_FIRST, _FIRST_COVARIANCE, landmarks)


def _drive(smoother: Smoother, landmarks: Landmarks, count: int = 6) -> Estimate:
    """Start, and add ``count`` keyframes that see all landmarks exactly while odometry drifts."""
    estimate = _start(smoother)
    for k, T in enumerate(tiny_trajectory(count)):
        seen = tiny_observations(landmarks.p_world, _words(landmarks), T, _MEASUREMENT_SIGMA_M)
        estimate = smoother.update(_motion(k) if k else None, seen, landmarks.ids)
    return estimate


def _motion(k: int) -> Motion:
    exact = _exact_motion(k)
    return Motion(exact.T_previous_current @ exp(_DRIFT), _MOTION_COVARIANCE)


def _exact_motion(k: int) -> Motion:
    T_world_camera = tiny_trajectory(k + 1)
    return Motion(inverse(T_world_camera[k - 1]) @ T_world_camera[k], _FIRST_COVARIANCE)


def _words(landmarks: Landmarks) -> tuple[str | None, ...]:
    return tuple(next(iter(words)) for words in landmarks.labels)


def _distance(T_a: FloatArray, T_b: FloatArray) -> float:
    return float(np.linalg.norm(log(inverse(T_a) @ T_b)))


def _starts(smoother: Smoother) -> None:
    estimate = _start(smoother)
    require(isinstance(estimate, Estimate), smoother, f"start returned {type(estimate).__name__}, wanted an Estimate")
    require(_distance(estimate.T_world_camera, T_WORLD_FIRST) < 1e-6, smoother, "start does not put the first camera where it was told")
    require_covariance(estimate.covariance, 6, smoother, "the covariance after start")
    require(
        bool(np.allclose(estimate.covariance, _FIRST_COVARIANCE, rtol=0.01, atol=1e-12)), smoother, "start changed the covariance given"
    )
    ids, p_world = smoother.positions()
    require_array(ids, (0,), "i", smoother, "positions: ids before any measurement")
    require_array(p_world, (0, 3), "f", smoother, "positions: points before any measurement")


def _predicts(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    before = _drive(smoother, landmarks, 2)
    poses = smoother.poses()
    motion = _motion(2)
    predicted = smoother.predict(motion)
    wanted = before.T_world_camera @ motion.T_previous_current
    require(_distance(predicted.T_world_camera, wanted) < 1e-6, smoother, "predict is not the last pose times the motion")
    require(np.array_equal(poses, smoother.poses()), smoother, "predict changed the poses")
    require(
        float(np.trace(predicted.covariance)) > float(np.trace(before.covariance)), smoother, "predict does not add the motion's covariance"
    )
    for what, estimate in (("predicted", predicted), ("updated", smoother.predict(Motion(np.eye(4), 1e-12 * np.eye(6))))):
        _check_joint(smoother, estimate, landmarks.ids, what)


def _check_joint(smoother: Smoother, estimate: Estimate, ids: IntArray, what: str) -> None:
    """Blocks of the joint covariance are where they belong, whatever the order of the ids."""
    joint = estimate.joint_covariance(ids)
    require_covariance(joint, 6 + 3 * len(ids), smoother, f"the {what} joint covariance")
    scale = float(np.abs(joint).max())
    require(
        bool(np.allclose(joint[:6, :6], estimate.covariance, atol=1e-6 * scale)),
        smoother,
        f"the first 6x6 block of the {what} joint covariance is not the pose's covariance",
    )
    marginals = smoother.covariances(ids)
    require_array(marginals, (len(ids), 3, 3), "f", smoother, "covariances")
    blocks = np.array([joint[6 + 3 * k : 9 + 3 * k, 6 + 3 * k : 9 + 3 * k] for k in range(len(ids))])
    require(
        bool(np.allclose(blocks, marginals, atol=1e-6 * scale)),
        smoother,
        f"the landmark blocks of the {what} joint covariance are not covariances(ids), in the order of the ids",
    )
    rows = np.concatenate([np.arange(6), 6 + np.arange(3 * len(ids)).reshape(-1, 3)[::-1].ravel()])
    turned = estimate.joint_covariance(ids[::-1])
    require(
        bool(np.allclose(turned, joint[np.ix_(rows, rows)], atol=1e-6 * scale)),
        smoother,
        f"the {what} joint covariance of the ids in another order is not the same matrix in that order",
    )


def _corrects_drift(smoother: Smoother) -> None:
    landmarks, truth = tiny_landmarks(), tiny_trajectory()
    estimate = _drive(smoother, landmarks, len(truth))
    poses = smoother.poses()
    require_array(poses, (len(truth), 4, 4), "f", smoother, f"poses after {len(truth)} keyframes")
    require(_distance(poses[-1], estimate.T_world_camera) < 1e-6, smoother, "the last of poses() is not the pose that update returned")
    drifted = T_WORLD_FIRST
    for k in range(1, len(truth)):
        drifted = drifted @ _motion(k).T_previous_current
    error, drift = _distance(truth[-1], estimate.T_world_camera), _distance(truth[-1], drifted)
    require(error < 0.5 * drift, smoother, f"exact measurements leave a pose error of {error:.4f}, odometry alone has {drift:.4f}")
    ids, p_world = smoother.positions()
    require(np.array_equal(ids, np.sort(landmarks.ids)), smoother, f"positions has the ids {ids.tolist()}, wanted them rising")
    off = float(np.linalg.norm(p_world - landmarks.p_world, axis=1).max())
    require(off < 0.02, smoother, f"a landmark measured exactly six times is {off:.3f} m off")
    for row, covariance in enumerate(smoother.covariances(landmarks.ids)):
        require_covariance(covariance, 3, smoother, f"the covariance of landmark {landmarks.ids[row]}")
        require(float(np.trace(covariance)) < 3 * _MEASUREMENT_SIGMA_M**2, smoother, "six measurements leave a landmark less sure than one")


def _removes(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks)
    gone = int(landmarks.ids[1])
    smoother.remove(gone)
    ids, p_world = smoother.positions()
    kept = landmarks.ids[landmarks.ids != gone]
    require(np.array_equal(ids, kept), smoother, f"after remove({gone}) positions has {ids.tolist()}, wanted {kept.tolist()}")
    off = float(np.linalg.norm(p_world - landmarks.p_world[landmarks.ids != gone], axis=1).max())
    require(off < 0.02, smoother, f"remove({gone}) moved another landmark: {off:.3f} m off")
    observations = tiny_observations(landmarks.p_world, _words(landmarks), tiny_trajectory(7)[6])
    smoother.update(_motion(6), observations, landmarks.ids)
    require(np.array_equal(smoother.positions()[0], landmarks.ids), smoother, f"landmark {gone} cannot be measured again after remove")


def _merges(smoother: Smoother) -> None:
    point = tiny_landmarks()[np.array([0])]
    keep, drop = np.array([1]), np.array([2])
    _start(smoother)
    for k, T in enumerate(tiny_trajectory(4)):
        smoother.update(_exact_motion(k) if k else None, tiny_observations(point.p_world, ("cup",), T), (keep, drop)[k % 2])
    before = float(np.trace(smoother.covariances(keep)[0]))
    smoother.merge(1, 2)
    ids, p_world = smoother.positions()
    require(ids.tolist() == [1], smoother, f"after merge(1, 2) positions has {ids.tolist()}, wanted [1]")
    require(float(np.linalg.norm(p_world[0] - point.p_world[0])) < 0.02, smoother, "merge moved the landmark that stays")
    after = float(np.trace(smoother.covariances(keep)[0]))
    require(after < 0.9 * before, smoother, f"merge lost measurements: variance was {before:.3g}, is {after:.3g} with twice as many")


def _renames(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks)
    first, second = (int(i) for i in landmarks.ids[:2])
    ids, p_world = smoother.positions()
    moved_to = p_world[ids == second][0]
    smoother.remove(first)
    smoother.rename(second, first)
    ids, p_world = smoother.positions()
    require(second not in ids and first in ids, smoother, f"after rename({second}, {first}) positions has {ids.tolist()}")
    require(bool(np.allclose(p_world[ids == first][0], moved_to, atol=2e-3)), smoother, "rename moved the landmark")
    seen = tiny_observations(p_world[ids == first], ("cup",), tiny_trajectory(7)[6])
    smoother.update(_motion(6), seen, np.array([first]))
    try:
        smoother.rename(int(landmarks.ids[2]), first)
    except UnknownLandmarkError:
        return
    require(False, smoother, "rename to an id that is taken did not raise UnknownLandmarkError")


def _continues_a_map(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    _start(smoother, landmarks)
    ids, p_world = smoother.positions()
    right = np.array_equal(ids, landmarks.ids) and bool(np.allclose(p_world, landmarks.p_world, atol=1e-6))
    require(right, smoother, "start(landmarks=…) does not keep the landmarks of the map to be continued")
    close = np.allclose(smoother.covariances(ids), landmarks.cov_world, rtol=0.01, atol=1e-9)
    require(bool(close), smoother, "start(landmarks=…) does not keep their covariances")
    first, second, third = (int(i) for i in landmarks.ids[:3])
    smoother.merge(second, first)
    smoother.merge(third, second)
    after = float(np.trace(smoother.covariances(landmarks.ids[2:3])[0]))
    require(
        after < 0.4 * float(np.trace(landmarks.cov_world[2])),
        smoother,
        "two merges, one into the other, lose what the continued map knew of the first landmark",
    )


def _bears_outliers(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks)
    T = tiny_trajectory(7)[6]
    wrong = tiny_observations(landmarks.p_world[:1] + np.array([0.3, 0.0, 0.0]), ("cup",), T, _MEASUREMENT_SIGMA_M)
    before = smoother.predict(_exact_motion(6)).T_world_camera
    after = smoother.update(_exact_motion(6), wrong, landmarks.ids[:1], robust=True).T_world_camera
    off = float(np.linalg.norm(smoother.positions()[1][0] - landmarks.p_world[0]))
    require(off < 0.02, smoother, f"one robust measurement that is 0.3 m wrong, after six right ones, leaves its landmark {off:.3f} m off")
    shift = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
    require(shift < 0.05, smoother, f"one robust measurement that is 0.3 m wrong moves the camera by {shift:.3f} m")
