"""Motions between keyframes: nothing lost, nothing counted twice."""

import numpy as np
import pytest

from seo_slam.geometry import exp, inverse, log
from seo_slam.mapping.motion_chain import MotionChain
from seo_slam.types import Motion

STEP = exp([0.05, -0.1, 0.08, 0.1, -0.05, 0.2])
NOISE = np.diag([1e-5, 2e-5, 1e-5, 4e-5, 1e-5, 2e-5])


def chain(*steps, at_keyframe=None):
    made = MotionChain()
    if at_keyframe is not None:
        made.restart(Motion(np.eye(4), NOISE, end_covariance=at_keyframe))
    for step in steps:
        made.add(step)
    return made


def test_it_begins_at_the_keyframe():
    made = chain()
    assert made.motion is None
    np.testing.assert_array_equal(made.T_keyframe_frame, np.eye(4))
    made.add(Motion(STEP, NOISE))
    made.restart(Motion(STEP, NOISE))
    assert made.motion is None
    np.testing.assert_array_equal(made.T_keyframe_frame, np.eye(4))


def test_independent_steps_spread_as_samples_do():
    made = chain(*[Motion(STEP, NOISE)] * 5)
    rng = np.random.default_rng(0)
    wanted = np.linalg.matrix_power(STEP, 5)
    np.testing.assert_allclose(made.T_keyframe_frame, wanted, atol=1e-12)
    samples = []
    for _ in range(4000):
        T = np.eye(4)
        for xi in rng.multivariate_normal(np.zeros(6), NOISE, size=5):
            T = T @ STEP @ exp(xi)
        samples.append(log(inverse(wanted) @ T))
    spread = np.cov(np.array(samples).T)
    scale = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(made.motion.covariance / np.outer(scale, scale), spread / np.outer(scale, scale), atol=0.08)


@pytest.mark.parametrize("steps", [1, 2, 10])
def test_telescoping_steps_keep_the_errors_of_their_two_ends(steps):
    """An odometry that measures each frame against a map of its own: the frames between say nothing."""
    end = np.diag([2e-6, 1e-6, 3e-6, 5e-6, 4e-6, 6e-6])
    rng = np.random.default_rng(1)
    T = np.linalg.matrix_power(STEP, steps)
    samples = []
    for _ in range(4000):
        first, last = rng.multivariate_normal(np.zeros(6), end, size=2)
        samples.append(log(inverse(T) @ inverse(exp(first)) @ T @ exp(last)))
    spread = np.cov(np.array(samples).T)
    single = Motion(STEP, NOISE, end_covariance=end)
    made = chain(*[single] * steps, at_keyframe=end)
    if steps == 1:
        np.testing.assert_allclose(made.motion.covariance, NOISE)  # one step is as its odometry says
        return
    scale = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(made.motion.covariance / np.outer(scale, scale), spread / np.outer(scale, scale), atol=0.08)


def test_a_step_that_does_not_telescope_breaks_the_chain():
    end = 1e-6 * np.eye(6)
    made = chain(Motion(STEP, NOISE, end_covariance=end), Motion(STEP, NOISE), Motion(STEP, NOISE, end_covariance=end), at_keyframe=end)
    added = chain(*[Motion(STEP, NOISE)] * 3)
    np.testing.assert_allclose(made.motion.covariance, added.motion.covariance)


def test_one_lost_step_makes_the_motion_lost():
    ok, lost = Motion(STEP, NOISE), Motion(np.eye(4), 1e-2 * np.eye(6), status="lost", message="dark")
    assert chain(ok, ok).motion.status == "ok"
    for steps in ((lost,), (lost, ok), (ok, lost), (ok, lost, ok)):
        assert chain(*steps).motion.status == "lost"


def test_the_absolute_pose_of_the_newest_frame_is_passed_on():
    poses = [np.linalg.matrix_power(STEP, k) for k in (1, 2, 3)]
    made = chain(*(Motion(STEP, NOISE, T_world_camera=T) for T in poses))
    np.testing.assert_allclose(made.motion.T_world_camera, poses[-1], atol=1e-12)
    made.add(Motion(STEP, NOISE))
    assert made.motion.T_world_camera is None
