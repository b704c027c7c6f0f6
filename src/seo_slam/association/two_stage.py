"""SEO-SLAM's data association: a geometric gate, then a semantic one, then one assignment (III-B)."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from seo_slam.association.candidates import candidate_rows, possible_pairs
from seo_slam.association.costs import mahalanobis_of_pairs, predicted_measurements
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.config import AssociationSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import AssignmentSolver, Associator
from seo_slam.perception.boxes import containment
from seo_slam.types import NEW, REJECTED, Association, BoolArray, Estimate, IntArray, Landmarks, Observations

CLUTTER_PER_M3 = 50.0
"""Density of other things to expect around a thing: a cluttered desk (a dozen things on a square metre, 0.25 m high)."""

FORBIDDEN = 1e6
"""The predefined large cost of III-B; far above any dummy cost, so that a forbidden pair never wins over a new landmark."""

SAME_BOX_CONTAINMENT = 0.7
"""A second box of one landmark in one image, that much inside the first, is the detector firing twice."""


@dataclass(frozen=True, slots=True, eq=False)
class Gate:
    """What each pair of observation and landmark costs and whether it may be.

    Attributes:
        allowed: (K, N) bool.
        cost: (K, N), meaningful where allowed.
        dummy_cost: above any allowed cost: the price of "no landmark fits".
    """

    allowed: BoolArray
    cost: FloatArray
    dummy_cost: float


class TwoStageAssociator(Associator):
    """Mahalanobis gate with the joint covariance (Eq 4, 7), semantic gate, K x (N+K) assignment with private dummy columns."""

    def __init__(
        self,
        settings: AssociationSettings | None = None,
        solver: AssignmentSolver | None = None,
        likelihood: LabelLikelihood | None = None,
    ) -> None:
        """Take the gate's settings, an assignment solver (default: scipy's), and what compares labels (default: equal or not)."""
        self._settings = settings or AssociationSettings()
        self._solver = solver or _default_solver()
        self._threshold = float(chi2.ppf(self._settings.gate_probability, df=3))
        self._likelihood = likelihood or LabelLikelihood()

    def associate(self, observations: Observations, landmarks: Landmarks, estimate: Estimate) -> Association:
        """See ``interfaces.Associator``."""
        near = landmarks[candidate_rows(observations, landmarks, estimate, self._settings.search_distance_m, self._threshold)]
        gate = self.gate(observations, near, estimate)
        columns = self._assign(gate)
        ids = np.full(len(observations), NEW, dtype=np.int64)
        costs = np.full(len(observations), np.nan)
        matched = np.flatnonzero(columns < len(near))
        ids[matched] = near.ids[columns[matched]]
        costs[matched] = gate.cost[matched, columns[matched]]
        ids[doubles(observations, gate.allowed, columns)] = REJECTED
        return Association(landmark_ids=ids, costs=costs)

    def gate(self, observations: Observations, candidates: Landmarks, estimate: Estimate) -> Gate:
        """Test every pair: first chi-square (Eq 7), then semantics."""
        predicted = predicted_measurements(estimate, candidates)
        rows, columns = possible_pairs(observations, candidates, *predicted, self._threshold)
        squared, log_det = mahalanobis_of_pairs(observations, candidates, *predicted, rows, columns)
        passed = squared < self._threshold
        rows, columns, squared, log_det = rows[passed], columns[passed], squared[passed], log_det[passed]
        shape = len(observations), len(candidates)
        if self._settings.semantic_gate == "none":
            return _gate_of_pairs(shape, rows, columns, squared, self._threshold)
        labels = [(observations.labels[k], candidates.labels[n]) for k, n in zip(rows.tolist(), columns.tolist(), strict=True)]
        if self._settings.semantic_gate == "cosine":
            similar = (observations.embeddings @ candidates.embeddings.T)[rows, columns] > self._settings.cosine_threshold
            unnamed = np.array([not label or not words for label, words in labels], dtype=np.bool_)
            passed = similar | unnamed
            return _gate_of_pairs(shape, rows[passed], columns[passed], squared[passed], self._threshold)
        # Eq 6 with its normaliser, against another thing being there: what a pair gains over a new landmark.
        semantic = np.array([self._likelihood.log_ratio(label, words) for label, words in labels], dtype=np.float64)
        log_odds = semantic - 0.5 * (squared + log_det) - math.log(CLUTTER_PER_M3)
        passed = log_odds > 0.0
        return _gate_of_pairs(shape, rows[passed], columns[passed], -2.0 * log_odds[passed], 0.0)

    def _assign(self, gate: Gate) -> IntArray:
        """Return (K,) the column of each observation, N or more for none.

        Solves the K x (N+K) problem: landmark columns, then one private dummy column an observation. A landmark that is allowed to
        nobody cannot be in the optimum, so its column is left out.
        """
        K, N = gate.allowed.shape
        wanted = np.flatnonzero(gate.allowed.any(axis=0))
        cost = np.full((K, len(wanted) + K), FORBIDDEN)
        cost[:, : len(wanted)] = np.where(gate.allowed[:, wanted], gate.cost[:, wanted], FORBIDDEN)
        cost[np.arange(K), len(wanted) + np.arange(K)] = gate.dummy_cost
        return np.concatenate([wanted, N + np.arange(K)])[self._solver.solve(cost)]


def _gate_of_pairs(shape: tuple[int, int], rows: IntArray, columns: IntArray, costs: FloatArray, dummy_cost: float) -> Gate:
    """Put pairs (P,) that passed, and their costs, into a gate of shape (K, N)."""
    allowed, cost = np.zeros(shape, dtype=np.bool_), np.zeros(shape)
    allowed[rows, columns], cost[rows, columns] = True, costs
    return Gate(allowed, cost, dummy_cost)


def doubles(observations: Observations, allowed: BoolArray, columns: IntArray) -> BoolArray:
    """Return (K,) bool: unassigned observations that are a second box of a landmark already assigned in this image.

    Such an observation passed the gate of that landmark, and its box lies in the box that won it (or the other way round). Two
    cups side by side have separate boxes and stay two.
    """
    K, N = allowed.shape
    out = np.zeros(K, dtype=np.bool_)
    winners, left = np.flatnonzero(columns < N), np.flatnonzero(columns >= N)
    could = allowed[left[:, None], columns[winners]]
    if could.any():
        inside = containment(observations.boxes_px[left], observations.boxes_px[winners]) > SAME_BOX_CONTAINMENT
        out[left] = np.any(could & inside, axis=1)
    return out


def _default_solver() -> AssignmentSolver:
    from seo_slam.registry import create

    solver: AssignmentSolver = create("assignment_solver", "scipy")
    return solver
