"""The smoother of given poses against least squares, and laws that hold for any set of measurements."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from seo_slam.backends.given_poses_smoother import GivenPosesSmoother
from seo_slam.config import SmootherSettings
from seo_slam.errors import FrameError, OptimizationError, UnknownLandmarkError
from seo_slam.geometry import exp, inverse, skew, transform_points
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_landmarks, tiny_observations, tiny_trajectory
from seo_slam.types import Motion
from tiny_run import centre_world, frames, pipeline

FIRST = 1e-6 * np.eye(6)
MOTION = 1e-4 * np.eye(6)
POINTS = tiny_landmarks().p_world
GAMMA = np.diag([1e-4, 4e-4, 2.5e-3])


def ids(*numbers):
    return np.array(numbers, dtype=np.int64)


def measured(T, seed, rows=(0,), noise=1.0):
    """Points seen from a camera, less surely along the line of sight."""
    seen = tiny_observations(POINTS[list(rows)], ("cup",) * len(rows), T)
    draws = np.random.default_rng(seed).normal(size=(len(rows), 3)) * np.sqrt(np.diag(GAMMA))
    return replace(seen, p_camera=seen.p_camera + noise * draws, cov_camera=np.tile(GAMMA, (len(rows), 1, 1)))


def started(k=1.0):
    smoother = GivenPosesSmoother(SmootherSettings(cauchy_k=k))
    smoother.start(T_WORLD_FIRST, FIRST)
    return smoother


def drive(smoother, count, robust=True, rows=(0,), outlier=None):
    """See points from ``count`` poses; return their measurements in the world, and covariances there."""
    points, covariances = [], []
    poses = tiny_trajectory(8)
    for k in range(count):
        T = poses[k % 8]
        step = Motion(inverse(poses[(k - 1) % 8]) @ T, MOTION) if k else None
        seen = measured(T, k, rows)
        if k == outlier:
            seen.p_camera[0] += [0.3, 0.0, 0.0]
        smoother.update(step, seen, np.array(rows), robust)
        J = np.hstack([-skew(seen.p_camera[0]), np.eye(3)])
        points.append(transform_points(T, seen.p_camera[0]))
        covariances.append(T[:3, :3] @ (GAMMA + J @ FIRST @ J.T) @ T[:3, :3].T)
    return np.array(points), np.array(covariances)


def test_without_a_loss_it_is_the_information_weighted_mean():
    smoother = started()
    points, covariances = drive(smoother, 6, robust=False)
    information = np.linalg.inv(covariances)
    cov_world = np.linalg.inv(information.sum(axis=0))
    wanted = cov_world @ np.einsum("nij,nj->i", information, points)
    np.testing.assert_allclose(smoother.positions()[1][0], wanted, atol=1e-9)
    np.testing.assert_allclose(smoother.covariances(ids(0))[0], cov_world, rtol=1e-6)


@pytest.mark.parametrize("count", [3, 8, 30, 60])
def test_with_a_loss_it_is_the_minimum_of_the_cauchy_loss(count):
    smoother = started()
    points, covariances = drive(smoother, count, outlier=1)

    def loss(p):
        squared = [r @ np.linalg.solve(C, r) for r, C in zip(points - p, covariances, strict=True)]
        return 0.5 * np.sum(np.log1p(squared))

    wanted = minimize(loss, smoother.positions()[1][0], tol=1e-12).x
    np.testing.assert_allclose(smoother.positions()[1][0], wanted, atol=5e-4)
    assert np.linalg.norm(points.mean(axis=0) - wanted) > 1e-3


def test_a_looser_loss_trusts_outliers_more():
    def off(k):
        smoother = started(k)
        drive(smoother, 6, outlier=3)
        return np.linalg.norm(smoother.positions()[1][0] - POINTS[0])

    assert off(100.0) > 1.5 * off(0.5)


def test_estimates_are_as_far_off_as_they_say():
    """Normalised errors of a landmark over many drives are chi-square with 3 degrees of freedom."""
    squared = []
    for seed in range(200):
        rng, smoother = np.random.default_rng(seed), started()
        first = T_WORLD_FIRST @ exp(rng.multivariate_normal(np.zeros(6), FIRST))
        for k in range(4):
            smoother.update(None, measured(first, (seed, k)), ids(0), robust=False)
        error = smoother.positions()[1][0] - POINTS[0]
        squared.append(error @ np.linalg.solve(smoother.covariances(ids(0))[0], error))
    assert 2.4 < np.mean(squared) < 3.6  # 3 expected, standard deviation of the mean 0.17


def test_an_absolute_pose_is_taken_as_it_is():
    smoother = started()
    poses = tiny_trajectory(4)
    drifting = exp([0.01, 0.0, 0.0, 0.02, 0.0, 0.0])
    for k in range(1, 4):
        motion = Motion(inverse(poses[k - 1]) @ poses[k] @ drifting, MOTION, T_world_camera=poses[k])
        np.testing.assert_allclose(smoother.predict(motion).T_world_camera, poses[k], atol=1e-12)
        smoother.update(motion, measured(poses[k], k, rows=()), ids())
    np.testing.assert_allclose(smoother.poses(), poses, atol=1e-12)


def test_a_pose_that_is_only_a_guess_hardly_counts():
    smoother = started()
    drive(smoother, 3)
    before, variance = smoother.positions()[1][0], np.trace(smoother.covariances(ids(0))[0])
    lost = Motion(exp([0, 0, 0, 0.2, 0, 0]), 0.25 * np.eye(6), status="lost")
    estimate = smoother.update(lost, measured(tiny_trajectory(3)[2], 9), ids(0), robust=False)
    assert np.linalg.norm(smoother.positions()[1][0] - before) < 0.002
    assert np.trace(smoother.covariances(ids(0))[0]) > 0.97 * variance
    np.testing.assert_allclose(estimate.covariance, FIRST + 0.25 * np.eye(6))
    found = smoother.update(Motion(np.eye(4), MOTION), measured(T_WORLD_FIRST, 0, rows=()), ids())
    np.testing.assert_allclose(found.covariance, FIRST)


def test_predicted_covariance_is_the_pose_carried_on_plus_the_motion_and_independent_of_landmarks():
    smoother = started()
    drive(smoother, 3, rows=(0, 2))
    T = exp([0.3, -0.2, 0.4, 0.2, 0.1, -0.3])
    joint = smoother.predict(Motion(T, MOTION)).joint_covariance(ids(2, 0))
    lever = 1.0 + np.linalg.norm(T[:3, 3]) ** 2
    assert 1e-6 < np.trace(joint[:6, :6] - MOTION) / 6 < 1e-6 * lever
    np.testing.assert_allclose(joint[6:9, 6:9], smoother.covariances(ids(2))[0])
    np.testing.assert_allclose(joint[9:, 9:], smoother.covariances(ids(0))[0])
    assert not joint[:6, 6:].any()
    assert not joint[6:9, 9:].any()


def test_long_seen_landmarks_are_close_to_what_all_weights_found_anew_give():
    smoother = started()
    for k in range(300):
        seen = measured(T_WORLD_FIRST, k, rows=(0, 1))
        seen.p_camera[k % 2] += [0.3 * (k % 5 == 0), 0.0, 0.0]
        smoother.update(None, seen, ids(0, 1))
    before, sure = smoother.positions()[1], smoother.covariances(ids(0, 1))
    for landmark_id in (0, 1):
        smoother.split(landmark_id, 7, np.arange(100))
        smoother.merge(landmark_id, 7)
    np.testing.assert_allclose(smoother.positions()[1], before, atol=5e-4)
    np.testing.assert_allclose(smoother.covariances(ids(0, 1)), sure, rtol=0.05)
    np.testing.assert_allclose(before, POINTS[:2], atol=0.01)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from([0.0, 0.02, 0.3]), min_size=2, max_size=16), st.integers(0, 1000), st.data())
def test_split_then_merge_leaves_everything_where_it_was(offsets, seed, data):
    smoother, rng = started(), np.random.default_rng(seed)
    for offset_m in offsets:
        seen = measured(T_WORLD_FIRST, rng.integers(1 << 30), rows=(0, 1))
        seen.p_camera[0, 0] += offset_m
        smoother.update(None, seen, ids(5, 6), robust=bool(rng.random() < 0.8))
    before, sure = smoother.positions()[1], smoother.covariances(ids(5, 6))
    picked = data.draw(st.sets(st.integers(0, len(offsets) - 1), min_size=1, max_size=len(offsets) - 1))
    smoother.split(5, 2, np.array(sorted(picked)))
    assert smoother.positions()[0].tolist() == [2, 5, 6]
    smoother.merge(5, 2)
    np.testing.assert_allclose(smoother.positions()[1], before, atol=1e-6)
    np.testing.assert_allclose(smoother.covariances(ids(5, 6)), sure, rtol=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.booleans(), min_size=2, max_size=14).filter(lambda own: 0 < sum(own) < len(own)), st.booleans())
def test_split_is_as_if_it_had_been_two_from_the_start(own, robust):
    whole, apart = started(), started()
    for k, stays in enumerate(own):
        seen = measured(T_WORLD_FIRST, k, rows=(0 if stays else 1,))
        whole.update(None, seen, ids(3), robust)
        apart.update(None, seen, ids(3 if stays else 8), robust)
    whole.split(3, 8, np.flatnonzero(~np.array(own)))
    assert whole.positions()[0].tolist() == [3, 8]
    np.testing.assert_allclose(whole.positions()[1], apart.positions()[1], atol=1e-9)
    np.testing.assert_allclose(whole.covariances(ids(3, 8)), apart.covariances(ids(3, 8)), rtol=1e-6)


@pytest.mark.parametrize("count", [3, 19, 38])
def test_two_measurements_of_one_landmark_in_a_keyframe_both_count(count):
    at_once, one_by_one = started(), started()
    for k in range(count):
        seen = measured(T_WORLD_FIRST, k, rows=(0, 2, 0))
        at_once.update(None, seen, ids(5, 3, 5), robust=False)
        for row, landmark_id in enumerate((5, 3, 5)):
            one_by_one.update(None, seen[np.array([row])], ids(landmark_id), robust=False)
    np.testing.assert_allclose(at_once.positions()[1], one_by_one.positions()[1], atol=1e-9)
    np.testing.assert_allclose(at_once.covariances(ids(3, 5)), one_by_one.covariances(ids(3, 5)), rtol=1e-6)


def test_rename_keeps_place_and_measurements():
    smoother = started()
    drive(smoother, 6, rows=(0, 1))
    where, sure = smoother.positions()[1], smoother.covariances(ids(0, 1))
    smoother.rename(0, 9)
    assert smoother.positions()[0].tolist() == [1, 9]
    np.testing.assert_array_equal(smoother.positions()[1], where[::-1])
    np.testing.assert_array_equal(smoother.covariances(ids(9, 1)), sure)
    smoother.split(9, 0, np.arange(5))
    for call in (lambda: smoother.rename(9, 1), lambda: smoother.rename(77, 3), lambda: smoother.merge(1, 1), lambda: smoother.remove(77)):
        with pytest.raises(UnknownLandmarkError):
            call()
    assert smoother.positions()[0].tolist() == [0, 1, 9]


def test_priors_of_a_continued_map_stay_with_the_old_id_through_merges():
    old = tiny_landmarks()
    smoother = GivenPosesSmoother()
    smoother.start(T_WORLD_FIRST, FIRST, old)
    first, second = (int(i) for i in old.ids[:2])
    for _ in range(2):
        smoother.update(None, tiny_observations(old.p_world[2:4], ("cup",) * 2), ids(first, second), robust=False)
    smoother.merge(first, second)  # two priors, then four measurements
    smoother.split(first, 99, ids(0, 1))
    smoother.split(first, 100, ids(0, 1))
    rows = dict(zip(*(part.tolist() for part in smoother.positions()), strict=True))
    np.testing.assert_allclose(rows[99], old.p_world[2], atol=1e-6)
    np.testing.assert_allclose(rows[100], old.p_world[3], atol=1e-6)
    np.testing.assert_allclose(rows[first], old.p_world[:2].mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(smoother.covariances(ids(first))[0], old.cov_world[0] / 2, rtol=1e-6)


def test_what_it_returns_can_be_written_to():
    smoother = started()
    drive(smoother, 3)
    wanted = smoother.positions()[1], smoother.poses(), smoother.covariances(ids(0))
    estimate = smoother.predict(Motion(np.eye(4), MOTION))
    for array in (*smoother.positions(), smoother.covariances(ids(0)), estimate.T_world_camera):
        array[:] = 0
    for got, was in zip((smoother.positions()[1], smoother.poses(), smoother.covariances(ids(0))), wanted, strict=True):
        np.testing.assert_array_equal(got, was)


def test_poses_are_given_out_without_a_copy_and_stay_as_they_are():
    smoother, poses = started(), tiny_trajectory(8)
    steps = [Motion(np.eye(4), MOTION, T_world_camera=poses[k % 8]) for k in range(100)]
    given_out = [smoother.poses()]
    for step in steps:
        smoother.update(step, measured(step.T_world_camera, 0, rows=()), ids())
        given_out.append(smoother.poses())
    wanted = np.array([T_WORLD_FIRST, *(step.T_world_camera for step in steps)])
    for count, got in enumerate(given_out, start=1):
        np.testing.assert_array_equal(got, wanted[:count])
    assert np.shares_memory(given_out[-2], given_out[-1])
    with pytest.raises(ValueError, match="read-only"):
        given_out[-1][0] = 0.0


def test_what_is_no_covariance_is_refused_and_changes_nothing():
    with pytest.raises(FrameError, match="first camera"):
        GivenPosesSmoother().start(T_WORLD_FIRST, np.zeros((6, 6)))
    smoother = started()
    with pytest.raises(FrameError, match="motion from odometry"):
        smoother.update(Motion(np.eye(4), -MOTION), measured(T_WORLD_FIRST, 0), ids(0))
    flat = replace(measured(T_WORLD_FIRST, 0), cov_camera=np.zeros((1, 3, 3)))
    with pytest.raises(FrameError, match="cov_camera"):
        smoother.update(Motion(np.eye(4), MOTION), flat, ids(0))
    assert smoother.poses().shape == (1, 4, 4)
    assert smoother.positions()[1].shape == (0, 3)


def test_it_starts_once_and_first():
    smoother = GivenPosesSmoother()
    for call in (lambda: smoother.predict(Motion(np.eye(4), MOTION)), lambda: smoother.update(None, measured(T_WORLD_FIRST, 0), ids(0))):
        with pytest.raises(OptimizationError, match="not been started"):
            call()
    smoother.start(T_WORLD_FIRST, FIRST)
    with pytest.raises(OptimizationError, match="already"):
        smoother.start(T_WORLD_FIRST, FIRST)


def test_a_pipeline_runs_on_it_and_keeps_recorded_poses():
    made = pipeline(8, smoother="given_poses")
    for frame in frames(8):
        made.step(frame)
    result = made.result()
    np.testing.assert_allclose(result.trajectory.T_world_camera, tiny_trajectory(8), atol=1e-12)
    assert sorted(row.label for row in result.map.landmarks) == ["book", "cup"]
    for row in result.map.landmarks:
        assert np.linalg.norm(row.position_m - centre_world(row.label)) < 0.1
