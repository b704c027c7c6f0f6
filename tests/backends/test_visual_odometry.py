"""Visual odometry on a rendered room with known motion, and on the beginning of a real recording."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from seo_slam import geometry
from seo_slam.backends.visual_features import Features
from seo_slam.backends.visual_odometry import VisualOdometry
from seo_slam.backends.visual_pose import jacobians, residuals
from seo_slam.camera import Camera
from seo_slam.datasets.tum import TumDataset
from seo_slam.errors import ConfigError, FrameError
from seo_slam.evaluation.trajectory import ape
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Odometry
from seo_slam.records import Trajectory
from seo_slam.types import Frame, Motion

CAMERA = Camera(270.0, 270.0, 159.5, 119.5, 320, 240)
DISTORTED = Camera(270.0, 270.0, 159.5, 119.5, 320, 240, (-0.3, 0.1, 0.002, -0.002, 0.0))
PERIOD_S = 1 / 15


class Room:
    """A wall 2.5 m ahead and a floor 0.9 m below, both with a texture of blobs of all sizes."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        texture = np.zeros((1024, 1024), dtype=np.float32)
        for cells in (32, 64, 128, 256):
            texture += cv2.resize(rng.uniform(-1, 1, (cells, cells)).astype(np.float32), (1024, 1024), interpolation=cv2.INTER_CUBIC)
        self.texture = np.clip(127 + 50 * texture, 0, 255).astype(np.uint8)
        self.rng = rng

    def frame(self, T_world_camera: FloatArray, index: int, camera: Camera = CAMERA, depth: bool = True) -> Frame:
        rays = np.concatenate([camera.rays(), np.ones((camera.height, camera.width, 1))], axis=-1)
        directions, origin = rays @ T_world_camera[:3, :3].T, T_world_camera[:3, 3]
        with np.errstate(divide="ignore"):
            to_wall, to_floor = (2.5 - origin[2]) / directions[..., 2], (0.9 - origin[1]) / directions[..., 1]
        on_floor = (to_floor > 0) & (to_floor < to_wall)
        z = np.where(on_floor, to_floor, to_wall)
        p = origin + directions * z[..., None]
        u, v = p[..., 0], np.where(on_floor, p[..., 2] + 3.0, p[..., 1])
        x, y = (np.stack([u, v]) * 200 + 500).astype(np.float32)
        grey = cv2.remap(self.texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP).astype(np.float64)
        grey = np.clip(grey + self.rng.normal(0, 2.0, grey.shape), 0, 255).astype(np.uint8)
        noise = self.rng.normal(0, 1, z.shape) * 0.0019 * z**2
        depth_m = (z + noise).astype(np.float32) if depth else np.zeros(z.shape, dtype=np.float32)
        return Frame(index * PERIOD_S, np.repeat(grey[..., None], 3, axis=2), depth_m, camera, index)


def path(count: int) -> list[FloatArray]:
    """A gentle loop: poses ``T_world_camera``, the first the identity."""
    poses = []
    for i in range(count):
        a = 2 * np.pi * i / 40
        turn = np.array([0.05 * np.sin(a), 0.15 * np.sin(a), 0.05 * np.sin(2 * a)])
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = geometry.so3_exp(turn), [0.25 * np.sin(a), 0.1 * np.sin(2 * a), 0.2 * (1 - np.cos(a))]
        poses.append(T)
    return poses


def blank(index: int, period_s: float = PERIOD_S) -> Frame:
    return Frame(index * period_s, np.full((240, 320, 3), 90, np.uint8), np.zeros((240, 320), np.float32), CAMERA, index)


def walk(odometry: VisualOdometry, frames: list[Frame]) -> tuple[list[FloatArray], list[Motion]]:
    motions = [odometry.update(frame) for frame in frames]
    poses = [np.eye(4)]
    for motion in motions[1:]:
        poses.append(poses[-1] @ motion.T_previous_current)
    return poses, motions


def position_error_m(a: FloatArray, b: FloatArray) -> float:
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3]))


@pytest.fixture(scope="module")
def loop() -> tuple[list[FloatArray], list[Frame]]:
    room, poses = Room(), path(41)
    return poses, [room.frame(T, i) for i, T in enumerate(poses)]


