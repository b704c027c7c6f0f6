"""What a merge does to the measurements: they stay what they were."""

import numpy as np
import pytest

from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_observations


@pytest.mark.parametrize("robust", [False, True])
def test_measurements_keep_their_loss_when_they_change_hands(robust):
    at = np.array([1.2, 0.2, 0.8])
    # Three views here and one 10 cm away: least squares take the mean, a robust loss stays with the three.
    places = [at, at, at, at + np.array([0.0, 0.1, 0.0])]
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, 1e-10 * np.eye(6))
    for landmark_id, place in enumerate(places):
        smoother.update(None, tiny_observations(place[None], ("cup",)), np.array([landmark_id]), robust=robust)
    for drop_id in (1, 2, 3):
        smoother.merge(0, drop_id)
    ids, p_world = smoother.positions()
    assert ids.tolist() == [0]
    moved_m = float(np.linalg.norm(p_world[0] - at))
    assert moved_m < 0.01 if robust else moved_m == pytest.approx(0.025, abs=0.005)
