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
_SPLIT_OFF_M = 0.005
"""Points that a split tells apart are half a metre apart; incremental solvers need not have converged."""


def check_smoother(make_smoother: Callable[[], Smoother], corrects_poses: bool = True) -> None:
    """Check a smoother on the tiny world, where measurements are exact.

    Args:
        make_smoother: makes a new, empty smoother at each call.
        corrects_poses: the odometry drifts, and measurements must correct it. False for a smoother that takes poses as they are given:
            it must not change them, and the rest is checked with an odometry that is exact.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(make_smoother(), Smoother), make_smoother(), "lacks methods of Smoother")
    motion = _motion if corrects_poses else _exact_motion
    _starts(make_smoother())
    _predicts(make_smoother(), motion)
    (_corrects_drift if corrects_poses else _keeps_poses)(make_smoother())
    for check in (_locates, _removes, _renames, _bears_outliers):
        check(make_smoother(), motion)
    for simple in (_merges, _continues_a_map, _splits, _takes_back_splits, _refuses_splits, _keeps_priors_when_it_splits):
        simple(make_smoother())


def _start(smoother: Smoother, landmarks: Landmarks | None = None) -> Estimate:
    return smoother.start(T_WORLD_FIRST, _FIRST_COVARIANCE, landmarks)


def _drive(smoother: Smoother, landmarks: Landmarks, motion: Callable[[int], Motion], count: int = 6) -> Estimate:
    """Start, and add ``count`` keyframes that see all landmarks exactly; ``motion(k)`` leads to keyframe k."""
    estimate = _start(smoother)
    for k, T in enumerate(tiny_trajectory(count)):
        seen = tiny_observations(landmarks.p_world, _words(landmarks), T, _MEASUREMENT_SIGMA_M)
        estimate = smoother.update(motion(k) if k else None, seen, landmarks.ids)
    return estimate


def _motion(k: int) -> Motion:
    """As odometry that drifts reports it."""
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


def _predicts(smoother: Smoother, motion: Callable[[int], Motion]) -> None:
    landmarks = tiny_landmarks()
    before = _drive(smoother, landmarks, motion, 2)
    poses = smoother.poses()
    predicted = smoother.predict(motion(2))
    wanted = before.T_world_camera @ motion(2).T_previous_current
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
    truth = tiny_trajectory()
    estimate = _drive(smoother, tiny_landmarks(), _motion, len(truth))
    drifted = _composed(len(truth))[-1]
    error, drift = _distance(truth[-1], estimate.T_world_camera), _distance(truth[-1], drifted)
    require(error < 0.5 * drift, smoother, f"exact measurements leave a pose error of {error:.4f}, odometry alone has {drift:.4f}")


def _keeps_poses(smoother: Smoother) -> None:
    estimate = _drive(smoother, tiny_landmarks(), _motion)
    wanted = _composed(6)
    off = max(_distance(a, b) for a, b in zip(wanted, smoother.poses(), strict=True))
    require(off < 1e-6, smoother, f"it is said to take poses as they are given, but one is {off:.4f} off")
    require(_distance(wanted[-1], estimate.T_world_camera) < 1e-6, smoother, "update does not return the pose that was given")


def _composed(count: int) -> list[FloatArray]:
    """Poses as the drifting odometry alone has them."""
    poses = [T_WORLD_FIRST]
    for k in range(1, count):
        poses.append(poses[-1] @ _motion(k).T_previous_current)
    return poses


def _locates(smoother: Smoother, motion: Callable[[int], Motion]) -> None:
    landmarks, count = tiny_landmarks(), 6
    estimate = _drive(smoother, landmarks, motion, count)
    poses = smoother.poses()
    require_array(poses, (count, 4, 4), "f", smoother, f"poses after {count} keyframes")
    require(_distance(poses[-1], estimate.T_world_camera) < 1e-6, smoother, "the last of poses() is not the pose that update returned")
    ids, p_world = smoother.positions()
    require(np.array_equal(ids, np.sort(landmarks.ids)), smoother, f"positions has the ids {ids.tolist()}, wanted them rising")
    off = float(np.linalg.norm(p_world - landmarks.p_world, axis=1).max())
    require(off < 0.02, smoother, f"a landmark measured exactly six times is {off:.3f} m off")
    for row, covariance in enumerate(smoother.covariances(landmarks.ids)):
        require_covariance(covariance, 3, smoother, f"the covariance of landmark {landmarks.ids[row]}")
        require(float(np.trace(covariance)) < 3 * _MEASUREMENT_SIGMA_M**2, smoother, "six measurements leave a landmark less sure than one")


def _removes(smoother: Smoother, motion: Callable[[int], Motion]) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks, motion)
    gone = int(landmarks.ids[1])
    smoother.remove(gone)
    ids, p_world = smoother.positions()
    kept = landmarks.ids[landmarks.ids != gone]
    require(np.array_equal(ids, kept), smoother, f"after remove({gone}) positions has {ids.tolist()}, wanted {kept.tolist()}")
    off = float(np.linalg.norm(p_world - landmarks.p_world[landmarks.ids != gone], axis=1).max())
    require(off < 0.02, smoother, f"remove({gone}) moved another landmark: {off:.3f} m off")
    observations = tiny_observations(landmarks.p_world, _words(landmarks), tiny_trajectory(7)[6])
    smoother.update(motion(6), observations, landmarks.ids)
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


def _drive_blend(smoother: Smoother) -> FloatArray:
    """Take two points, seen in turn five and three times, for one landmark 20; landmark 30 is measured as it is.

    Returns:
        (3, 3) the points behind numbers 0, 2, 4, 6, 7 of landmark 20, behind 1, 3, 5 of it, and behind landmark 30.
    """
    points = tiny_landmarks().p_world[[0, 1, 2]]
    _start(smoother)
    for k, T in enumerate(tiny_trajectory(8)):
        seen = tiny_observations(points[[k % 2 if k < 7 else 0, 2]], ("cup", "book"), T, _MEASUREMENT_SIGMA_M)
        smoother.update(_exact_motion(k) if k else None, seen, np.array([20, 30]), robust=False)
    return np.asarray(points, dtype=np.float64)


def _splits(smoother: Smoother) -> None:
    points = _drive_blend(smoother)
    smoother.split(20, 10, np.array([5, 1, 3]))
    ids, p_world = smoother.positions()
    require(ids.tolist() == [10, 20, 30], smoother, f"after split(20, 10, …) positions has the ids {ids.tolist()}, wanted [10, 20, 30]")
    off = float(np.linalg.norm(p_world - points[[1, 0, 2]], axis=1).max())
    require(off < _SPLIT_OFF_M, smoother, f"after split(20, 10, …) a landmark is {off:.4f} m from where its measurements put it")
    variance = np.trace(smoother.covariances(np.array([20, 10])), axis1=1, axis2=2)
    require(bool(variance[0] < variance[1]), smoother, "after a split five measurements are less sure than three")
    smoother.split(20, 40, np.arange(1, 5))  # all but one
    both = smoother.positions()[1][[1, 3]]
    off = float(np.linalg.norm(both - points[0], axis=1).max())
    require(off < _SPLIT_OFF_M, smoother, f"a split of all measurements but one leaves a landmark {off:.4f} m from its measurements")
    smoother.merge(20, 10)  # numbers: 0 of the one that stays, then three of the other
    smoother.split(20, 10, np.array([1, 2, 3]))
    off = float(np.linalg.norm(smoother.positions()[1][[0, 1]] - points[[1, 0]], axis=1).max())
    require(
        off < _SPLIT_OFF_M,
        smoother,
        f"after a merge, measurements are not in the order of the one that stays, then the other: {off:.4f} m off",
    )
    smoother.remove(10)
    smoother.update(_exact_motion(8), tiny_observations(points[:1], ("cup",), tiny_trajectory(9)[8]), np.array([20]))
    require(smoother.positions()[0].tolist() == [20, 30, 40], smoother, "after a split, landmarks cannot be removed and measured")


def _takes_back_splits(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks, _exact_motion)
    whole, new = int(landmarks.ids[2]), int(landmarks.ids[0]) - 1
    before = smoother.positions()
    for numbers in ([0], [4, 1], [1, 2, 3, 4, 5]):
        smoother.split(whole, new, np.array(numbers))
        ids = smoother.positions()[0]
        require(
            bool((np.diff(ids) > 0).all()) and new in ids,
            smoother,
            f"after a split positions has the ids {ids.tolist()}, wanted {new} first",
        )
        smoother.merge(whole, new)
        after = smoother.positions()
        same = np.array_equal(before[0], after[0]) and float(np.abs(before[1] - after[1]).max()) < 1e-6
        require(same, smoother, f"a split of measurements {numbers} and the merge that takes it back leave landmarks elsewhere")


def _refuses_splits(smoother: Smoother) -> None:
    _drive_blend(smoother)
    before = smoother.positions()
    for landmark_id, new_id, numbers in (
        (77, 10, [0]),
        (20, 30, [0]),
        (20, 20, [0]),
        (20, 10, [8]),
        (20, 10, [-1]),
        (20, 10, []),
        (20, 10, range(8)),
    ):
        call = f"split({landmark_id}, {new_id}, {list(numbers)})"
        try:
            smoother.split(landmark_id, new_id, np.array(numbers, dtype=np.int64))
        except UnknownLandmarkError:
            after = smoother.positions()
            same = np.array_equal(before[0], after[0]) and np.array_equal(before[1], after[1])
            require(same, smoother, f"{call} is refused, but changes something")
        else:
            require(False, smoother, f"{call} did not raise UnknownLandmarkError")
    smoother.split(20, 10, np.array([1]))


def _keeps_priors_when_it_splits(smoother: Smoother) -> None:
    landmarks = tiny_landmarks()
    here, there = landmarks.p_world[:1], landmarks.p_world[1:2]
    known = int(landmarks.ids[0])
    _start(smoother, landmarks[np.array([0])])
    for point in (here, there):
        smoother.update(None, tiny_observations(point, ("cup",)), np.array([known]), robust=False)
    smoother.split(known, 99, np.array([1]))
    off = float(np.abs(smoother.positions()[1] - np.concatenate([here, there])).max())
    require(off < _SPLIT_OFF_M, smoother, f"a split of a landmark of a continued map leaves it, or the new one, {off:.4f} m off")
    smoother.split(known, 98, np.array([0]))  # what the map knew is enough
    sure = np.trace(smoother.covariances(np.array([known, 98])), axis1=1, axis2=2) / np.trace(landmarks.cov_world[0])
    require(abs(sure[0] - 1.0) < 0.01, smoother, "a split does not leave the landmark of a continued map what the map knew of it")


def _renames(smoother: Smoother, motion: Callable[[int], Motion]) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks, motion)
    first, second = (int(i) for i in landmarks.ids[:2])
    ids, p_world = smoother.positions()
    moved_to = p_world[ids == second][0]
    smoother.remove(first)
    smoother.rename(second, first)
    ids, p_world = smoother.positions()
    require(second not in ids and first in ids, smoother, f"after rename({second}, {first}) positions has {ids.tolist()}")
    require(bool(np.allclose(p_world[ids == first][0], moved_to, atol=2e-3)), smoother, "rename moved the landmark")
    seen = tiny_observations(p_world[ids == first], ("cup",), tiny_trajectory(7)[6])
    smoother.update(motion(6), seen, np.array([first]))
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


def _bears_outliers(smoother: Smoother, motion: Callable[[int], Motion]) -> None:
    landmarks = tiny_landmarks()
    _drive(smoother, landmarks, motion)
    T = tiny_trajectory(7)[6]
    wrong = tiny_observations(landmarks.p_world[:1] + np.array([0.3, 0.0, 0.0]), ("cup",), T, _MEASUREMENT_SIGMA_M)
    before = smoother.predict(_exact_motion(6)).T_world_camera
    after = smoother.update(_exact_motion(6), wrong, landmarks.ids[:1], robust=True).T_world_camera
    off = float(np.linalg.norm(smoother.positions()[1][0] - landmarks.p_world[0]))
    require(off < 0.02, smoother, f"one robust measurement that is 0.3 m wrong, after six right ones, leaves its landmark {off:.3f} m off")
    shift = float(np.linalg.norm(after[:3, 3] - before[:3, 3]))
    require(shift < 0.05, smoother, f"one robust measurement that is 0.3 m wrong moves the camera by {shift:.3f} m")
