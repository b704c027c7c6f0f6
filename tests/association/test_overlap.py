"""Overlap shares equal their definition; matching by looks and overlap, greedy and one to one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam import registry
from seo_slam.association.overlap import OverlapAssociator, cosines, overlap_shares
from seo_slam.geometry import inverse, transform_points
from seo_slam.perception.cloud import Cloud
from seo_slam.settings.concrete import OverlapSettings
from seo_slam.testing.associator import check_associator, tiny_estimate
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_landmarks, tiny_observations
from seo_slam.types import NEW, REJECTED

LANDMARKS = tiny_landmarks()


def shares_by_definition(observed, landmarks, distance_m):
    out = np.zeros((len(observed), len(landmarks)))
    limit_m = np.broadcast_to(distance_m, len(observed))
    for k, a in enumerate(observed):
        for n, b in enumerate(landmarks):
            if len(a) and len(b.p_world):
                nearest_m = np.sqrt(((a[:, None] - b.p_world[None]) ** 2).sum(axis=2)).min(axis=1)
                out[k, n] = (nearest_m < limit_m[k]).mean()
    return out


def blobs(rng, count, most):
    return [rng.uniform(0, 0.6, 3) + rng.normal(0, 0.05, (rng.integers(0, most + 1), 3)) for _ in range(count)]


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 6), st.integers(0, 8), st.floats(1e-3, 0.3), st.booleans())
def test_shares_are_those_of_the_definition(seed, K, N, distance_m, each_its_own):
    rng = np.random.default_rng(seed)
    observed, landmarks = blobs(rng, K, 40), [Cloud(points) for points in blobs(rng, N, 40)]
    limit_m = distance_m * rng.uniform(0.3, 1.5, K) if each_its_own else distance_m
    shares = overlap_shares(observed, landmarks, limit_m)
    assert shares.shape == (K, N)
    np.testing.assert_allclose(shares, shares_by_definition(observed, landmarks, limit_m), atol=1e-12, rtol=0)


def test_a_point_exactly_that_far_does_not_overlap():
    landmark = Cloud(np.zeros((1, 3)))
    points = np.array([[0.25, 0, 0], [np.nextafter(0.25, 0), 0, 0], [0, 0.5, 0], [0, 0, 0]])
    assert overlap_shares([points], [landmark], 0.25)[0, 0] == 0.5
    assert overlap_shares([points[:1]], [landmark], 0.25)[0, 0] == 0.0


def test_only_trees_of_landmarks_that_are_touched_are_built():
    near, far = Cloud(np.zeros((3, 3))), Cloud(np.full((3, 3), 5.0))
    overlap_shares([np.zeros((2, 3))], [near, far], 0.02)
    assert "tree" in near.__dict__
    assert "tree" not in far.__dict__


def test_cosines_ignore_length_and_bear_zeros():
    a, b = np.array([[2.0, 0.0], [0.0, 0.0]]), np.array([[3.0, 3.0]])
    np.testing.assert_allclose(cosines(a, b), [[np.sqrt(0.5)], [0.0]])


def patch(centre, rng_seed=0):
    return np.asarray(centre) + np.random.default_rng(rng_seed).uniform(-0.05, 0.05, (200, 3))


def seen(centres, labels):
    """Observations whose clouds are patches around centres (K, 3) in the world."""
    observations = tiny_observations(np.array(centres), labels)
    back = inverse(T_WORLD_FIRST)
    return replace(observations, clouds=tuple(transform_points(back, patch(centre)) for centre in centres))


def known(rows=(0, 1, 2, 3)):
    landmarks = LANDMARKS[np.array(rows)]
    return replace(landmarks, clouds=tuple(Cloud(patch(p)) for p in landmarks.p_world))


def matched(observations, landmarks, **options):
    return OverlapAssociator(OverlapSettings(**options)).associate(observations, landmarks, tiny_estimate(landmarks))


@pytest.mark.parametrize("assignment", ["greedy", "one_to_one"])
def test_the_contract_holds(assignment):
    check_associator(registry.create("associator", "overlap", overlap=OverlapSettings(assignment=assignment)))


def test_similarity_is_cosine_plus_overlap():
    landmarks = known()
    observations = seen(landmarks.p_world, ("cup", "keyboard", "cup", None))
    similarity = OverlapAssociator().similarity(observations, landmarks, tiny_estimate(landmarks))
    looks = cosines(observations.embeddings, landmarks.embeddings)
    np.testing.assert_allclose(similarity, looks + np.eye(4), atol=1e-12)
    result = matched(observations, landmarks)
    assert result.landmark_ids.tolist() == [3, 5, NEW, NEW]  # the cup where a book is: overlap alone is 1, below 1.2
    np.testing.assert_allclose(result.costs[:2], 0.0, atol=1e-12)  # 2 - similarity
    assert np.isnan(result.costs[2:]).all()


def test_the_threshold_itself_is_not_enough():
    landmarks = replace(known((0,)), clouds=(Cloud(np.zeros((1, 3))),))
    observations = tiny_observations(landmarks.p_world, ("cup",))  # looks alone: exactly 1
    assert matched(observations, landmarks, threshold=1.0).landmark_ids.tolist() == [NEW]
    assert matched(observations, landmarks, threshold=np.nextafter(1.0, 0)).landmark_ids.tolist() == [3]


def test_greedy_lets_two_observations_share_a_landmark():
    landmarks = known((0,))
    observations = seen([landmarks.p_world[0], landmarks.p_world[0] + np.array([0.01, 0, 0])], ("cup", "cup"))
    result = matched(observations, landmarks, assignment="greedy")
    assert result.shared
    assert result.landmark_ids.tolist() == [3, 3]


def test_one_to_one_gives_a_landmark_once_and_drops_the_second_box_of_it():
    landmarks = known((0,))
    p_world = landmarks.p_world[0]
    doubled = seen([p_world + np.array([0.03, 0, 0]), p_world], ("cup", "cup"))
    result = matched(doubled, landmarks, assignment="one_to_one")
    assert not result.shared
    assert result.landmark_ids.tolist() == [REJECTED, 3]
    apart = replace(doubled, boxes_px=np.array([[0.0, 0, 20, 20], [100, 100, 120, 120]]))
    assert matched(apart, landmarks, assignment="one_to_one").landmark_ids.tolist() == [NEW, 3]


def test_one_to_one_takes_the_most_similarity_in_total():
    """Both fit the first landmark best; only one of them also fits the second."""
    landmarks = known((2, 3))
    middle = 0.5 * landmarks.p_world.sum(axis=0)
    first = landmarks.p_world[0]
    # the first is known from its middle to the point between both, the second only there
    landmarks = replace(landmarks, clouds=(Cloud(np.concatenate([patch(first), patch(middle)])), Cloud(patch(middle, 1))))
    observations = seen([middle, first], ("book", "book"))
    greedy = matched(observations, landmarks, assignment="greedy")
    assert greedy.landmark_ids.tolist() == [8, 8]
    assert matched(observations, landmarks, distance_m=0.05).landmark_ids.tolist() == [9, 8]


@pytest.mark.parametrize("assignment", ["greedy", "one_to_one"])
def test_an_observation_without_a_cloud_is_rejected(assignment):
    landmarks = known()
    observations = seen(landmarks.p_world[:2], ("cup", "keyboard"))
    observations = replace(observations, clouds=(np.zeros((0, 3)), observations.clouds[1]))
    assert matched(observations, landmarks, assignment=assignment, threshold=0.5).landmark_ids.tolist() == [REJECTED, 5]


def test_landmarks_without_clouds_are_compared_by_looks():
    landmarks = replace(known(), clouds=())
    observations = seen(landmarks.p_world[:1], ("cup",))
    assert matched(observations, landmarks).landmark_ids.tolist() == [NEW]
    assert matched(observations, landmarks, threshold=0.9).landmark_ids.tolist() == [3]


def test_the_distance_grows_with_depth_noise():
    landmarks = replace(known((0,)), clouds=(Cloud(LANDMARKS.p_world[:1]),))
    observations = tiny_observations(landmarks.p_world, ("cup",))
    range_m = observations.p_camera[0, 2]
    shifted = replace(observations, clouds=(observations.clouds[0] + np.array([0.05, 0, 0]),))
    estimate = tiny_estimate(landmarks)
    for noise_m, overlap in ((0.0, 0.0), (0.049, 0.0), (0.051, 1.0)):
        settings = OverlapSettings(distance_m=0.02, noise_at_1m_m=noise_m / range_m**2)
        assert OverlapAssociator(settings).similarity(shifted, landmarks, estimate)[0, 0] == pytest.approx(1.0 + overlap)
    assert OverlapAssociator(OverlapSettings(distance_m=0.051)).similarity(shifted, landmarks, estimate)[0, 0] == pytest.approx(2.0)
