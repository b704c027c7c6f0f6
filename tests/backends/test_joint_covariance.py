"""The carried joint covariance against what the smoother recovers from its graph."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.geometry import exp
from seo_slam.testing.worlds import tiny_observations
from seo_slam.types import Motion

MOTION = np.diag([1e-5] * 3 + [1e-4] * 3)


def drive(keyframes, landmarks=12, seed=0, robust=False, smoother=None):
    """A camera that sways before a wall of points and sees most of them, each keyframe a few new ones."""
    rng = np.random.default_rng(seed)
    smoother = smoother or GtsamSmoother()
    p_world = np.column_stack([rng.uniform(-1.5, 1.5, (landmarks, 2)), rng.uniform(2.0, 3.0, landmarks)])
    T = np.eye(4)
    smoother.start(T, 1e-6 * np.eye(6))
    for k in range(keyframes):
        step = exp(np.concatenate([0.02 * rng.normal(size=3), 0.06 * rng.normal(size=3)]))
        motion = None
        if k:
            T = T @ step
            motion = Motion(step @ exp(rng.multivariate_normal(np.zeros(6), MOTION)), MOTION)
        rows = np.flatnonzero(rng.random(min(landmarks, 4 + k)) < 0.7)
        exact = tiny_observations(p_world[rows], ("cup",) * len(rows), T, 0.02)
        seen = replace(exact, p_camera=exact.p_camera + 0.02 * rng.normal(size=(len(rows), 3)))
        smoother.update(motion, seen, rows.astype(np.int64), robust)
        smoother.predict(Motion(np.eye(4), MOTION)).joint_covariance(smoother.positions()[0])  # as the gate asks
    return smoother


@pytest.mark.parametrize("keyframes", [3, 8, 25])
def test_carried_is_what_the_graph_says(keyframes):
    smoother = drive(keyframes)
    known = smoother.positions()[0]
    carried, recovered = smoother._joint(known), smoother._recover(known)
    assert smoother._carried is not None
    np.testing.assert_allclose(np.diag(carried), np.diag(recovered), rtol=0.05)
    scale = np.sqrt(np.outer(np.diag(recovered), np.diag(recovered)))
    assert np.abs((carried - recovered) / scale).max() < 0.05


def test_carried_stays_a_covariance_under_robust_losses():
    smoother = drive(25, robust=True, seed=3)
    joint = smoother._joint(smoother.positions()[0])
    assert np.abs(joint - joint.T).max() < 1e-12
    assert np.linalg.eigvalsh(joint).min() > 0


def test_a_part_is_the_part_of_the_whole_in_the_order_asked():
    smoother = drive(6)
    whole = smoother._joint(smoother.positions()[0])
    part = smoother._joint(np.array([3, 1]))
    rows = np.r_[0:6, 6 + 9 : 6 + 12, 6 + 3 : 6 + 6]
    np.testing.assert_allclose(part, whole[np.ix_(rows, rows)], atol=1e-15)


def test_taking_factors_out_begins_anew():
    smoother = drive(6)
    smoother.remove(2)
    known = smoother.positions()[0]
    np.testing.assert_allclose(smoother._joint(known), smoother._recover(known), rtol=1e-9, atol=1e-14)
    smoother.merge(0, 1)
    known = smoother.positions()[0]
    np.testing.assert_allclose(smoother._joint(known), smoother._recover(known), rtol=1e-9, atol=1e-14)
