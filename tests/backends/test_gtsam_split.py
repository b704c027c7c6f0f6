"""A split of a landmark in the graph leaves the graph that would be there had it been two from the start."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.errors import UnknownLandmarkError
from seo_slam.geometry import exp, inverse
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_landmarks, tiny_observations, tiny_trajectory
from seo_slam.types import Motion

FIRST = 1e-6 * np.eye(6)
MOTION = np.diag([2e-5] * 3 + [1e-4] * 3)
POINTS = tiny_landmarks().p_world
ODD = np.array([5, 1, 7, 3])


def drive(name, noise=1.0, robust=False, landmarks=None, count=8):
    """Keyframes that see points 0 and 1 in turn, as landmark ``name(k)``, and points 2 and 3 always."""
    rng = np.random.default_rng(3)
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST, landmarks)
    poses = tiny_trajectory(count)
    for k, T in enumerate(poses):
        step = Motion(inverse(poses[k - 1]) @ T @ exp(noise * rng.multivariate_normal(np.zeros(6), MOTION)), MOTION)
        seen = tiny_observations(POINTS[[k % 2, 2, 3]], ("cup",) * 3, T)
        seen = replace(seen, p_camera=seen.p_camera + noise * 0.01 * rng.normal(size=(3, 3)))
        smoother.update(step if k else None, seen, np.array([name(k), 2, 3]), robust)
    return smoother


def solved(smoother):
    """The points and poses at which all factors in the graph agree best, found by another solver; and how many factors there are."""
    held, graph = smoother._isam.getFactorsUnsafe(), gtsam.NonlinearFactorGraph()
    for n in range(held.size()):
        if held.at(n) is not None:
            graph.push_back(held.at(n))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-15)
    parameters.setAbsoluteErrorTol(1e-15)
    values = gtsam.LevenbergMarquardtOptimizer(graph, smoother._isam.calculateEstimate(), parameters).optimize()
    return gtsam.utilities.extractPoint3(values), gtsam.utilities.extractPose3(values), graph.size()


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("known", [False, True])
def test_split_is_as_if_it_had_been_two_from_the_start(robust, known):
    landmarks = replace(tiny_landmarks(), ids=np.arange(4))[np.array([0])] if known else None
    apart, fresh = drive(lambda _: 0, robust=robust, landmarks=landmarks), drive(lambda k: k % 2, robust=robust, landmarks=landmarks)
    blend_m = apart.positions()[1][0]
    apart.split(0, 1, ODD)
    assert apart.positions()[0].tolist() == [0, 1, 2, 3]
    points, poses, factors = solved(apart)
    wanted_points, wanted_poses, wanted_factors = solved(fresh)
    assert factors == wanted_factors == 1 + 7 + 24 + known
    np.testing.assert_allclose(points, wanted_points, atol=1e-6)
    np.testing.assert_allclose(poses, wanted_poses, atol=1e-6)
    assert robust or np.linalg.norm(blend_m - points[0]) > 0.02  # a loss stays with one of the two
    # Its own estimate is as good as ISAM2's thresholds and lagging robust weights let it be.
    np.testing.assert_allclose(apart.positions()[1], fresh.positions()[1], atol=0.02 if robust else 1e-3)


def test_exact_measurements_of_two_places_are_told_apart_at_once():
    smoother = drive(lambda _: 0, noise=0.0)
    smoother.split(0, 1, ODD)
    np.testing.assert_allclose(smoother.positions()[1], POINTS, atol=5e-4)
    np.testing.assert_allclose(smoother.poses(), tiny_trajectory(8), atol=5e-4)


def test_halves_can_be_removed_merged_renamed_and_split_again():
    smoother = drive(lambda _: 0, noise=0.0)
    smoother.split(0, 1, ODD)
    smoother.split(1, 7, np.array([0, 1, 2]))  # all but one
    smoother.rename(7, 5)
    smoother.merge(1, 5)
    smoother.split(1, 6, np.array([0]))
    smoother.remove(6)
    assert smoother.positions()[0].tolist() == [0, 1, 2, 3]
    assert solved(smoother)[2] == 1 + 7 + 24 - 1
    np.testing.assert_allclose(smoother.positions()[1], POINTS, atol=1e-3)
    smoother.remove(0)
    smoother.remove(1)
    assert solved(smoother)[2] == 1 + 7 + 16


def test_priors_of_a_continued_map_stay_with_the_old_id():
    landmarks = replace(tiny_landmarks(), ids=np.arange(4))
    smoother = GtsamSmoother()
    smoother.start(T_WORLD_FIRST, FIRST, landmarks)
    smoother.update(None, tiny_observations(POINTS[1:2], ("cup",)), np.array([0]), robust=False)
    smoother.split(0, 9, np.array([0]))  # its only measurement
    assert smoother.positions()[0].tolist() == [0, 1, 2, 3, 9]
    np.testing.assert_allclose(smoother.positions()[1], [*POINTS, POINTS[1]], atol=1e-3)
    with pytest.raises(UnknownLandmarkError, match="no measurement 0: it has 0"):
        smoother.split(0, 10, np.array([0]))


@pytest.mark.parametrize(
    ("landmark_id", "new_id", "measurements", "words"),
    [
        (77, 10, [0], "landmark 77 is not"),
        (0, 3, [0], "cannot be split into 3"),
        (0, 0, [0], "cannot be split into 0"),
        (0, 10, [8], "no measurement 8: it has 8"),
        (0, 10, [3, -1], "no measurement -1"),
        (0, 10, [], "no measurements are given"),
        (0, 10, range(8), "none of its 8 measurements would be left"),
    ],
)
def test_a_wrong_split_is_refused_and_changes_nothing(landmark_id, new_id, measurements, words):
    smoother = drive(lambda _: 0)
    before = smoother.positions()
    with pytest.raises(UnknownLandmarkError, match=words):
        smoother.split(landmark_id, new_id, np.array(measurements, dtype=np.int64))
    np.testing.assert_array_equal(smoother.positions()[1], before[1])
    assert solved(smoother)[2] == 1 + 7 + 24
