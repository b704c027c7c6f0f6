import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.camera import Camera
from seo_slam.datasets.trajectory_files import interpolate_pose, write_trajectory
from seo_slam.datasets.tum import TumDataset
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.geometry import exp, inverse, so3_log
from seo_slam.interfaces import Odometry
from seo_slam.records import Trajectory
from seo_slam.registry import create
from seo_slam.types import Frame

TINY = Camera(10.0, 10.0, 1.5, 1.0, 4, 3)


def frame(t):
    return Frame(t, np.zeros((3, 4, 3), dtype=np.uint8), np.zeros((3, 4), dtype=np.float32), TINY)


def walk(stamps_s, seed=0):
    rng = np.random.default_rng(seed)
    T, poses = exp(rng.uniform(-1, 1, 6)), []
    for _ in stamps_s:
        T = T @ exp(rng.normal(0, 0.05, 6))
        poses.append(T)
    return Trajectory(np.array(stamps_s, dtype=float), np.array(poses))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.lists(st.floats(-0.5, 3.5), min_size=2, max_size=25, unique=True))
def test_chained_motions_end_at_the_recorded_pose_whatever_was_lost_between(seed, stamps_s):
    trajectory = walk([0, 0.1, 0.2, 1.0, 1.1, 1.2, 2.4, 2.5, 3.0], seed)
    odometry = RecordedOdometry(trajectory, max_gap_s=0.3)
    T = None
    for t in sorted(stamps_s):
        motion = odometry.update(frame(t))
        T = motion.T_world_camera if T is None else T @ motion.T_previous_current
        known = interpolate_pose(trajectory, t, 0.3)
        assert (motion.status == "ok") == (known is not None)
        assert motion.T_world_camera is not None
        if known is None:
            np.testing.assert_array_equal(motion.T_previous_current, np.eye(4))
        else:
            np.testing.assert_allclose(T, known, atol=1e-9)
        np.testing.assert_allclose(T, motion.T_world_camera, atol=1e-9)


def test_noise_is_that_of_two_poses_and_of_the_way_between_them():
    T = exp([0, 0, np.radians(10), 0, 0, 0])
    T[:3, 3] = [0.3, 0.4, 0]
    odometry = RecordedOdometry(Trajectory(np.array([0.0, 0.1]), np.array([np.eye(4), T])), 0.003, 0.2, 0.04, 0.6)
    first, second = odometry.update(frame(0.0)), odometry.update(frame(0.1))
    np.testing.assert_allclose(np.sqrt(np.diag(first.covariance)), [np.radians(0.2)] * 3 + [0.003] * 3)
    np.testing.assert_array_equal(first.T_previous_current, np.eye(4))
    wanted = [np.radians(np.hypot(0.2, 0.6 * np.sqrt(0.5)))] * 3 + [np.hypot(0.003, 0.04 * np.sqrt(0.5))] * 3
    np.testing.assert_allclose(np.sqrt(np.diag(second.covariance)), wanted)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=8))
def test_a_way_is_as_uncertain_in_one_step_as_in_many(steps_m):
    """Straight ahead; only the noise of the poses comes again with every step."""

    def variances(ends_m):
        poses = np.array([exp([0, 0, 0, x, 0, 0]) for x in [0.0, *ends_m]])
        odometry = RecordedOdometry(Trajectory(np.arange(len(poses), dtype=float), poses), sigma_m=1e-9, sigma_deg=1e-9, max_gap_s=2)
        return sum(np.diag(odometry.update(frame(float(k))).covariance) for k in range(len(poses)))

    ends_m = np.cumsum(steps_m)
    np.testing.assert_allclose(variances(ends_m), variances(ends_m[-1:]), rtol=1e-6)


@pytest.mark.parametrize(
    ("t", "why", "held"),
    [(-1.0, "the first one is at 0.000 s", 0), (5.0, "the last one is at 2.000 s", 2), (1.0, "0.100 and 2.000 s are 1.900 s apart", 1)],
)
def test_lost_says_why_and_how_poorly_it_knows(t, why, held):
    trajectory = walk([0.0, 0.1, 2.0])
    motion = RecordedOdometry(trajectory, max_gap_s=0.5).update(frame(t))
    assert motion.status == "lost"
    assert why in motion.message
    np.testing.assert_allclose(motion.T_world_camera, trajectory.T_world_camera[held], atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(motion.covariance)), [np.radians(30)] * 3 + [0.5] * 3)


def test_a_real_recording_is_replayed_without_a_lost_frame(shared):
    recording = TumDataset(shared / "data/tum_fr1_xyz", stride=10)
    odometry = RecordedOdometry(recording.groundtruth)
    motions = [odometry.update(frame(pair.timestamp_s)) for pair in recording.pairs]
    assert {motion.status for motion in motions} == {"ok"}
    T = motions[0].T_world_camera
    for motion in motions[1:]:
        T = T @ motion.T_previous_current
    end = inverse(T) @ interpolate_pose(odometry.trajectory, recording.pairs[-1].timestamp_s, 0.25)
    assert np.linalg.norm(end[:3, 3]) < 1e-9
    assert np.linalg.norm(so3_log(end[:3, :3])) < 1e-9


def test_it_is_made_by_name_from_a_file(tmp_path):
    write_trajectory(tmp_path / "t.txt", walk([0, 1]))
    odometry = create("odometry", "recorded", trajectory=tmp_path / "t.txt")
    assert isinstance(odometry, Odometry)
    assert odometry.update(frame(0.5)).status == "ok"


def test_bad_input_is_refused(tmp_path):
    for name in ("sigma_m", "sigma_deg", "lost_sigma_m", "lost_sigma_deg", "max_gap_s"):
        with pytest.raises(ConfigError, match=f"{name}: got 0, wanted above 0"):
            RecordedOdometry(walk([0, 1]), **{name: 0})
    for name in ("walk_m", "walk_deg"):
        with pytest.raises(ConfigError, match=f"{name} -1"):
            RecordedOdometry(walk([0, 1]), **{name: -1})
    with pytest.raises(ConfigError, match="holds no poses"):
        RecordedOdometry(Trajectory(np.zeros(0), np.zeros((0, 4, 4))))
    with pytest.raises(DatasetError, match="nowhere"):
        RecordedOdometry(tmp_path / "nowhere.txt")
