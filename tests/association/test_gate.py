"""The gate of Eq 4 and 7 against a computation by hand, against sampling, and what may be left out of it."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from seo_slam.association.candidates import candidate_rows, near_camera, possible_pairs
from seo_slam.association.costs import mahalanobis, predicted_measurements
from seo_slam.association.two_stage import TwoStageAssociator
from seo_slam.config import AssociationSettings
from seo_slam.geometry import exp, inverse, transform_points
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_embedding, tiny_landmarks, tiny_observations
from seo_slam.types import Estimate, Landmark, Landmarks, heaviest

THRESHOLD = float(chi2.ppf(0.99, df=3))


def correlated(rng, count, pose_sigma=0.02, landmark_sigma=0.05):
    """A joint covariance of a pose and ``count`` landmarks in which all is correlated with all."""
    n = 6 + 3 * count
    root = rng.normal(size=(n, n)) / np.sqrt(n) + 0.3 * np.eye(n)
    scale = np.concatenate([np.full(3, 0.5 * pose_sigma), np.full(3, pose_sigma), np.full(3 * count, landmark_sigma)])
    return (root @ root.T) * np.outer(scale, scale)


def estimate_of(joint, ids, T_world_camera=T_WORLD_FIRST):
    """An estimate that knows the joint covariance of the pose and landmarks ``ids``."""
    place = {int(landmark_id): row for row, landmark_id in enumerate(ids)}

    def joint_covariance(wanted):
        rows = np.concatenate([np.arange(6), *(6 + 3 * place[int(i)] + np.arange(3) for i in wanted)]).astype(int)
        return joint[np.ix_(rows, rows)]

    return Estimate(T_world_camera, joint_covariance)


def sure(T_world_camera=T_WORLD_FIRST, ids=range(200), pose_sigma=1e-4, landmark_sigma=1e-3):
    ids = list(ids)
    sigmas = np.concatenate([np.full(6, pose_sigma), np.full(3 * len(ids), landmark_sigma)])
    return estimate_of(np.diag(sigmas**2), ids, T_world_camera)


def landmarks_at(p_world, words=None, ids=None):
    p_world = np.asarray(p_world, dtype=np.float64).reshape(-1, 3)
    one = tiny_landmarks()
    count = len(p_world)
    words = words or [{"cup": 1.0}] * count
    template = Landmark(0, "", {}, np.zeros(3), np.eye(3), np.full(3, 0.1), np.zeros(one.embeddings.shape[1]), 5, 0.0, 1.0, "stable")
    rows = [
        replace(template, id=int(i), labels=labels, position_m=p, embedding=tiny_embedding(heaviest(labels)))
        for i, labels, p in zip(ids if ids is not None else range(count), words, p_world, strict=True)
    ]
    return Landmarks.from_rows(rows, one.embeddings.shape[1])


def measure(T, p_world):
    return transform_points(inverse(T), p_world)


def test_the_prediction_is_the_numeric_jacobian_of_the_measurement():
    rng = np.random.default_rng(0)
    known = tiny_landmarks()
    joint = correlated(rng, len(known))
    T = T_WORLD_FIRST @ exp([0.2, -0.4, 0.1, 0.3, 0.1, -0.2])
    p_camera, covariance = predicted_measurements(estimate_of(joint, known.ids, T), known)
    np.testing.assert_allclose(p_camera, measure(T, known.p_world), atol=1e-12)
    for n in range(len(known)):
        H = np.zeros((3, 6 + 3 * len(known)))
        for k in range(6 + 3 * len(known)):
            step = np.zeros(6 + 3 * len(known))
            step[k] = 1e-6
            p_plus = known.p_world + step[6:].reshape(-1, 3)
            H[:, k] = (measure(T @ exp(step[:6]), p_plus)[n] - measure(T, known.p_world)[n]) / 1e-6
        np.testing.assert_allclose(covariance[n], H @ joint @ H.T, rtol=1e-4, atol=1e-9)


def test_distances_are_those_computed_one_by_one():
    rng = np.random.default_rng(1)
    known = tiny_landmarks()
    seen = tiny_observations(known.p_world[[2, 0]] + 0.03, ("cup", "book"))
    seen = replace(seen, cov_camera=np.array([a @ a.T * 1e-4 + 1e-5 * np.eye(3) for a in rng.normal(size=(2, 3, 3))]))
    predicted, covariance = predicted_measurements(estimate_of(correlated(rng, len(known)), known.ids), known)
    squared, log_det = mahalanobis(seen, known, predicted, covariance)
    assert squared.shape == (2, len(known))
    for k in range(2):
        for n in range(len(known)):
            C = covariance[n] + seen.cov_camera[k]
            d = seen.p_camera[k] - predicted[n]
            assert squared[k, n] == pytest.approx(d @ np.linalg.inv(C) @ d, rel=1e-9)
            assert log_det[k, n] == pytest.approx(np.log(np.linalg.det(2 * np.pi * C)), rel=1e-9)


@pytest.mark.parametrize("probability", [0.9, 0.99])
def test_the_gate_lets_the_promised_share_of_true_pairs_through(probability):
    """Draw pose, landmark and noise from what is claimed: Eq 7 must hold for alpha of the draws."""
    rng = np.random.default_rng(2)
    known = tiny_landmarks()[np.array([1])]
    joint = correlated(rng, 1, pose_sigma=0.03, landmark_sigma=0.04)
    gamma = np.diag([2e-4, 1e-4, 6e-4])
    estimate = estimate_of(joint, known.ids)
    predicted, covariance = predicted_measurements(estimate, known)
    draws = rng.multivariate_normal(np.zeros(9), joint, size=3000)
    noise = rng.multivariate_normal(np.zeros(3), gamma, size=3000)
    p_camera = np.array([measure(T_WORLD_FIRST @ exp(d[:6]), known.p_world[0] + d[6:]) + e for d, e in zip(draws, noise, strict=True)])
    seen = tiny_observations(np.tile(known.p_world, (3000, 1)), ("cup",) * 3000)
    seen = replace(seen, p_camera=p_camera, cov_camera=np.tile(gamma, (3000, 1, 1)))
    squared, _ = mahalanobis(seen, known, predicted, covariance)
    assert (squared < chi2.ppf(probability, df=3)).mean() == pytest.approx(probability, abs=0.015)


def test_correlation_of_pose_and_landmark_tightens_the_gate():
    """A landmark placed from this very camera errs with it; without the blocks between them the gate would be far too wide."""
    known = tiny_landmarks()[np.array([0])]
    R, p = T_WORLD_FIRST[:3, :3], measure(T_WORLD_FIRST, known.p_world)[0]
    J = np.zeros((3, 6))  # the landmark moves as the camera does
    J[:, :3] = -R @ np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])
    J[:, 3:] = R
    pose = 0.05**2 * np.eye(6)
    joint = np.block([[pose, pose @ J.T], [J @ pose, J @ pose @ J.T + 1e-6 * np.eye(3)]])
    _, tight = predicted_measurements(estimate_of(joint, known.ids), known)
    loose = joint.copy()
    loose[:6, 6:] = loose[6:, :6] = 0.0
    _, wide = predicted_measurements(estimate_of(loose, known.ids), known)
    np.testing.assert_allclose(tight[0], 1e-6 * np.eye(3), atol=1e-9)
    assert np.trace(wide[0]) > 1000 * np.trace(tight[0])


def test_empty_inputs_have_empty_shapes():
    known, nothing = tiny_landmarks(), tiny_observations(np.zeros((0, 3)), ())
    none = known[np.zeros(0, dtype=np.int64)]
    one = tiny_observations(known.p_world[:1], ("cup",))
    estimate = sure()
    assert [a.shape for a in predicted_measurements(estimate, none)] == [(0, 3), (0, 3, 3)]
    for seen, marks in ((nothing, known), (one, none), (nothing, none)):
        arrays = mahalanobis(seen, marks, *predicted_measurements(estimate, marks))
        assert [a.shape for a in arrays] == [(len(seen), len(marks))] * 2
        assert len(candidate_rows(seen, marks, estimate, 6.0, THRESHOLD)) == 0
        assert [len(rows) for rows in possible_pairs(seen, marks, *predicted_measurements(estimate, marks), THRESHOLD)] == [0, 0]


# --- who may be left out before the joint covariance is asked for ----------------------------------------------------------------


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**31), spread_m=st.floats(0.05, 3.0), pose_sigma=st.floats(1e-4, 0.3), landmark_sigma=st.floats(1e-3, 0.14))
def test_nothing_that_would_pass_the_gate_is_left_out(seed, spread_m, pose_sigma, landmark_sigma):
    rng = np.random.default_rng(seed)
    count = 8
    p_camera = np.column_stack([rng.uniform(-1, 1, (count, 2)), rng.uniform(0.4, 3.0, count)])
    known = landmarks_at(transform_points(T_WORLD_FIRST, p_camera))
    known = replace(known, across_m=rng.uniform(0, 0.4, (count, 2)) * rng.integers(0, 2, (count, 1)))
    joint = correlated(rng, count, pose_sigma, landmark_sigma)
    estimate = estimate_of(joint, known.ids)
    seen = tiny_observations(known.p_world[:4], ("cup",) * 4)
    seen = replace(seen, p_camera=seen.p_camera + 0.3 * spread_m * rng.normal(size=(4, 3)))
    cut = rng.integers(0, 2, (4, 4)).astype(bool)
    seen = replace(seen, cov_camera=np.array([a @ a.T * 1e-3 + 1e-5 * np.eye(3) for a in rng.normal(size=(4, 3, 3))]), truncated=cut)
    known = replace(known, cov_world=joint[6:, 6:].reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count), :])
    predicted = predicted_measurements(estimate, known)
    passes = mahalanobis(seen, known, *predicted)[0] < THRESHOLD
    assert set(np.flatnonzero(passes.any(axis=0))) <= set(candidate_rows(seen, known, estimate, 6.0, THRESHOLD))
    possible = np.zeros_like(passes)
    possible[possible_pairs(seen, known, *predicted, THRESHOLD)] = True
    assert not (passes & ~possible).any()


@given(seed=st.integers(0, 2**31), reach_m=st.floats(0.1, 8.0))
def test_near_the_camera_means_just_that(seed, reach_m):
    rng = np.random.default_rng(seed)
    p_world, T = rng.uniform(-6, 6, (200, 3)), exp(rng.normal(size=6))
    wanted = np.flatnonzero(np.linalg.norm(p_world - T[:3, 3], axis=1) < reach_m)
    assert near_camera(p_world, T, reach_m).tolist() == wanted.tolist()


def test_far_landmarks_are_left_out_and_never_asked_for():
    known = landmarks_at([[1.2, 0.0, 1.0], [1.2, 4.0, 1.0], [7.0, 0.0, 1.0]])
    known = replace(known, cov_world=1e-4 * known.cov_world)
    asked = []

    def joint_covariance(ids):
        asked.extend(int(i) for i in ids)
        return 1e-6 * np.eye(6 + 3 * len(ids))

    estimate = Estimate(T_WORLD_FIRST, joint_covariance)
    seen = tiny_observations([[1.2, 0.01, 1.0], [7.0, 0.0, 1.0]], ("cup", "cup"))
    found = TwoStageAssociator(AssociationSettings(search_distance_m=6.0)).associate(seen, known, estimate)
    assert found.landmark_ids.tolist() == [0, -1]  # the third is where it should be, but beyond the search distance
    assert set(asked) == {0}