def test_follows_a_known_motion_without_drift(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    truth, frames = loop
    odometry = VisualOdometry(timing_sigma_s=0.0)
    assert isinstance(odometry, Odometry)
    poses, motions = walk(odometry, frames)
    assert all(m.status == "ok" and m.message == "" and m.T_world_camera is None for m in motions)
    np.testing.assert_array_equal(motions[0].T_previous_current, np.eye(4))
    assert max(position_error_m(a, b) for a, b in zip(poses, truth, strict=True)) < 0.012
    assert position_error_m(poses[-1], truth[-1]) < 0.004  # the loop closes on the map of its beginning


def test_covariance_has_the_scale_of_the_errors(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    truth, frames = loop
    _, motions = walk(VisualOdometry(timing_sigma_s=0.0), frames)
    squared = []
    for i in range(1, len(frames)):
        error = geometry.log(geometry.inverse(motions[i].T_previous_current) @ geometry.inverse(truth[i - 1]) @ truth[i])
        squared.append(error @ np.linalg.solve(motions[i].covariance, error) / 6)
    assert 0.2 < np.mean(squared) < 2.0


def test_timing_noise_grows_with_speed(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    _, frames = loop
    _, exact = walk(VisualOdometry(timing_sigma_s=0.0), frames[:5])
    _, blurred = walk(VisualOdometry(timing_sigma_s=0.015), frames[:5])
    speed_m_s = np.linalg.norm(exact[-1].T_previous_current[:3, 3]) / PERIOD_S
    grown_m2 = np.trace(blurred[-1].covariance[3:, 3:]) - np.trace(exact[-1].covariance[3:, 3:])
    assert grown_m2 == pytest.approx(2 * (0.015 * speed_m_s) ** 2, rel=0.6)


def test_same_frames_give_the_same_bytes(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    _, frames = loop
    runs = []
    for global_seed in (1, 99):
        cv2.setRNGSeed(global_seed)
        _, motions = walk(VisualOdometry(seed=3), frames[:15])
        runs.append(b"".join(m.T_previous_current.tobytes() + m.covariance.tobytes() for m in motions))
    assert runs[0] == runs[1]


def test_lens_distortion_is_taken_out() -> None:
    room, truth = Room(1), path(41)
    poses, motions = walk(VisualOdometry(), [room.frame(T, i, DISTORTED) for i, T in enumerate(truth)])
    errors_m = [position_error_m(a, b) for a, b in zip(poses, truth, strict=True)]
    assert all(m.status == "ok" for m in motions)
    assert np.sqrt(np.mean(np.square(errors_m))) < 0.006  # 0.009 if the lens is taken for a pinhole


def test_blank_stretch_is_lost_then_found_again(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    truth, frames = loop
    shown = [blank(i) if 10 <= i < 18 else frame for i, frame in enumerate(frames)]
    poses, motions = walk(VisualOdometry(), shown)
    assert [i for i, m in enumerate(motions) if m.status == "lost"] == list(range(10, 18))
    assert "frame 10" in motions[10].message
    for i in range(18, len(frames)):  # composed motions lead back to the true pose, though nothing was seen in between
        assert position_error_m(poses[i], truth[i]) < 0.012
    sigma_m = [float(np.sqrt(m.covariance[3:, 3:].diagonal().max())) for m in motions]
    assert min(sigma_m[10:18]) > 0.05
    assert sigma_m[18] > sigma_m[12]  # it starts from a pose that was only guessed
    assert sigma_m[20] < 0.02


def test_after_a_jump_elsewhere_a_new_map_begins() -> None:
    here, elsewhere, truth = Room(2), Room(3), path(24)
    frames = [(here if i < 8 else elsewhere).frame(T, i) for i, T in enumerate(truth)]
    _, motions = walk(VisualOdometry(restart_frames=3), frames)
    assert [m.status for m in motions[:8]] == ["ok"] * 8
    assert [m.status for m in motions[8:11]] == ["lost"] * 3
    assert "new map" in motions[10].message
    for i in range(11, len(frames)):
        step = geometry.inverse(truth[i - 1]) @ truth[i]
        assert motions[i].status == "ok"
        assert position_error_m(motions[i].T_previous_current, step) < 0.01
        assert motions[i].covariance[3:, 3:].diagonal().max() < 0.02**2


def test_frames_without_depth_are_tracked_by_pixels_alone(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    truth, frames = loop
    shown = [
        Frame(f.timestamp_s, f.rgb, np.zeros_like(f.depth_m), f.camera, f.index) if i in (5, 6, 7, 8) else f
        for i, f in enumerate(frames[:14])
    ]
    poses, motions = walk(VisualOdometry(), shown)
    assert all(m.status == "ok" for m in motions)
    assert max(position_error_m(a, b) for a, b in zip(poses, truth, strict=False)) < 0.015


def test_beginning_without_depth_or_texture_waits_for_a_usable_frame() -> None:
    room, truth = Room(), path(8)
    frames = [blank(0), room.frame(truth[1], 1, depth=False)] + [room.frame(T, i) for i, T in enumerate(truth) if i >= 2]
    _, motions = walk(VisualOdometry(), frames)
    assert [m.status for m in motions] == ["lost"] * 3 + ["ok"] * 5
    assert "0 features with depth" in motions[0].message
    np.testing.assert_array_equal(motions[0].T_previous_current, np.eye(4))


def test_long_gap_is_bridged_by_the_map(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    truth, frames = loop
    late = [Frame(f.timestamp_s + 30.0, f.rgb, f.depth_m, f.camera, f.index) for f in frames[15:20]]
    poses, motions = walk(VisualOdometry(), frames[:8] + late)
    assert all(m.status == "ok" for m in motions)
    assert position_error_m(poses[-1], truth[19]) < 0.01


def test_initial_pose_places_the_first_camera(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    truth, frames = loop
    T_world_first = geometry.exp([0.3, -1.2, 0.4, 2.0, -1.0, 0.5])
    motions = [VisualOdometry(initial_pose=T_world_first.tolist()).update(frames[0])]
    np.testing.assert_allclose(motions[0].T_world_camera, T_world_first, atol=1e-12)
    odometry = VisualOdometry(initial_pose=T_world_first)
    T_world_camera = T_world_first
    for i, frame in enumerate(frames[:6]):
        motion = odometry.update(frame)
        T_world_camera = T_world_camera @ motion.T_previous_current
        np.testing.assert_allclose(motion.T_world_camera, T_world_camera, atol=1e-9)
        assert motion.T_world_camera is not None
        assert position_error_m(motion.T_world_camera, T_world_first @ truth[i]) < 0.012


def test_refuses_bad_settings_and_stamps(loop: tuple[list[FloatArray], list[Frame]]) -> None:
    with pytest.raises(ConfigError, match="features is 5, wanted at least 100"):
        VisualOdometry(features=5)
    with pytest.raises(ConfigError, match="keyframe_share is 0"):
        VisualOdometry(keyframe_share=0.0)
    with pytest.raises(FrameError, match="initial_pose"):
        VisualOdometry(initial_pose=2 * np.eye(4))
    odometry = VisualOdometry()
    odometry.update(loop[1][1])
    with pytest.raises(FrameError, match="wanted a stamp after"):
        odometry.update(loop[1][0])


def test_jacobians_are_the_derivatives_of_the_residuals() -> None:
    rng = np.random.default_rng(5)
    inverse_depth = np.array([0.5, 0.4, 0.7, 0.2, 0.0])
    features = Features(
        rng.uniform(0, 240, (5, 2)), np.full(5, 1.3), np.zeros(5, np.int64), np.zeros((5, 4), np.uint64), inverse_depth, np.full(5, 0.002)
    )
    T = geometry.exp(0.3 * rng.normal(size=6))
    p_world = geometry.transform_points(T, rng.uniform([-1, -1, 1], [1, 1, 3], (5, 3)))
    _, p_camera = residuals(T, p_world, features, CAMERA)
    by_pose, by_point = jacobians(p_camera, features, CAMERA)
    h = 1e-6
    for k in range(6):
        step = geometry.exp(h * np.eye(6)[k])
        ahead, _ = residuals(T @ step, p_world, features, CAMERA)
        behind, _ = residuals(T @ geometry.inverse(step), p_world, features, CAMERA)
        np.testing.assert_allclose(by_pose[:, :, k], (ahead - behind) / (2 * h), atol=1e-4)
    for k in range(3):
        shift = T[:3, :3] @ (h * np.eye(3)[k])
        ahead, _ = residuals(T, p_world + shift, features, CAMERA)
        behind, _ = residuals(T, p_world - shift, features, CAMERA)
        np.testing.assert_allclose(by_point[:, :, k], (ahead - behind) / (2 * h), atol=1e-4)


def test_real_recording(shared: Path) -> None:
    recording = TumDataset(shared / "data" / "tum_fr1_xyz", max_frames=60)
    frames = list(recording)
    poses, motions = walk(VisualOdometry(), frames)
    assert all(m.status == "ok" for m in motions)
    assert recording.trajectory is not None
    estimate = Trajectory(np.array([f.timestamp_s for f in frames]), np.array(poses))
    assert ape(estimate, recording.trajectory).rmse_m < 0.015
