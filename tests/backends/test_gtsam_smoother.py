"""The ISAM2 smoother against batch solutions, sampling, and itself built another way."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.config import SmootherSettings
from seo_slam.errors import FrameError, OptimizationError, UnknownLandmarkError
from seo_slam.geometry import exp, inverse, log
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_landmarks, tiny_observations, tiny_trajectory
from seo_slam.types import Motion

FIRST = 1e-6 * np.eye(6)
MOTION = np.diag([2e-5] * 3 + [1e-4] * 3)
SIGMA_M = 0.01
POINTS = tiny_landmarks().p_world


def motions(count, seed=0, noise=1.0):
    """Noisy steps of the tiny trajectory."""
    rng, poses = np.random.default_rng(seed), tiny_trajectory(count)
    draws = noise * rng.multivariate_normal(np.zeros(6), MOTION, size=count)
    return [Motion(inverse(poses[k - 1]) @ poses[k] @ exp(draws[k]), MOTION) for k in range(1, count)]


def measured(k, rows, seed=0, noise=1.0):
    """What keyframe k sees of points, with noise."""
    seen = tiny_observations(POINTS[rows], ("cup",) * len(rows), tiny_trajectory(k + 1)[k], SIGMA_M)
    draws = np.random.default_rng((seed, k)).normal(size=(len(POINTS), 3))[rows]
    return replace(seen, p_camera=seen.p_camera + noise * SIGMA_M * draws)


def ids(*numbers):
    return np.array(numbers, dtype=np.int64)


def drive(count=6, smoother=None, noise=1.0, rename=None, robust=True, landmarks=None):
    """Start and add keyframes that see all four points, as landmarks 0..3 or as ``rename(k)`` says."""
    smoother = smoother or GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST, landmarks)
    steps = [None, *motions(count, noise=noise)]
    for k in range(count):
        estimate = smoother.update(steps[k], measured(k, range(4), noise=noise), rename(k) if rename else ids(0, 1, 2, 3), robust)
    return smoother, estimate


def batch(count=6):
    """The same problem as one graph, solved at once; its marginals."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    poses = tiny_trajectory(count)
    graph.push_back(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(T_WORLD_FIRST), gtsam.noiseModel.Gaussian.Covariance(FIRST)))
    for k, motion in enumerate(motions(count), start=1):
        noise = gtsam.noiseModel.Gaussian.Covariance(MOTION)
        graph.push_back(gtsam.BetweenFactorPose3(X(k - 1), X(k), gtsam.Pose3(motion.T_previous_current), noise))
    for k in range(count):
        values.insert(X(k), gtsam.Pose3(poses[k]))
        for n, p in enumerate(measured(k, range(4)).p_camera):
            r, direction = float(np.linalg.norm(p)), gtsam.Unit3(p)
            J = np.vstack([direction.basis().T / r, p[None] / r])
            noise = gtsam.noiseModel.Gaussian.Covariance(SIGMA_M**2 * J @ J.T)
            graph.push_back(gtsam.BearingRangeFactor3D(X(k), L(n), direction, r, noise))
    for n, p_world in enumerate(POINTS):
        values.insert(L(n), p_world)
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return solved, gtsam.Marginals(graph, solved)


def test_agrees_with_the_batch_solution():
    smoother, estimate = drive(robust=False)
    solved, marginals = batch()
    for k, T in enumerate(smoother.poses()):
        np.testing.assert_allclose(log(inverse(T) @ solved.atPose3(X(k)).matrix()), 0.0, atol=1e-3)
    np.testing.assert_allclose(smoother.positions()[1], [solved.atPoint3(L(n)) for n in range(4)], atol=1e-3)
    order = ids(2, 0, 3, 1)
    wanted = marginals.jointMarginalCovariance([X(5), *(L(int(n)) for n in order)])
    keys = [X(5), *(L(int(n)) for n in order)]
    blocks = np.block([[wanted.at(a, b) for b in keys] for a in keys])
    got = estimate.joint_covariance(order)
    scale = np.sqrt(np.diag(blocks))
    np.testing.assert_allclose(got / np.outer(scale, scale), blocks / np.outer(scale, scale), atol=0.05)


