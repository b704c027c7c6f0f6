"""Every registered odometry keeps the contract, and the check notices those that do not."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.config import Component
from seo_slam.geometry import inverse
from seo_slam.records import Trajectory
from seo_slam.testing import check_odometry
from seo_slam.testing.worlds import tiny_frames, tiny_trajectory
from seo_slam.types import Motion


def options(name):
    if name == "recorded":
        return {"trajectory": Trajectory(np.array([frame.timestamp_s for frame in tiny_frames()]), tiny_trajectory())}
    return {}


@pytest.mark.parametrize("name", registry.known("odometry"))
def test_contract(name):
    check_odometry(registry.create("odometry", Component(name=name), **options(name)))


class Knows:
    """The truth on the six tiny frames, lost afterwards; tests break it in one place each."""

    def __init__(self, change=lambda motion: motion):
        self._truth = tiny_trajectory()
        self._count = 0
        self._change = change

    def update(self, frame):
        k, self._count = self._count, self._count + 1
        if k == 0:
            return Motion(np.eye(4), 1e-4 * np.eye(6))
        if k >= len(self._truth):
            return Motion(np.eye(4), np.eye(6), "lost", "nothing is known here")
        return self._change(Motion(inverse(self._truth[k - 1]) @ self._truth[k], 1e-4 * np.eye(6)))


def test_the_truth_passes():
    check_odometry(Knows())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: replace(m, T_previous_current=inverse(m.T_previous_current)), "T_previous_current, which maps"),
        (lambda m: replace(m, T_previous_current=np.eye(4)), "is off by"),
        (lambda m: replace(m, covariance=np.zeros((6, 6))), "not positive definite"),
        (lambda m: replace(m, covariance=m.covariance + np.eye(6, k=1) * 1e-5), "not symmetric"),
        (lambda m: replace(m, status="lost"), "does not say why"),
        (lambda m: replace(m, status="lost", message="tired"), "was lost in all but 0 of 5"),
        (lambda m: replace(m, status="fine"), "'fine'"),
        (lambda m: m.T_previous_current, "returned ndarray"),
    ],
)
def test_broken_ones_are_noticed(change, words):
    with pytest.raises(AssertionError, match=words):
        check_odometry(Knows(change))


def test_a_first_motion_is_noticed():
    late = Knows()
    late._count = 1
    with pytest.raises(AssertionError, match="first frame is not the identity"):
        check_odometry(late)
