import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from seo_slam.datasets.trajectory_files import (
    interpolate_pose,
    pick_trajectory,
    read_trajectory,
    usual_max_gap_s,
    write_trajectory,
)
from seo_slam.errors import DatasetError
from seo_slam.geometry import exp, require_transform
from seo_slam.records import Trajectory


def drawn(n: int, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    stamps_s = 1.3e9 + np.cumsum(rng.uniform(0.001, 0.2, n))
    return Trajectory(stamps_s, np.array([exp(rng.uniform(-3, 3, 6)) for _ in range(n)]))


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(1, 20), st.integers(0, 10_000))
def test_what_was_written_is_read_back(tmp_path, n, seed):
    trajectory = drawn(n, seed)
    write_trajectory(tmp_path / "t.txt", trajectory)
    back = read_trajectory(tmp_path / "t.txt")
    np.testing.assert_array_equal(back.timestamps_s, trajectory.timestamps_s)
    np.testing.assert_allclose(back.T_world_camera, trajectory.T_world_camera, atol=1e-8)
    first = (tmp_path / "t.txt").read_bytes()
    write_trajectory(tmp_path / "t.txt", trajectory)
    assert (tmp_path / "t.txt").read_bytes() == first


@pytest.mark.parametrize("stamp", [0.0, 1e-7, 12.5, 1305031102.175304, 1.7e18])
def test_stamps_are_never_written_with_an_exponent(tmp_path, stamp):
    write_trajectory(tmp_path / "t.txt", Trajectory(np.array([stamp]), np.eye(4)[None]))
    assert "e" not in (tmp_path / "t.txt").read_text().splitlines()[1]
    assert read_trajectory(tmp_path / "t.txt").timestamps_s[0] == stamp


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["# header", "1 0 0 0 0 0 0 1", "2 0 0 0 0 0 1"], r":3: got 7 columns, wanted 8 \(timestamp tx ty tz qx qy qz qw\)"),
        (["1 0 0 0 0 0 0 1", "2 0 zero 0 0 0 0 1"], ":2: 'zero' is not a number"),
        (["1 0 0 0 0 0 0 1", "", "2 nan 0 0 0 0 0 1"], ":3: got nan, wanted finite"),
        (["1 0 0 0 0 0 0 1", "2 0 0 0 0 inf 0 1"], ":2: got inf"),
        (["1 0 0 0 0 0 0 1.2"], ":1: quaternion .* has norm 1.2"),
        (["1 0 0 0 0 0 0 0"], ":1: quaternion .* has norm 0"),
        (["1 0 0 0 0 0 0 1", "3 0 0 0 0 0 0 1", "2 0 0 0 0 0 0 1"], ":3: time goes backwards, from 3.000000 to 2.000000"),
        (["# nothing"], "holds no poses"),
    ],
)
def test_a_bad_line_is_named(tmp_path, lines, message):
    (tmp_path / "groundtruth.txt").write_text("\n".join(lines))
    with pytest.raises(DatasetError, match=f"groundtruth.txt.*{message}"):
        read_trajectory(tmp_path / "groundtruth.txt")


def test_a_file_that_is_missing_or_no_text_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"nowhere.txt: cannot be read: No such file"):
        read_trajectory(tmp_path / "nowhere.txt")
    (tmp_path / "noise.txt").write_bytes(b"\xff\xfe\x00\x81" * 20)
    with pytest.raises(DatasetError, match=r"noise.txt: not a text file"):
        read_trajectory(tmp_path / "noise.txt")
    with pytest.raises(DatasetError, match="cannot be written"):
        write_trajectory(tmp_path / "no" / "folder.txt", drawn(2, 0))


def test_a_rounded_quaternion_is_normalised_and_a_repeated_stamp_counts_once(tmp_path):
    (tmp_path / "t.txt").write_text("1,0,0,0,0.7070,0,0,0.7070\n1 9 9 9 0 0 0 1\n2 1 0 0 0 0 0 1\n")
    trajectory = read_trajectory(tmp_path / "t.txt")
    np.testing.assert_array_equal(trajectory.timestamps_s, [1, 2])
    np.testing.assert_array_equal(trajectory.T_world_camera[0, :3, 3], [0, 0, 0])
    R = trajectory.T_world_camera[0, :3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)


def test_every_published_trajectory_is_read(shared):
    lengths = {file.name: len(read_trajectory(file)) for file in sorted((shared / "data/trajectories").glob("*.txt"))}
    assert lengths["freiburg1_xyz-groundtruth.txt"] == 3000
    assert lengths["fr2_desk_groundtruth.txt"] > 20_000  # it repeats stamps
    assert lengths["fr2_desk_ORB.txt"] == 2893


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0, 1))
def test_an_interpolated_pose_lies_between_its_neighbours(seed, share):
    trajectory = drawn(4, seed)
    a, b = trajectory.timestamps_s[1:3]
    T = interpolate_pose(trajectory, a + share * (b - a), max_gap_s=1.0)
    require_transform(T, "T", tolerance=1e-9)
    lo = trajectory.T_world_camera[1:3, :3, 3].min(axis=0) - 1e-9
    hi = trajectory.T_world_camera[1:3, :3, 3].max(axis=0) + 1e-9
    assert ((lo <= T[:3, 3]) & (T[:3, 3] <= hi)).all()


def test_no_pose_outside_and_in_gaps():
    trajectory = Trajectory(np.array([1.0, 1.1, 3.0]), np.tile(np.eye(4), (3, 1, 1)))
    for t, known in ((0.99, False), (1.0, True), (1.05, True), (1.1, True), (2.0, False), (3.0, True), (3.01, False)):
        assert (interpolate_pose(trajectory, t, max_gap_s=0.5) is not None) == known, t
    assert interpolate_pose(trajectory, 2.0, max_gap_s=2.0) is not None


def test_usual_gap_follows_the_rate():
    assert usual_max_gap_s(Trajectory(np.arange(10) / 100, np.tile(np.eye(4), (10, 1, 1)))) == 0.25
    assert usual_max_gap_s(Trajectory(np.arange(10.0), np.tile(np.eye(4), (10, 1, 1)))) == 2.5
    assert usual_max_gap_s(Trajectory(np.zeros(1), np.eye(4)[None])) == 0.25


def test_odometry_is_taken_before_ground_truth_and_an_explicit_file_before_both(tmp_path):
    assert pick_trajectory(tmp_path) is None
    for name in ("groundtruth.txt", "odometry.txt"):
        (tmp_path / name).write_text("0 0 0 0 0 0 0 1\n")
        assert pick_trajectory(tmp_path) == tmp_path / name
    (tmp_path / "mine.txt").write_text("")
    assert pick_trajectory(tmp_path, tmp_path / "mine.txt") == tmp_path / "mine.txt"
    with pytest.raises(DatasetError, match=r"absent.txt: no such trajectory"):
        pick_trajectory(tmp_path, tmp_path / "absent.txt")