def test_joint_covariance_has_the_pose_first_and_landmarks_as_asked():
    smoother, estimate = drive()
    joint = estimate.joint_covariance(ids(3, 1))
    assert joint.shape == (12, 12)
    np.testing.assert_allclose(joint, joint.T, atol=1e-15)
    np.testing.assert_allclose(joint[:6, :6], estimate.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(joint[6:9, 6:9], smoother.covariances(ids(3))[0], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(joint[9:, 9:], smoother.covariances(ids(1))[0], rtol=1e-6, atol=1e-12)
    other = estimate.joint_covariance(ids(1, 3))
    np.testing.assert_allclose(joint[:6, 6:9], other[:6, 9:], rtol=1e-6, atol=1e-12)


def test_many_covariances_at_once_are_those_one_by_one():
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST)
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(1, 2, 90), rng.uniform(-1, 1, 90), rng.uniform(0.5, 1.5, 90)])
    smoother.update(None, tiny_observations(points, ("cup",) * 90), np.arange(90))
    together = smoother.covariances(np.arange(90))
    for n in (0, 39, 40, 89):
        np.testing.assert_allclose(together[n], smoother.covariances(ids(n))[0], rtol=1e-6, atol=1e-12)
    assert smoother.covariances(ids()).shape == (0, 3, 3)


def test_predicted_covariance_is_that_of_samples():
    """Draw pose and landmarks from their joint covariance, move each pose by a drawn motion: the spread is what predict says."""
    smoother, estimate = drive()
    T_step = exp([0.3, -0.2, 0.4, 0.2, 0.1, -0.3])  # a large turn, so that a missing adjoint shows
    motion = Motion(T_step, np.diag([4e-5, 1e-5, 2e-5, 3e-5, 9e-5, 1e-5]))
    predicted = smoother.predict(motion)
    joint = estimate.joint_covariance(ids(1))
    rng = np.random.default_rng(5)
    draws = rng.multivariate_normal(np.zeros(9), joint, size=4000)
    steps = rng.multivariate_normal(np.zeros(6), motion.covariance, size=4000)
    inverse_prediction = inverse(predicted.T_world_camera)
    samples = np.array(
        [
            np.concatenate([log(inverse_prediction @ estimate.T_world_camera @ exp(d[:6]) @ T_step @ exp(s)), d[6:]])
            for d, s in zip(draws, steps, strict=True)
        ]
    )
    got, wanted = predicted.joint_covariance(ids(1)), np.cov(samples.T)
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(got / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=0.08)
    np.testing.assert_allclose(got, got.T, atol=1e-15)


def test_estimates_are_as_far_off_as_they_say():
    """Normalised errors of the newest pose over many noisy drives are chi-square with 6 degrees of freedom."""
    truth = tiny_trajectory(4)[3]
    squared = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        smoother = GtsamSmoother()
        smoother.start(T_WORLD_FIRST @ exp(rng.multivariate_normal(np.zeros(6), FIRST)), FIRST)
        for k, motion in enumerate([None, *motions(4, seed)]):
            estimate = smoother.update(motion, measured(k, range(4), seed), ids(0, 1, 2, 3), robust=False)
        error = log(inverse(estimate.T_world_camera) @ truth)
        squared.append(error @ np.linalg.solve(estimate.covariance, error))
    assert 4.5 < np.mean(squared) < 7.8  # 6 expected, standard deviation of the mean 0.45


def test_robust_loss_damps_an_outlier():
    def after(robust):
        smoother, _ = drive()
        wrong = measured(6, [0])
        wrong = replace(wrong, p_camera=wrong.p_camera + np.array([0.25, 0.0, 0.0]))
        smoother.update(motions(7)[5], wrong, ids(0), robust)
        return np.linalg.norm(smoother.positions()[1][0] - POINTS[0])

    assert after(robust=True) < 0.02
    assert after(robust=False) > 1.5 * after(robust=True)


def test_cauchy_k_is_taken_from_the_settings():
    def pulled(k):
        smoother, _ = drive(smoother=GtsamSmoother(SmootherSettings(cauchy_k=k)))
        wrong = measured(6, [0])
        wrong = replace(wrong, p_camera=wrong.p_camera + np.array([0.25, 0.0, 0.0]))
        smoother.update(motions(7)[5], wrong, ids(0))
        return np.linalg.norm(smoother.positions()[1][0] - POINTS[0])

    assert pulled(100.0) > 1.5 * pulled(0.5)


def test_remove_leaves_what_would_be_there_without_it():
    smoother, _ = drive()
    smoother.remove(2)
    other = GtsamSmoother()
    other.start(T_WORLD_FIRST, FIRST)
    for k, motion in enumerate([None, *motions(6)]):
        other.update(motion, measured(k, [0, 1, 3]), ids(0, 1, 3))
    assert smoother.positions()[0].tolist() == [0, 1, 3]
    np.testing.assert_allclose(smoother.positions()[1], other.positions()[1], atol=2e-3)
    np.testing.assert_allclose(smoother.poses(), other.poses(), atol=2e-3)
    # Weights of the robust loss depend on where each was linearised.
    got, wanted = smoother.covariances(ids(0, 1, 3)), other.covariances(ids(0, 1, 3))
    np.testing.assert_allclose(np.trace(got, axis1=1, axis2=2), np.trace(wanted, axis1=1, axis2=2), rtol=0.2)


