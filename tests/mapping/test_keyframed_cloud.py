"""A cloud kept by keyframes: flat in memory, moved by loop closures, the same whatever comes first."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from seo_slam.errors import FrameError
from seo_slam.geometry import exp, inverse, transform_points
from seo_slam.mapping.keyframed_cloud import MOST_COUNTED, KeyframedCloud

VOXEL_M = 0.02
ROUNDING_M = 1e-6  # points are kept as float32
SEEDS = st.integers(0, 10**6)


def some_poses(rng, count):
    return np.array([exp(np.concatenate([rng.normal(0, 0.5, 3), rng.normal(0, 1, 3)])) for _ in range(count)])


def surface(rng, count=200, side_m=0.3):
    """Points of a sheet near the origin of the world."""
    return rng.uniform(-side_m / 2, side_m / 2, (count, 3)) * [1, 1, 0.1]


def cloud_of(views, poses, voxel_m=VOXEL_M):
    """The cloud of (keyframe, p_world) views."""
    cloud = KeyframedCloud(voxel_m)
    for keyframe, p_world in views:
        cloud.add(keyframe, transform_points(inverse(poses[keyframe]), p_world), poses)
    return cloud


def every_point(cloud, poses):
    """(M, 3) all points, also several of a voxel, by the poses exactly as given."""
    return np.array([transform_points(poses[k], p) for k, p in zip(cloud.keyframe, cloud.p_keyframe.astype(float), strict=True)])


def farthest_m(a, b):
    """How far any point of either is from the nearest of the other."""
    return max(cKDTree(b).query(a)[0].max(), cKDTree(a).query(b)[0].max())


def cells(p_world):
    return {tuple(cell) for cell in np.floor(p_world / VOXEL_M).astype(int).tolist()}


@settings(deadline=None)
@given(SEEDS)
def test_a_view_becomes_its_voxels_means(seed):
    rng = np.random.default_rng(seed)
    poses, p_world = some_poses(rng, 3), surface(rng)
    world = cloud_of([(1, p_world)], poses).world(poses).p_world
    at = np.floor(p_world / VOXEL_M).astype(int)
    means = [p_world[(at == cell).all(axis=1)].mean(axis=0) for cell in np.unique(at, axis=0)]
    assert farthest_m(world, np.array(means)) < ROUNDING_M


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.sampled_from([0.0, 0.02, 1.0]))
def test_the_same_view_again_changes_nothing_but_counts(seed, grid):
    rng = np.random.default_rng(seed)
    poses, p_world = some_poses(rng, 2), surface(rng)
    if grid:  # on the corners of voxels, where the last digit decides
        poses[:, :3, :3], p_world = np.eye(3), np.round(p_world / VOXEL_M) * VOXEL_M * grid
    once, cloud = cloud_of([(0, p_world)], poses), cloud_of([(0, p_world)] * 4, poses)
    assert np.array_equal(cloud.keyframe, once.keyframe)
    np.testing.assert_allclose(cloud.p_keyframe, once.p_keyframe, atol=ROUNDING_M)
    np.testing.assert_allclose(cloud.world(poses).p_world, once.world(poses).p_world, atol=ROUNDING_M)
    assert set(once.count.tolist()) == {1}
    assert set(cloud.count.tolist()) == {4}


@settings(deadline=None)
@given(SEEDS)
def test_poses_that_move_together_move_the_cloud(seed):
    rng = np.random.default_rng(seed)
    poses = some_poses(rng, 4)
    cloud = cloud_of([(k, surface(rng)) for k in range(4)], poses)
    T = exp(rng.normal(0, 1, 6))
    before, after = every_point(cloud, poses), every_point(cloud, T @ poses)
    np.testing.assert_allclose(after, transform_points(T, before), atol=1e-9)
    moved = cloud.world(T @ poses).p_world
    assert farthest_m(moved, transform_points(T, before)) < VOXEL_M * np.sqrt(3)
    assert len(moved) == len(cells(moved))


@settings(deadline=None)
@given(SEEDS)
def test_order_does_not_matter_beyond_a_voxel(seed):
    rng = np.random.default_rng(seed)
    poses = some_poses(rng, 4)
    views = [(k, surface(rng)) for k in range(4)]
    clouds = [cloud_of([views[i] for i in order], poses) for order in ((0, 1, 2, 3), (3, 1, 0, 2), (2, 3, 0, 1))]
    worlds = [cloud.world(poses).p_world for cloud in clouds]
    for world in worlds[1:]:
        np.testing.assert_allclose(np.sort(world[:, 0]), np.sort(worlds[0][:, 0]), atol=ROUNDING_M)
        assert farthest_m(world, worlds[0]) < ROUNDING_M
    assert np.array_equal(clouds[0].keyframe, clouds[1].keyframe)  # the oldest has each point, whoever comes first


def test_memory_is_flat_once_a_place_has_been_seen():
    rng = np.random.default_rng(0)
    poses = some_poses(rng, 60)
    cloud = KeyframedCloud(VOXEL_M)
    sizes = []
    for k in range(60):
        p_world = surface(rng, 2000) + rng.normal(0, 0.001, (2000, 3))
        cloud.add(k, transform_points(inverse(poses[k]), p_world), poses)
        sizes.append(cloud.keyframe.nbytes + cloud.p_keyframe.nbytes + cloud.count.nbytes)
    assert sizes[-1] <= 1.02 * sizes[29]
    assert sizes[-1] == 20 * len(cloud)
    assert len(cloud) <= 18 * 18 * 4
    assert cloud.count.max() == MOST_COUNTED


def test_a_loop_closure_brings_the_points_of_each_keyframe_along():
    rng = np.random.default_rng(1)
    poses = some_poses(rng, 2)
    p_world = surface(rng)
    drifted = poses.copy()
    drifted[1, :3, 3] += [0.5, 0, 0]  # the second keyframe saw the same, and believes that it is half a metre away
    cloud = KeyframedCloud(VOXEL_M)
    for k in range(2):
        cloud.add(k, transform_points(inverse(poses[k]), p_world), drifted)
    single = len(cloud_of([(0, p_world)], poses))
    assert len(cloud.world(drifted)) > 1.8 * single
    mended = cloud.world(poses)
    assert len(mended) < 1.5 * single
    assert farthest_m(mended.p_world, p_world) < VOXEL_M * np.sqrt(3)
    assert len(cloud) > 1.8 * single  # what is kept is folded when something is added
    cloud.add(0, transform_points(inverse(poses[0]), p_world), poses)
    assert len(cloud) < 1.5 * single


def test_world_is_the_same_object_until_a_point_may_have_moved():
    rng = np.random.default_rng(2)
    poses = some_poses(rng, 3)
    cloud = cloud_of([(0, surface(rng)), (1, surface(rng))], poses)
    first = cloud.world(poses)
    assert cloud.world(poses.copy()) is first
    unused, nudged, shifted, turned = (poses.copy() for _ in range(4))
    unused[2, :3, 3] += 1.0
    nudged[1, :3, 3] += 0.002
    shifted[1, :3, 3] += 0.004
    turned[0] = turned[0] @ exp([0.02, 0, 0, 0, 0, 0])
    assert cloud.world(unused) is first
    assert cloud.world(nudged) is first
    assert cloud.world(shifted) is not first
    assert cloud.world(poses) is not cloud.world(turned)


def test_many_small_moves_do_not_add_up_unseen():
    rng = np.random.default_rng(3)
    poses, p_world = some_poses(rng, 1), surface(rng)
    cloud = cloud_of([(0, p_world)], poses)
    for _ in range(20):
        poses = poses.copy()
        poses[0, :3, 3] += [0.002, 0, 0]
        cloud.add(0, transform_points(inverse(poses[0]), p_world[:1]), poses)  # something is added each time
    exact = every_point(cloud, poses)
    assert np.abs(cloud.world(poses).p_world.mean(axis=0) - exact.mean(axis=0)).max() < VOXEL_M / 4


def test_parts_and_their_union():
    rng = np.random.default_rng(4)
    poses = some_poses(rng, 3)
    left, right = surface(rng), surface(rng) + np.array([1.0, 0, 0])
    cloud = cloud_of([(2, left), (0, right), (1, left)], poses)
    before = every_point(cloud, poses).copy()
    is_left = before[:, 0] < 0.5
    a, b = cloud.subset(is_left), cloud.subset(np.flatnonzero(~is_left))
    assert len(a) + len(b) == len(cloud)
    assert np.array_equal(every_point(a, poses), before[is_left])
    whole = a.merged(b, poses)
    assert farthest_m(whole.world(poses).p_world, cloud.world(poses).p_world) < ROUNDING_M
    assert len(a) == is_left.sum()  # as it was
    twice = cloud.merged(cloud, poses)
    assert len(twice) == len(cloud)
    assert np.array_equal(twice.count, 2 * cloud.count)


def test_a_copy_changes_by_itself():
    rng = np.random.default_rng(5)
    poses = some_poses(rng, 1)
    cloud = cloud_of([(0, surface(rng))], poses)
    other, size, points = cloud.copy(), len(cloud), cloud.p_keyframe.copy()
    other.add(0, surface(rng, side_m=2.0), poses)
    assert len(other) > len(cloud) == size
    assert np.array_equal(cloud.p_keyframe, points)


def test_an_empty_cloud_is_a_cloud():
    poses = np.eye(4)[None]
    cloud = KeyframedCloud(VOXEL_M)
    cloud.add(0, np.zeros((0, 3)), poses)
    assert len(cloud) == 0
    assert cloud.world(poses).p_world.shape == (0, 3)
    assert cloud.world(poses) is cloud.world(poses)
    assert len(cloud.merged(KeyframedCloud(VOXEL_M), poses)) == 0


def test_bad_input_is_refused():
    poses, cloud = np.eye(4)[None], KeyframedCloud(VOXEL_M)
    with pytest.raises(FrameError, match="keyframe 1"):
        cloud.add(1, np.zeros((1, 3)), poses)
    with pytest.raises(FrameError, match="finite"):
        cloud.add(0, np.full((1, 3), np.nan), poses)
    with pytest.raises(FrameError, match=r"\(3,\)"):
        cloud.add(0, np.zeros(3), poses)
    with pytest.raises(ValueError, match=r"voxel_m 0\.0"):
        KeyframedCloud(0.0)
    with pytest.raises(ValueError, match="noise_at_1m_m -1"):
        KeyframedCloud(VOXEL_M, -1)


def test_depth_noise_does_not_fill_voxel_after_voxel():
    """A wall 3 m away, seen again and again: with the noise known the cloud stays a sheet."""
    rng = np.random.default_rng(7)
    poses, noise_at_1m_m = np.eye(4)[None], 0.002
    clouds = [KeyframedCloud(VOXEL_M, noise_m) for noise_m in (0.0, 3 * noise_at_1m_m)]
    sizes = []
    for _ in range(20):
        p_camera = np.concatenate([rng.uniform(-0.5, 0.5, (2500, 2)), np.full((2500, 1), 3.01)], axis=1)
        p_camera *= (1.0 + rng.normal(0, noise_at_1m_m * 3.0, 2500))[:, None]
        for cloud in clouds:
            cloud.add(0, p_camera, poses)
        sizes.append([len(cloud) for cloud in clouds])
    plain, thin = np.array(sizes).T
    assert plain[-1] > 2.0 * plain[0]
    assert thin[-1] < 1.1 * thin[4]
    assert thin[-1] < 0.5 * plain[-1]
    seen = clouds[1].world(poses).p_world
    assert cKDTree(seen[:, :2]).query(np.stack(np.meshgrid(*[np.linspace(-0.45, 0.45, 40)] * 2), axis=-1).reshape(-1, 2))[0].max() < 0.06


def test_what_is_beyond_the_noise_is_added():
    poses = np.eye(4)[None]
    sheet = np.array([[x, 0.0, 2.0] for x in np.arange(-0.2, 0.2, 0.02)])
    cloud = KeyframedCloud(VOXEL_M, 0.01)  # 4 cm at 2 m
    cloud.add(0, sheet, poses)
    before = len(cloud)
    cloud.add(0, np.array([[0.0, 0.03, 2.0], [0.0, 0.05, 2.0]]), poses)
    assert len(cloud) == before + 1
    assert cloud.p_keyframe[:, 1].max() == np.float32(0.05)
    cloud.add(0, sheet, poses)
    assert len(cloud) == before + 1
    assert len(cloud.subset(np.arange(3)).merged(cloud, poses)) == len(cloud)


def test_world_is_the_same_object_while_views_only_confirm_it():
    rng = np.random.default_rng(8)
    poses, p_world = some_poses(rng, 3), surface(rng, 2000)
    cloud = cloud_of([(0, p_world)], poses)
    first = cloud.world(poses)
    cloud.add(1, transform_points(inverse(poses[1]), p_world), poses)
    assert cloud.world(poses) is first
    slid = first.p_world + np.array([0.0, 0.0, 0.9]) * (VOXEL_M * (np.floor(first.p_world / VOXEL_M) + 1) - first.p_world)
    for _ in range(10):  # within their voxels, bit by bit
        cloud.add(2, transform_points(inverse(poses[2]), slid), poses)
    assert len(cloud) == len(first)
    second = cloud.world(poses)
    assert second is not first
    np.testing.assert_allclose(second.p_world, every_point(cloud, poses), atol=VOXEL_M / 4 + ROUNDING_M)
    cloud.add(2, transform_points(inverse(poses[2]), np.array([[5.0, 0, 0]])), poses)
    assert len(cloud.world(poses)) == len(second) + 1
