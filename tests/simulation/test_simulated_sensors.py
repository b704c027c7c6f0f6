"""Noise of the simulated depth camera and odometry, against its own statement."""

from itertools import pairwise

import numpy as np
import pytest

from seo_slam.errors import ConfigError
from seo_slam.geometry import exp, inverse, log
from seo_slam.records import Trajectory
from seo_slam.simulation.sensors import SensorKnobs, axial_sigma_m, depth_edges, drifting_odometry, sense_depth
from seo_slam.simulation.trajectory import swaying_arc


@pytest.mark.parametrize("z", [0.6, 1.5, 3.0])
@pytest.mark.parametrize("level", [0.5, 1.0])
def test_axial_noise_grows_with_depth(z: float, level: float) -> None:
    flat = np.full((100, 120), z, dtype=np.float32)
    knobs = SensorKnobs(depth_noise=level)
    error = sense_depth(flat, knobs, 1, 0).astype(np.float64) - z
    sigma = level * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    assert abs(error.mean()) < 5 * sigma / np.sqrt(error.size)
    assert error.std() == pytest.approx(sigma, rel=0.05)
    assert axial_sigma_m(np.array(z)) * level == pytest.approx(sigma)


def test_level_zero_is_perfect_but_for_rounding() -> None:
    depth = np.random.default_rng(0).uniform(0.4, 5.0, (40, 50)).astype(np.float32)
    depth[3, 4] = 0.0
    seen = sense_depth(depth, SensorKnobs.at_level(0), 0, 0)
    assert np.abs(seen - depth).max() <= 1.01e-4  # 1/5000 m
    assert seen[3, 4] == 0


def test_depth_comes_in_steps_of_disparity() -> None:
    flat = np.full((60, 60), 2.0, dtype=np.float32)
    values = np.unique(sense_depth(flat, SensorKnobs(depth_noise=1.0, disparity_step_px=0.125), 0, 0))
    disparity = 43.5 / values
    assert np.abs(disparity / 0.125 - np.round(disparity / 0.125)).max() < 0.02
    assert len(values) < 8  # a step is 1.1 cm at 2 m


def test_holes_at_edges_only() -> None:
    depth = np.full((80, 80), 1.0, dtype=np.float32)
    depth[:, 40:] = 2.0
    seen = sense_depth(depth, SensorKnobs(holes=0.35), 0, 0)
    edge = depth_edges(depth)
    assert edge.sum() == 160
    assert (seen[~edge] > 0).all()
    assert 0.22 < (seen[edge] == 0).mean() < 0.48


def test_slanted_plane_is_no_edge() -> None:
    depth = np.tile(np.linspace(1.0, 2.0, 60, dtype=np.float32), (40, 1))
    assert not depth_edges(depth).any()


def test_draws_belong_to_the_frame() -> None:
    flat = np.full((20, 20), 1.0, dtype=np.float32)
    knobs = SensorKnobs.at_level(1.0)
    later = sense_depth(flat, knobs, 0, 7)
    sense_depth(flat, knobs, 0, 3)
    assert (sense_depth(flat, knobs, 0, 7) == later).all()
    assert (sense_depth(flat, knobs, 0, 8) != later).any()
    assert (sense_depth(flat, knobs, 1, 7) != later).any()


def test_odometry_drifts_as_a_random_walk() -> None:
    truth = swaying_arc(np.array([0.0, 0.0, 0.8]), 60, 0)
    walked = np.linalg.norm(np.diff(truth.T_world_camera[:, :3, 3], axis=0), axis=1)
    knobs = SensorKnobs.at_level(1.0)
    twists = []
    for seed in range(40):
        odometry = drifting_odometry(truth, knobs, seed)
        assert (odometry.T_world_camera[0] == truth.T_world_camera[0]).all()
        for k in range(1, len(truth)):
            true_step = inverse(truth.T_world_camera[k - 1]) @ truth.T_world_camera[k]
            step = inverse(odometry.T_world_camera[k - 1]) @ odometry.T_world_camera[k]
            twists.append(log(inverse(true_step) @ step) / np.sqrt(walked[k - 1]))
    spread = np.std(twists, axis=0)
    assert spread[:3] == pytest.approx(np.radians(0.6), rel=0.06)
    assert spread[3:] == pytest.approx(0.012, rel=0.06)


def test_odometry_may_drift_by_turning_on_the_spot() -> None:
    turn = exp(np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0]))
    poses = [np.eye(4)]
    for _ in range(200):
        poses.append(poses[-1] @ turn)
    truth = Trajectory(np.arange(201.0), np.stack(poses))
    assert np.allclose(drifting_odometry(truth, SensorKnobs.at_level(1.0), 0).T_world_camera, truth.T_world_camera)
    drifted = drifting_odometry(truth, SensorKnobs(turn_drift_deg=2.0), 0).T_world_camera
    twists = [log(inverse(turn) @ inverse(a) @ b) / np.sqrt(0.1) for a, b in pairwise(drifted)]
    assert np.std(twists, axis=0)[:3] == pytest.approx(np.radians(2.0), rel=0.2)
    assert np.abs(drifted[:, :3, 3]).max() < 1e-9


def test_perfect_odometry() -> None:
    truth = swaying_arc(np.zeros(3), 10, 0)
    assert np.allclose(drifting_odometry(truth, SensorKnobs(), 0).T_world_camera, truth.T_world_camera)


@pytest.mark.parametrize("level", [-0.1, np.nan, np.inf])
def test_bad_level(level: float) -> None:
    with pytest.raises(ConfigError, match="level"):
        SensorKnobs.at_level(level)