def test_a_removed_id_is_unknown_and_can_come_back_elsewhere():
    smoother, _ = drive()
    smoother.remove(2)
    for call in (
        lambda: smoother.covariances(ids(2)),
        lambda: smoother.remove(2),
        lambda: smoother.merge(2, 0),
        lambda: smoother.merge(0, 2),
    ):
        with pytest.raises(UnknownLandmarkError, match="landmark 2"):
            call()
    there = tiny_observations(POINTS[:1] + np.array([0.0, 0.5, 0.0]), ("cup",), smoother.poses()[-1], SIGMA_M)
    smoother.update(Motion(np.eye(4), MOTION), there, ids(2))
    assert smoother.positions()[0].tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(smoother.positions()[1][2], POINTS[0] + np.array([0.0, 0.5, 0.0]), atol=0.01)


def test_prediction_follows_the_graph_after_a_removal():
    """The newest pose moves when a wrong landmark is taken out; predictions start from where it is then."""
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST)
    smoother.update(None, measured(0, [0], noise=0.0), ids(0), robust=False)
    wrong = measured(1, [0], noise=0.0)
    wrong = replace(wrong, p_camera=wrong.p_camera + np.array([0.1, 0.0, 0.0]), cov_camera=1e-6 * wrong.cov_camera / SIGMA_M**2)
    moved = smoother.update(motions(2, noise=0.0)[0], wrong, ids(0), robust=False).T_world_camera
    smoother.remove(0)
    assert np.linalg.norm(log(inverse(moved) @ smoother.poses()[-1])) > 0.01
    predicted = smoother.predict(Motion(np.eye(4), MOTION))
    np.testing.assert_allclose(predicted.T_world_camera, smoother.poses()[-1], atol=1e-9)


def test_merged_is_as_if_it_had_been_one_from_the_start():
    apart, _ = drive(rename=lambda k: ids(0, 1, 2, 3) if k % 2 == 0 else ids(10, 1, 2, 3))
    assert apart.positions()[0].tolist() == [0, 1, 2, 3, 10]
    apart.merge(0, 10)
    one, _ = drive()
    assert apart.positions()[0].tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(apart.positions()[1], one.positions()[1], atol=2e-3)
    np.testing.assert_allclose(apart.poses(), one.poses(), atol=2e-3)
    got, wanted = apart.covariances(ids(0, 1, 2, 3)), one.covariances(ids(0, 1, 2, 3))
    np.testing.assert_allclose(np.trace(got, axis1=1, axis2=2), np.trace(wanted, axis1=1, axis2=2), rtol=0.2)
    apart.remove(0)  # takes out the factors that came by the merge, too
    assert apart.positions()[0].tolist() == [1, 2, 3]
    apart.update(motions(7)[5], measured(6, range(4)), ids(0, 1, 2, 3))
    assert apart.positions()[0].tolist() == [0, 1, 2, 3]


def test_a_landmark_cannot_be_merged_with_itself_and_nothing_changes():
    smoother, _ = drive()
    before = smoother.positions()[1]
    with pytest.raises(UnknownLandmarkError, match="itself"):
        smoother.merge(1, 1)
    with pytest.raises(UnknownLandmarkError, match="landmark 77"):
        smoother.merge(77, 1)
    np.testing.assert_array_equal(smoother.positions()[1], before)


def test_a_continued_map_is_a_prior_and_new_measurements_improve_it():
    old = tiny_landmarks()
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST, old)
    before = smoother.covariances(old.ids)
    np.testing.assert_allclose(before, old.cov_world, rtol=1e-6, atol=1e-12)
    smoother.update(None, tiny_observations(old.p_world, ("cup",) * 4), old.ids)
    after = smoother.covariances(old.ids)
    assert (np.trace(after, axis1=1, axis2=2) < 0.7 * np.trace(before, axis1=1, axis2=2)).all()
    np.testing.assert_allclose(smoother.positions()[1], old.p_world, atol=1e-4)
    smoother.remove(int(old.ids[0]))
    assert smoother.positions()[0].tolist() == old.ids[1:].tolist()


def test_the_prior_of_a_continued_map_outweighs_one_poor_measurement():
    old = tiny_landmarks()
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST, old)
    off = tiny_observations(old.p_world[:1] + np.array([0.2, 0.0, 0.0]), ("cup",), sigma_m=0.1)
    smoother.update(None, off, old.ids[:1])
    assert np.linalg.norm(smoother.positions()[1][0] - old.p_world[0]) < 0.01


