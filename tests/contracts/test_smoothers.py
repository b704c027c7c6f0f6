"""Every registered smoother keeps the contract, and the check notices those that do not."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.geometry import exp
from seo_slam.testing import check_smoother
from seo_slam.types import Estimate


@pytest.mark.parametrize("name", registry.known("smoother"))
def test_contract(name):
    check_smoother(lambda: registry.create("smoother", name))


class Deaf(GtsamSmoother):
    """Takes no measurement but the first of each landmark."""

    def update(self, motion, observations, landmark_ids, robust=True):
        fresh = ~np.isin(landmark_ids, self.positions()[0])
        return super().update(motion, observations[fresh], landmark_ids[fresh], robust)


class KeepsRemoved(GtsamSmoother):
    def remove(self, landmark_id):
        pass


class DropsOnMerge(GtsamSmoother):
    def merge(self, keep_id, drop_id):
        self.remove(drop_id)


class NotRobust(GtsamSmoother):
    def update(self, motion, observations, landmark_ids, robust=True):
        return super().update(motion, observations, landmark_ids, robust=False)


class Inverted(GtsamSmoother):
    """Predicts by the motion from the left."""

    def predict(self, motion):
        estimate = super().predict(motion)
        return replace(estimate, T_world_camera=motion.T_previous_current @ self.poses()[-1])


class Sure(GtsamSmoother):
    """Forgets the motion's noise."""

    def predict(self, motion):
        return Estimate(super().predict(motion).T_world_camera, self._joint)


class AnyOrder(GtsamSmoother):
    """Sorts the ids of the joint covariance."""

    def predict(self, motion):
        estimate = super().predict(motion)
        return replace(estimate, joint_covariance=lambda ids: estimate.joint_covariance(np.sort(ids)))


class Elsewhere(GtsamSmoother):
    def start(self, T_world_camera, covariance, landmarks=None):
        return super().start(T_world_camera @ exp([0, 0, 0, 0.1, 0, 0]), covariance, landmarks)


class StartsAnew(GtsamSmoother):
    def start(self, T_world_camera, covariance, landmarks=None):
        return super().start(T_world_camera, covariance)


@pytest.mark.parametrize(
    ("smoother", "words"),
    [
        (Deaf, "pose error"),
        (KeepsRemoved, "after remove"),
        (DropsOnMerge, "merge lost measurements"),
        (NotRobust, "one robust measurement"),
        (Inverted, "predict is not the last pose times the motion"),
        (Sure, "motion's covariance"),
        (AnyOrder, "in another order"),
        (Elsewhere, "where it was told"),
        (StartsAnew, "map to be continued"),
        (object, "lacks methods"),
    ],
)
def test_broken_ones_are_noticed(smoother, words):
    with pytest.raises(AssertionError, match=words):
        check_smoother(smoother)
