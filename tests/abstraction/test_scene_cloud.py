"""The scene cloud: which frames it takes, what it keeps, and how it follows a loop closure."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from seo_slam.abstraction.scene_cloud import SceneCloud
from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.geometry import exp, transform_points
from seo_slam.settings.planning import LayoutSettings

CAMERA = Camera(60.0, 60.0, 39.5, 29.5, 80, 60)
ALL = LayoutSettings(move_m=0.25, turn_deg=10.0, new_share=0.0)


def looking_down(x, y, z=1.2, pitch_rad=0.7, yaw_rad=0.0):
    """Pose of a camera that looks along yaw and down by pitch."""
    forward = np.array([np.cos(yaw_rad) * np.cos(pitch_rad), np.sin(yaw_rad) * np.cos(pitch_rad), -np.sin(pitch_rad)])
    right = np.array([np.sin(yaw_rad), -np.cos(yaw_rad), 0.0])
    T = np.eye(4)
    T[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    T[:3, 3] = x, y, z
    return T


def floor_depth(T, z_m=0.0):
    """(60, 80) depth of the floor z = z_m; 0 above the horizon."""
    rays = np.concatenate([CAMERA.rays(), np.ones((60, 80, 1))], axis=2) @ T[:3, :3].T
    depth = np.where(rays[..., 2] < -0.05, (z_m - T[2, 3]) / np.minimum(rays[..., 2], -0.05), 0.0)
    return depth.astype(np.float32)


def walk(cloud, count=40, step=0.1):
    return [cloud.add(floor_depth(T), CAMERA, T) for T in (looking_down(step * k, 0.0) for k in range(count))]


def test_frames_are_taken_when_the_camera_has_moved_or_turned_enough():
    assert walk(SceneCloud(ALL), 10) == [k % 3 == 0 for k in range(10)]
    cloud = SceneCloud(ALL)
    turned = [cloud.add(floor_depth(T), CAMERA, T) for T in (looking_down(0, 0, yaw_rad=np.radians(4.0 * k)) for k in range(7))]
    assert turned == [True, False, False, True, False, False, True]


def test_the_points_lie_where_they_were_seen_one_a_cube():
    cloud = SceneCloud(ALL)
    for T in (looking_down(0.3 * k, 0.0, 1.21) for k in range(4)):
        cloud.add(floor_depth(T, 0.01), CAMERA, T)
    points = cloud.voxels().p_world
    assert np.abs(points[:, 2] - 0.01).max() < 1e-5
    assert len(points) == len(np.unique(np.floor(points[:, :2] / 0.05), axis=0))


def test_pixels_without_depth_and_far_ones_are_left_out():
    cloud = SceneCloud(LayoutSettings(farthest_m=2.0))
    depth = np.full((60, 80), 3.0, dtype=np.float32)
    depth[:30] = 1.0
    depth[0] = 0.0
    depth[1] = np.nan
    assert cloud.add(depth, CAMERA, np.eye(4))
    assert set(np.round(cloud.voxels().p_world[:, 2], 4)) == {1.0}
    assert cloud._known.share_of_new(np.array([[0.0, 0.0, 3.0]])) == 1.0
    assert not SceneCloud().add(np.zeros((60, 80), dtype=np.float32), CAMERA, np.eye(4))


def test_memory_does_not_grow_with_time_but_with_space():
    cloud = SceneCloud(LayoutSettings(move_m=0.25, turn_deg=10.0))
    kept = []
    for _ in range(12):
        walk(cloud, 30)
        kept.append(len(cloud))
    assert kept[0] == 10
    assert kept[-1] - kept[-4] <= 3  # of 30; the rest is known by now


def test_a_loop_closure_moves_the_cloud():
    cloud = SceneCloud(ALL)
    for key, T in ((10, looking_down(0, 0)), (20, looking_down(1, 0))):
        cloud.add(floor_depth(T), CAMERA, T, key=key)
    moved = exp([0.0, 0.0, 0.5, 3.0, 1.0, 0.2])
    new = {10: moved @ looking_down(0, 0), 20: moved @ looking_down(1, 0)}
    before, after = transform_points(moved, cloud.voxels().p_world), cloud.voxels(new).p_world
    assert cKDTree(after).query(before)[0].max() < 0.09  # other cubes, other means
    np.testing.assert_allclose(cloud.way_world(new), transform_points(moved, cloud.way_world()), atol=1e-9)
    assert cloud.layout(new).floor.sum() == pytest.approx(cloud.layout().floor.sum(), rel=0.1)
    only_one = cloud.voxels({20: new[20]}).p_world
    assert np.abs(only_one[:, 2]).min() < 1e-3  # the frame without a new pose stayed


def test_the_same_frames_give_the_same_layout():
    layouts = []
    for _ in range(2):
        cloud = SceneCloud(ALL)
        walk(cloud)
        layouts.append(cloud.layout())
    assert np.array_equal(layouts[0].floor, layouts[1].floor)
    assert layouts[0].floor.sum() > 500
    assert not layouts[0].obstacles.any()


def test_an_empty_cloud_has_an_empty_layout():
    cloud = SceneCloud()
    assert len(cloud.voxels().p_world) == 0
    assert not cloud.layout().floor.any()


def test_bad_input():
    cloud = SceneCloud()
    with pytest.raises(FrameError, match="depth_m"):
        cloud.add(np.zeros((3, 3), dtype=np.float32), CAMERA, np.eye(4))
    with pytest.raises(FrameError, match="T_world_camera"):
        cloud.add(np.zeros((60, 80), dtype=np.float32), CAMERA, np.full((4, 4), np.nan))
    assert len(cloud) == 0
