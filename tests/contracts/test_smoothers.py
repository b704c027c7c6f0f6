"""Every registered smoother keeps the contract, and the check notices those that do not."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends.given_poses_smoother import GivenPosesSmoother
from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.errors import UnknownLandmarkError
from seo_slam.geometry import exp
from seo_slam.testing import check_smoother
from seo_slam.types import Estimate


@pytest.mark.parametrize("name", registry.known("smoother"))
def test_contract(name):
    check_smoother(lambda: registry.create("smoother", name), corrects_poses=name != "given_poses")


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


class SplitsByPosition(GtsamSmoother):
    """Gives the new one as many measurements as asked for, but the last ones."""

    def split(self, landmark_id, new_id, measurements):
        count = len(self._known(landmark_id).measurements)
        super().split(landmark_id, new_id, np.arange(count - len(measurements), count))


class SplitsNothingOff(GtsamSmoother):
    def split(self, landmark_id, new_id, measurements):
        pass


class MergesInFront(GtsamSmoother):
    """Puts measurements of the one that goes before those of the one that stays."""

    def merge(self, keep_id, drop_id):
        count = len(self._known(keep_id).measurements)
        super().merge(keep_id, drop_id)
        held = self._known(keep_id)
        held.measurements = held.measurements[count:] + held.measurements[:count]


class SplitsAnything(GtsamSmoother):
    """Takes a number that is too high for the last one."""

    def split(self, landmark_id, new_id, measurements):
        count = len(self._known(landmark_id).measurements)
        super().split(landmark_id, new_id, np.minimum(measurements, count - 1))


class SplitsPriors(GtsamSmoother):
    """Gives the new one what the map knew, too."""

    def split(self, landmark_id, new_id, measurements):
        priors = [replace(prior) for prior in self._known(landmark_id).priors]
        super().split(landmark_id, new_id, measurements)
        for prior in priors:
            self._add_prior(new_id, prior)
        self._flush([])


class HalfRefuses(GivenPosesSmoother):
    """Refuses, but only when half of it is done."""

    def split(self, landmark_id, new_id, measurements):
        try:
            super().split(landmark_id, new_id, measurements)
        except UnknownLandmarkError:
            self._p_world[:] += 0.1
            raise


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
        (SplitsNothingOff, "after split"),
        (SplitsByPosition, "from where its measurements put it"),
        (MergesInFront, "after a merge, measurements"),
        (SplitsAnything, "did not raise"),
        (SplitsPriors, "of a continued map"),
        (object, "lacks methods"),
    ],
)
def test_broken_ones_are_noticed(smoother, words):
    with pytest.raises(AssertionError, match=words):
        check_smoother(smoother)


def test_a_smoother_of_given_poses_that_corrects_them_is_noticed():
    with pytest.raises(AssertionError, match="to take poses as they are given"):
        check_smoother(GtsamSmoother, corrects_poses=False)


def test_a_refused_split_that_leaves_a_trace_is_noticed():
    with pytest.raises(AssertionError, match="refused, but changes something"):
        check_smoother(HalfRefuses, corrects_poses=False)


def test_given_poses_do_not_pass_for_corrected_ones():
    with pytest.raises(AssertionError, match="pose error"):
        check_smoother(GivenPosesSmoother)
