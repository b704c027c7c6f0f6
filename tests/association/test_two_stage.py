"""Who is whom: the two-stage associator and the nearest-landmark baseline on small scenes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2
from test_gate import THRESHOLD, correlated, estimate_of, landmarks_at, sure

from seo_slam.association.costs import mahalanobis, predicted_measurements
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.association.nearest import NearestAssociator
from seo_slam.association.two_stage import TwoStageAssociator
from seo_slam.backends.lap_assignment import LapAssignment
from seo_slam.backends.scipy_assignment import ScipyAssignment
from seo_slam.config import AssociationSettings
from seo_slam.testing.worlds import tiny_landmarks, tiny_observations
from seo_slam.types import NEW, REJECTED

CUP = np.array([1.2, 0.2, 0.8])
BESIDE = np.array([0.0, -0.1, 0.0])  # one cup's width to the right
MADE = [
    TwoStageAssociator,
    NearestAssociator,
    lambda: TwoStageAssociator(AssociationSettings(semantic_gate="cosine")),
    lambda: TwoStageAssociator(AssociationSettings(semantic_gate="none")),
]


def associate(associator, p_world, labels, known, estimate=None, **changes):
    seen = replace(tiny_observations(np.array(p_world), tuple(labels)), **changes)
    return associator.associate(seen, known, estimate or sure())


@pytest.mark.parametrize("make", MADE)
def test_two_cups_side_by_side_stay_two(make):
    known = landmarks_at([CUP, CUP + BESIDE], ids=[4, 9])
    found = associate(make(), [CUP + BESIDE + 0.01, CUP - 0.01], ("cup", "cup"), known)
    assert found.landmark_ids.tolist() == [9, 4]


@pytest.mark.parametrize("make", MADE)
def test_a_second_cup_beside_a_known_one_is_new(make):
    known = landmarks_at([CUP], ids=[4])
    found = associate(make(), [CUP + 0.005, CUP + BESIDE], ("cup", "cup"), known)
    assert found.landmark_ids.tolist() == [4, NEW]


@pytest.mark.parametrize("make", MADE)
def test_a_landmark_goes_to_one_observation_at_most(make):
    """Three measurements that all pass the gate of one landmark, their boxes apart: one gets it, the nearest."""
    known = landmarks_at([CUP], ids=[4])
    offsets = np.array([[0.0, 0.015, 0], [0.0, -0.004, 0], [0.0, 0.01, 0.01]])
    boxes = np.array([[10.0, 10, 30, 30], [100, 10, 130, 30], [200, 10, 230, 30]])
    found = associate(make(), CUP + offsets, ("cup",) * 3, known, boxes_px=boxes)
    assert found.landmark_ids.tolist() == [NEW, 4, NEW]
    assert np.isnan(found.costs[[0, 2]]).all()
    assert np.isfinite(found.costs[1])


def test_the_assignment_is_the_best_overall_not_greedy():
    """The first observation is nearer to both; giving it its nearest would leave the second nothing."""
    known = landmarks_at([CUP, CUP + np.array([0.0, -0.042, 0.0])], ids=[0, 1])
    p_world = [CUP + np.array([0, -0.02, 0]), CUP + np.array([0, 0.025, 0])]
    settings_ = AssociationSettings(semantic_gate="none")
    boxes = np.array([[10.0, 10, 30, 30], [100, 10, 130, 30]])
    best = associate(TwoStageAssociator(settings_), p_world, ("cup", "cup"), known, boxes_px=boxes)
    greedy = associate(NearestAssociator(settings_), p_world, ("cup", "cup"), known, boxes_px=boxes)
    assert best.landmark_ids.tolist() == [1, 0]
    assert greedy.landmark_ids.tolist() == [0, NEW]


def test_a_doubled_box_is_rejected_and_makes_no_landmark():
    known = landmarks_at([CUP], ids=[4])
    once = tiny_observations(np.array([CUP]), ("cup",)).boxes_px[0]
    boxes = np.array([once, once + np.array([2.0, 2.0, -2.0, 1.0])])
    found = associate(TwoStageAssociator(), [CUP, CUP + 0.006], ("cup", "cup"), known, boxes_px=boxes)
    assert sorted(found.landmark_ids.tolist()) == [REJECTED, 4]
    assert found.landmark_ids.tolist()[0] == 4


def test_the_same_without_overlapping_boxes_is_new():
    known = landmarks_at([CUP], ids=[4])
    boxes = np.array([[100.0, 100, 120, 120], [121, 100, 141, 120]])
    found = associate(TwoStageAssociator(), [CUP, CUP + 0.006], ("cup", "cup"), known, boxes_px=boxes)
    assert found.landmark_ids.tolist() == [4, NEW]


class Synonyms:
    """An embedder in which cup, mug and teacup are nearly one word, and all else is apart."""

    name = "synonyms"
    size = 8

    def embed_text(self, texts):
        out = np.zeros((len(texts), 8))
        for row, text in enumerate(texts):
            if text.removeprefix("a ") in ("cup", "mug", "teacup"):
                out[row, 0] = 0.95
                out[row, 1 + ["cup", "mug", "teacup"].index(text.removeprefix("a "))] = np.sqrt(1 - 0.95**2)
            else:
                out[row, 4 + sum(text.encode()) % 4] = 1.0
        return out


def test_a_label_that_flickers_between_synonyms_finds_its_landmark():
    likelihood = LabelLikelihood(Synonyms())
    associator = TwoStageAssociator(likelihood=likelihood)
    for words in ({"cup": 1.0}, {"cup": 0.6, "mug": 0.4}, {"mug": 0.1, "teacup": 0.9}):
        known = landmarks_at([CUP], [words], ids=[4])
        for label in ("cup", "mug", "teacup", None):
            found = associate(associator, [CUP + 0.01], (label,), known)
            assert found.landmark_ids.tolist() == [4], (words, label)


def test_an_unnamed_landmark_takes_any_label_that_fits_the_place():
    known = landmarks_at([CUP], [{}], ids=[4])
    for make in MADE:
        assert associate(make(), [CUP], ("keyboard",), known).landmark_ids.tolist() == [4]


def test_the_label_decides_between_two_landmarks_near_each_other():
    known = landmarks_at([CUP, CUP + np.array([0.0, -0.02, 0.0])], [{"cup": 1.0}, {"keyboard": 1.0}], ids=[0, 1])
    estimate = sure(landmark_sigma=0.02)
    for label, wanted in (("cup", 0), ("keyboard", 1)):
        found = associate(TwoStageAssociator(), [CUP + np.array([0.0, -0.01, 0.0])], (label,), known, estimate)
        assert found.landmark_ids.tolist() == [wanted]


# --- the paper's gate ------------------------------------------------------------------------------------------------------------


def embedded(*rows):
    out = np.zeros((len(rows), 8))
    for k, (x, y) in enumerate(rows):
        out[k, :2] = x, y
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def test_the_cosine_gate_lets_pass_what_is_above_tau_and_costs_squared_distance():
    settings_ = AssociationSettings(semantic_gate="cosine", cosine_threshold=0.6)
    known = replace(landmarks_at([CUP], ids=[4]), embeddings=embedded((1, 0)))
    at = CUP + np.array([0.0, 0.01, 0.0])
    like = associate(TwoStageAssociator(settings_), [at], ("mug",), known, embeddings=embedded((0.61, np.sqrt(1 - 0.61**2))))
    unlike = associate(TwoStageAssociator(settings_), [at], ("mug",), known, embeddings=embedded((0.59, np.sqrt(1 - 0.59**2))))
    assert like.landmark_ids.tolist() == [4]
    assert unlike.landmark_ids.tolist() == [NEW]
    seen = tiny_observations(np.array([at]), ("mug",))
    squared, _ = mahalanobis(seen, known, *predicted_measurements(sure(), known))
    assert like.costs[0] == pytest.approx(squared[0, 0], rel=1e-9)


def test_cosine_gate_ignores_words_where_either_side_has_none():
    settings_ = AssociationSettings(semantic_gate="cosine")
    known = replace(landmarks_at([CUP], ids=[4]), embeddings=embedded((1, 0)))
    found = associate(TwoStageAssociator(settings_), [CUP], (None,), known, embeddings=np.zeros((1, 8)))
    assert found.landmark_ids.tolist() == [4]


@pytest.mark.parametrize("probability", [0.5, 0.99])
def test_the_chi_square_border_is_where_the_setting_says(probability):
    """Without semantics the gate is exactly Eq 7."""
    settings_ = AssociationSettings(semantic_gate="none", gate_probability=probability)
    known = landmarks_at([CUP], ids=[4])
    estimate = sure(pose_sigma=1e-5, landmark_sigma=1e-5)
    border_m = 0.01 * np.sqrt(chi2.ppf(probability, df=3))
    for make in (TwoStageAssociator, NearestAssociator):
        within = associate(make(settings_), [CUP + np.array([0.0, 0.99 * border_m, 0.0])], ("cup",), known, estimate)
        beyond = associate(make(settings_), [CUP + np.array([0.0, 1.01 * border_m, 0.0])], ("cup",), known, estimate)
        assert within.landmark_ids.tolist() == [4]
        assert beyond.landmark_ids.tolist() == [NEW]


# --- the baseline ----------------------------------------------------------------------------------------------------------------


def test_nearest_does_not_look_at_labels_and_takes_pairs_by_rising_distance():
    known = landmarks_at([CUP, CUP + np.array([0.0, 0.03, 0.0])], [{"cup": 1.0}, {"keyboard": 1.0}], ids=[7, 8])
    seen = [CUP + np.array([0.0, 0.012, 0.0]), CUP + np.array([0.0, 0.002, 0.0])]
    found = associate(NearestAssociator(), seen, ("keyboard", "keyboard"), known)
    assert found.landmark_ids.tolist() == [8, 7]  # the second is nearest to 7, so the first takes what is left
    predicted = predicted_measurements(sure(), known)
    squared, _ = mahalanobis(tiny_observations(np.array(seen), ("cup",) * 2), known, *predicted)
    np.testing.assert_allclose(found.costs, [squared[0, 1], squared[1, 0]])


# --- laws ------------------------------------------------------------------------------------------------------------------------


def scene(seed):
    rng = np.random.default_rng(seed)
    N, K = int(rng.integers(0, 7)), int(rng.integers(0, 7))
    known = landmarks_at(CUP + 0.15 * rng.normal(size=(N, 3)), [{"cup": 0.7, "book": 0.3}] * N, ids=rng.permutation(100)[:N])
    near = known.p_world[rng.integers(0, N, K)] if N else np.tile(CUP, (K, 1))
    labels = tuple(("cup", "book", "pen", None)[i] for i in rng.integers(0, 4, K))
    seen = tiny_observations(near + 0.02 * rng.normal(size=(K, 3)), labels)
    order = np.argsort(known.ids)
    known = known[order]
    return seen, known, estimate_of(correlated(rng, N, 0.005, 0.01), known.ids)


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**31), gate=st.sampled_from(["likelihood", "cosine", "none"]))
def test_scipy_and_jvc_find_assignments_of_equal_cost(seed, gate):
    settings_ = AssociationSettings(semantic_gate=gate)
    seen, known, estimate = scene(seed)
    totals, counts = [], []
    for solver in (ScipyAssignment(), LapAssignment()):
        associator = TwoStageAssociator(settings_, solver)
        found = associator.associate(seen, known, estimate)
        dummy = associator.gate(seen, known, estimate).dummy_cost if len(seen) else 0.0
        totals.append(float(np.where(np.isnan(found.costs), dummy, found.costs).sum()))
        counts.append(sorted(found.landmark_ids[found.landmark_ids >= 0].tolist()))
    assert totals[0] == pytest.approx(totals[1], rel=1e-9, abs=1e-9)


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**31), which=st.sampled_from(range(len(MADE))))
def test_every_answer_is_one_to_one_known_and_within_the_gate(seed, which):
    seen, known, estimate = scene(seed)
    found = MADE[which]().associate(seen, known, estimate)
    matched = found.landmark_ids >= 0
    assert len(found.landmark_ids) == len(seen)
    assert len(set(found.landmark_ids[matched])) == matched.sum()
    assert set(found.landmark_ids[matched]) <= set(known.ids)
    assert set(found.landmark_ids[~matched]) <= {NEW, REJECTED}
    assert (np.isnan(found.costs) == ~matched).all()
    squared, _ = mahalanobis(seen, known, *predicted_measurements(estimate, known))
    for k in np.flatnonzero(matched):
        assert squared[k, np.flatnonzero(known.ids == found.landmark_ids[k])[0]] < THRESHOLD


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), which=st.sampled_from(range(len(MADE))))
def test_the_order_of_observations_does_not_matter(seed, which):
    seen, known, estimate = scene(seed)
    order = np.random.default_rng(seed).permutation(len(seen))
    straight = MADE[which]().associate(seen, known, estimate)
    turned = MADE[which]().associate(seen[order], known, estimate)
    np.testing.assert_allclose(np.nansum(turned.costs), np.nansum(straight.costs), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(turned.landmark_ids, straight.landmark_ids[order])


def test_inputs_are_left_as_they_were():
    known = tiny_landmarks()
    seen = tiny_observations(known.p_world, ("cup", "keyboard", "book", "book"))
    before = seen.p_camera.copy(), known.p_world.copy(), seen.boxes_px.copy()
    for make in MADE:
        make().associate(seen, known, sure(ids=known.ids))
    for was, now in zip(before, (seen.p_camera, known.p_world, seen.boxes_px), strict=True):
        np.testing.assert_array_equal(was, now)
