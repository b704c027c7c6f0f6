"""Protocols ape/1 and rpe/1: against published trajectories, and their laws."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam import geometry
from seo_slam.datasets.trajectory_files import read_trajectory
from seo_slam.errors import EvaluationError
from seo_slam.evaluation.trajectory import align, align_points, ape, associate_poses, rpe
from seo_slam.records import Trajectory


def wavy(n=60, period_s=0.05, start_s=100.0):
    t = np.arange(n) * period_s
    poses = np.array([geometry.exp([0.2 * np.sin(s), 0.3 * s, 0.1, np.cos(s), 0.5 * s, np.sin(2 * s)]) for s in t])
    return Trajectory(start_s + t, poses)


def moved(trajectory, T):
    return Trajectory(trajectory.timestamps_s, T @ trajectory.T_world_camera)


# The reference values are those of evo 1.38 (evo_ape tum GT EST -a --sync_method interpolation --t_max_diff 0.02). evo's default,
# the nearest true stamp instead of interpolation, gives 0.008146 (2225 poses) and 0.013473 (786): up to 0.4 % more or less,
# the distance the camera moves in half a period of the motion capture.
@pytest.mark.parametrize(
    ("estimate", "truth", "compared", "estimates", "rmse", "mean", "median", "largest"),
    [
        ("fr2_desk_ORB.txt", "fr2_desk_groundtruth.txt", 2225, 2893, 0.008114, 0.007491, 0.007444, 0.024525),
        ("freiburg1_xyz-rgbdslam.txt", "freiburg1_xyz-groundtruth.txt", 786, 788, 0.013470, 0.012031, 0.011116, 0.035184),
    ],
)
def test_ape_of_published_trajectories(shared, estimate, truth, compared, estimates, rmse, mean, median, largest):
    folder = shared / "data/trajectories"
    result = ape(read_trajectory(folder / estimate), read_trajectory(folder / truth))
    assert result.protocol == "ape/1"
    assert (result.compared, result.estimates) == (compared, estimates)
    found = [result.rmse_m, result.mean_m, result.median_m, result.max_m]
    np.testing.assert_allclose(found, [rmse, mean, median, largest], atol=6e-7)


def test_rpe_of_a_published_trajectory(shared):
    # evo_rpe -d 10 -u f --all_pairs, which takes the nearest true stamp, gives rmse 0.014041 and max 0.048023.
    folder = shared / "data/trajectories"
    estimate = read_trajectory(folder / "freiburg1_xyz-rgbdslam.txt")
    result = rpe(estimate, read_trajectory(folder / "freiburg1_xyz-groundtruth.txt"), step_frames=10)
    assert result.rmse_m == pytest.approx(0.014041, rel=0.01)
    assert result.max_m == pytest.approx(0.048023, rel=0.02)


motions = st.lists(st.floats(-2.5, 2.5, allow_nan=False), min_size=6, max_size=6)


@settings(max_examples=30, deadline=None)
@given(motions, st.integers(0, 1000))
def test_ape_does_not_change_with_a_rigid_motion_of_the_estimate(xi, seed):
    truth = wavy()
    noise = np.random.default_rng(seed).normal(0, 0.02, (len(truth), 3))
    poses = truth.T_world_camera.copy()
    poses[:, :3, 3] += noise
    estimate = Trajectory(truth.timestamps_s, poses)
    T = geometry.exp(xi)
    first, second = ape(estimate, truth), ape(moved(estimate, T), truth)
    np.testing.assert_allclose(second.errors_m, first.errors_m, atol=1e-9)
    np.testing.assert_allclose(second.T_truth_estimate @ T, first.T_truth_estimate, atol=1e-7)


@settings(max_examples=30, deadline=None)
@given(motions)
def test_alignment_finds_the_motion_and_never_a_mirror(xi):
    truth, T = wavy(), geometry.exp(xi)
    found = align(moved(truth, geometry.inverse(T)), truth)
    np.testing.assert_allclose(found, T, atol=1e-8)
    mirrored = truth.T_world_camera[:, :3, 3] * [1, 1, -1]
    assert np.linalg.det(align_points(mirrored, truth.T_world_camera[:, :3, 3])[:3, :3]) == pytest.approx(1.0)


def test_alignment_does_not_scale():
    truth = wavy()
    poses = truth.T_world_camera.copy()
    poses[:, :3, 3] *= 2
    assert ape(Trajectory(truth.timestamps_s, poses), truth).rmse_m > 0.3


def test_truth_is_interpolated_at_the_stamps_of_the_estimate():
    t = np.array([0.0, 0.1, 0.2])
    poses = np.array([geometry.exp([0, 0, s, 3 * s, 0, 0]) for s in t])
    poses[:, :3, 3] = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    pairs = associate_poses(Trajectory(np.array([0.01, 0.115]), poses[:2]), Trajectory(t, poses))
    np.testing.assert_allclose(pairs.T_truth[:, :3, 3], [[0.1, 0, 0], [1, 0.15, 0]], atol=1e-12)
    np.testing.assert_allclose(geometry.so3_log(pairs.T_truth[1, :3, :3]), [0, 0, 0.115], atol=1e-12)


def test_only_poses_inside_the_truth_and_near_a_true_stamp_are_compared():
    truth = Trajectory(np.array([1.0, 1.1, 2.0]), np.tile(np.eye(4), (3, 1, 1)))
    stamps = np.array([0.99, 1.0, 1.019, 1.05, 1.08, 1.5, 1.99, 2.0, 2.01])
    pairs = associate_poses(Trajectory(stamps, np.tile(np.eye(4), (9, 1, 1))), truth)
    assert pairs.timestamps_s.tolist() == [1.0, 1.019, 1.08, 1.99, 2.0]
    assert pairs.rows.tolist() == [1, 2, 4, 6, 7]


def test_a_truth_of_one_pose_is_compared_where_it_stands():
    one = Trajectory(np.array([1.0]), np.eye(4)[None])
    assert len(associate_poses(one, one)) == 1


def test_too_few_or_collinear_poses_are_refused():
    truth = wavy()
    with pytest.raises(EvaluationError, match="cannot align 2 poses"):
        ape(Trajectory(truth.timestamps_s[:2], truth.T_world_camera[:2]), truth)
    line = np.tile(np.eye(4), (len(truth), 1, 1))
    line[:, 0, 3] = np.linspace(0, 3, len(truth))
    straight = Trajectory(truth.timestamps_s, line)
    for estimate, true in ((straight, truth), (truth, straight)):
        with pytest.raises(EvaluationError, match="lie on a line"):
            ape(estimate, true)


def test_another_clock_is_named():
    with pytest.raises(EvaluationError, match=r"the estimate covers 100\.000\.\.102\.950 s, the truth 900\.000"):
        ape(wavy(), wavy(start_s=900.0))


def test_rpe_sees_drift_that_is_the_same_every_step():
    truth = wavy()
    poses = truth.T_world_camera.copy()
    for i in range(1, len(poses)):
        step = geometry.inverse(truth.T_world_camera[i - 1]) @ truth.T_world_camera[i]
        poses[i] = poses[i - 1] @ step @ geometry.exp([0, 0, 0, 0.01, 0, 0])
    estimate = Trajectory(truth.timestamps_s, poses)
    one = rpe(estimate, truth, step_frames=1)
    assert (one.rmse_m, one.max_m) == (pytest.approx(0.01), pytest.approx(0.01))
    assert one.rmse_deg == pytest.approx(0.0, abs=1e-5)
    assert one.compared == len(truth) - 1
    by_time = rpe(estimate, truth, step_s=0.05)
    assert (by_time.step, by_time.compared, by_time.rmse_m) == ("0.05 s", len(truth) - 1, pytest.approx(0.01))
    assert rpe(estimate, truth, step_s=0.5).compared == len(truth) - 10


@pytest.mark.parametrize("step", [{}, {"step_s": 1.0, "step_frames": 1}, {"step_s": -1.0}, {"step_frames": 0}])
def test_rpe_wants_one_step(step):
    with pytest.raises(EvaluationError, match="wanted one of them, above 0"):
        rpe(wavy(), wavy(), **step)


def test_rpe_longer_than_the_recording():
    with pytest.raises(EvaluationError, match="no step of 100 s"):
        rpe(wavy(), wavy(), step_s=100.0)
