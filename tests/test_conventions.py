"""docs/conventions.md, tested once: GTSAM and scipy are the witnesses."""

import gtsam
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from seo_slam import geometry
from seo_slam.camera import Camera
from seo_slam.datasets.trajectory_files import read_trajectory, write_trajectory
from seo_slam.records import Trajectory

tangents = st.lists(st.floats(-1.5, 1.5, allow_nan=False), min_size=6, max_size=6).map(np.array)
laws = settings(max_examples=40, deadline=None)


@laws
@given(tangents)
def test_tangent_vectors_have_their_rotation_first_as_in_gtsam(xi):
    np.testing.assert_allclose(geometry.exp(xi), gtsam.Pose3.Expmap(xi).matrix(), atol=1e-9)
    np.testing.assert_allclose(geometry.log(geometry.exp(xi)), gtsam.Pose3.Logmap(gtsam.Pose3.Expmap(xi)), atol=1e-7)


@laws
@given(tangents, tangents)
def test_perturbations_act_on_the_right_as_in_gtsam(xi, delta):
    T = geometry.exp(xi)
    np.testing.assert_allclose(T @ geometry.exp(delta), gtsam.Pose3(T).retract(delta).matrix(), atol=1e-9)
    np.testing.assert_allclose(geometry.adjoint(T), gtsam.Pose3(T).AdjointMap(), atol=1e-9)
    np.testing.assert_allclose(T @ geometry.exp(delta), geometry.exp(geometry.adjoint(T) @ delta) @ T, atol=1e-8)


def test_first_three_numbers_turn_and_last_three_move():
    turn = geometry.exp([0, 0, np.pi / 2, 0, 0, 0])
    np.testing.assert_allclose(geometry.transform_points(turn, [1.0, 0, 0]), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(geometry.exp([0, 0, 0, 1, 2, 3])[:3, 3], [1, 2, 3])


@laws
@given(tangents)
def test_transforms_map_the_second_frame_to_the_first(xi):
    T_world_camera = geometry.exp(xi)
    p_camera = np.array([[0.1, 0.2, 2.0]])
    p_world = (T_world_camera @ np.array([0.1, 0.2, 2.0, 1.0]))[:3]
    np.testing.assert_allclose(geometry.transform_points(T_world_camera, p_camera), [p_world], atol=1e-12)


@laws
@given(tangents)
def test_quaternions_are_wxyz(xi):
    R = geometry.exp(xi)[:3, :3]
    q_wxyz = geometry.quaternion_from_rotation(R)
    x, y, z, w = Rotation.from_matrix(R).as_quat(canonical=True)
    np.testing.assert_allclose(np.abs(q_wxyz @ [w, x, y, z]), 1.0, atol=1e-9)
    np.testing.assert_allclose(geometry.rotation_from_quaternion(q_wxyz), R, atol=1e-9)


def test_tum_files_are_xyzw(tmp_path):
    file = tmp_path / "trajectory.txt"
    write_trajectory(file, Trajectory(np.array([1.0]), geometry.exp([0.6, 0, 0, 1, 2, 3])[None]))
    row = np.loadtxt(file)
    np.testing.assert_allclose(row[4:], [np.sin(0.3), 0, 0, np.cos(0.3)], atol=1e-8)
    np.testing.assert_allclose(read_trajectory(file).T_world_camera[0], geometry.exp([0.6, 0, 0, 1, 2, 3]), atol=1e-8)


def test_the_camera_looks_along_z_with_x_right_and_y_down():
    camera = Camera(fx=500.0, fy=500.0, cx=320.0, cy=240.0, width=640, height=480)
    pixels = camera.project(np.array([[0, 0, 2.0], [0.2, 0, 2.0], [0, 0.2, 2.0]]))
    np.testing.assert_allclose(pixels, [[320, 240], [370, 240], [320, 290]])