def test_poses_are_one_a_keyframe():
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST)
    assert smoother.poses().shape == (1, 4, 4)
    smoother.update(None, measured(0, range(4)), ids(0, 1, 2, 3))
    assert smoother.poses().shape == (1, 4, 4)
    nothing = measured(0, [])
    for k, motion in enumerate(motions(4), start=2):
        smoother.update(motion, nothing, ids())
        assert smoother.poses().shape == (k, 4, 4)


def test_poses_are_those_of_the_keyframes_one_by_one():
    assert GtsamSmoother().poses().shape == (0, 4, 4)
    smoother, _ = drive(12)
    one_by_one = [smoother._isam.calculateEstimatePose3(X(k)).matrix() for k in range(12)]
    np.testing.assert_array_equal(smoother.poses(), one_by_one)


def test_keyframes_without_measurements_follow_odometry():
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST)
    for k, motion in enumerate([None, *motions(5, noise=0.0)]):
        estimate = smoother.update(motion, measured(k, []), ids())
    np.testing.assert_allclose(estimate.T_world_camera, tiny_trajectory(5)[4], atol=1e-6)


def test_what_it_returns_can_be_written_to():
    smoother, estimate = drive(2)
    wanted = smoother.positions()[1]
    smoother.positions()[1][:] = 0.0
    estimate.T_world_camera[:] = 0.0
    estimate.joint_covariance(ids(0))[:] = 0.0
    np.testing.assert_array_equal(smoother.positions()[1], wanted)
    assert np.isfinite(smoother.predict(Motion(np.eye(4), MOTION)).T_world_camera).all()
    assert np.trace(smoother.covariances(ids(0))[0]) > 0


SHEARED = np.array([[1.0, 0.2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize("wrong", [SHEARED, 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), np.full((4, 4), np.nan), np.eye(3)])
def test_what_is_no_rotation_never_reaches_the_graph(wrong):
    with pytest.raises(FrameError, match="first camera pose"):
        GtsamSmoother().start(wrong, FIRST)
    with pytest.raises(FrameError, match="T_previous_current"):
        Motion(wrong, MOTION)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (np.zeros((6, 6)), "smallest variance is 0"),
        (-1e-4 * np.eye(6), "smallest variance is -0.0001"),
        (np.diag([0.0, 1, 1, 1, 1, 1]), "smallest variance is 0"),
        (1e-4 * (np.eye(6) + np.triu(np.ones((6, 6)), 1)), "not symmetric"),
    ],
)
def test_what_is_no_covariance_is_refused_and_changes_nothing(wrong, words):
    with pytest.raises(FrameError, match=f"first camera.*{words}"):
        GtsamSmoother().start(T_WORLD_FIRST, wrong)
    smoother, _ = drive(2)
    poses = smoother.poses()
    with pytest.raises(FrameError, match=f"motion from odometry.*{words}"):
        smoother.update(Motion(np.eye(4), wrong), measured(2, range(4)), ids(0, 1, 2, 3))
    flat = replace(measured(2, range(4)), cov_camera=np.tile(wrong[:3, :3], (4, 1, 1)))
    with pytest.raises(FrameError, match=f"cov_camera.*{words}"):
        smoother.update(motions(3)[1], flat, ids(0, 1, 2, 3))
    np.testing.assert_array_equal(smoother.poses(), poses)
    smoother.update(motions(3)[1], measured(2, range(4)), ids(0, 1, 2, 3))
    assert len(smoother.poses()) == 3


def test_a_graph_without_a_solution_is_an_error_of_ours():
    smoother, _ = drive(2)
    at_the_camera = replace(measured(2, [0]), p_camera=np.full((1, 3), 1e-170))
    with pytest.raises(OptimizationError, match="keyframe 2"), np.errstate(all="ignore"):
        smoother.update(motions(3)[1], at_the_camera, ids(0))


def test_it_cannot_start_twice():
    smoother, _ = drive(2)
    with pytest.raises(OptimizationError, match="x0"):
        smoother.start(T_WORLD_FIRST, FIRST)


def test_a_long_way_straight_on_is_solved():
    """Poses grow ever less certain on a way without loops; Cholesky factors gave up after 200 m of it."""
    smoother = GtsamSmoother()
    smoother.start(np.eye(4), np.diag([(0.05 * np.pi / 180) ** 2] * 3 + [1e-6] * 3))
    forward = Motion(exp([0, 0, 0, 0, 0, 0.25]), np.diag([3.5e-3**2] * 3 + [5.8e-3**2] * 3))
    nothing = measured(0, [])
    for _ in range(1600):
        estimate = smoother.update(forward, nothing, ids())
    np.testing.assert_allclose(estimate.T_world_camera[:3, 3], [0, 0, 400.0], atol=1e-6)
