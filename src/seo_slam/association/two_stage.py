"""SEO-SLAM's data association: a geometric gate, then a semantic one, then one assignment (III-B)."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from seo_slam.association.costs import mahalanobis, predicted_measurements, within_reach
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
        pairs = within_reach(observations, landmarks, estimate, self._settings.search_distance_m, self._threshold)
        candidates = landmarks[np.any(pairs, axis=0)]
        gate = self.gate(observations, candidates, estimate)
        columns = self._assign(gate)
        ids = np.full(len(observations), NEW, dtype=np.int64)
        costs = np.full(len(observations), np.nan)
        matched = np.less(columns, len(candidates))
        ids[matched] = candidates.ids[columns[matched]]
        costs[matched] = gate.cost[np.flatnonzero(matched), columns[matched]]
        ids[doubles(observations, gate.allowed, columns)] = REJECTED
        return Association(landmark_ids=ids, costs=costs)

    def gate(self, observations: Observations, candidates: Landmarks, estimate: Estimate) -> Gate:
        """Test every pair: first chi-square (Eq 7), then semantics."""
        predicted, predicted_cov = predicted_measurements(estimate, candidates)
        squared, log_det = mahalanobis(observations, candidates, predicted, predicted_cov)
        allowed: BoolArray = np.less(squared, self._threshold)
        if self._settings.semantic_gate == "none":
            return Gate(allowed, squared, self._threshold)
        if self._settings.semantic_gate == "cosine":
            similar = observations.embeddings @ candidates.embeddings.T > self._settings.cosine_threshold
            named = np.array([bool(label) for label in observations.labels], dtype=np.bool_)[:, None]
            named = named & np.array([bool(words) for words in candidates.labels], dtype=np.bool_)[None, :]
            return Gate(allowed & (similar | ~named), squared, self._threshold)
        # Eq 6 with its normaliser, against another thing being there: what a pair gains over a new landmark.
        log_odds = self._semantic(observations, candidates, allowed) - 0.5 * (squared + log_det) - np.log(CLUTTER_PER_M3)
        return Gate(allowed & np.greater(log_odds, 0.0), -2.0 * log_odds, 0.0)

    def _semantic(self, observations: Observations, landmarks: Landmarks, pairs: BoolArray) -> FloatArray:
        """(K, N) log likelihood ratios of the labels of the given pairs, 0 elsewhere."""
        out = np.zeros(pairs.shape)
        for k, n in zip(*np.nonzero(pairs), strict=True):
            out[k, n] = self._likelihood.log_ratio(observations.labels[k], landmarks.labels[n])
        return out

    def _assign(self, gate: Gate) -> IntArray:
        """Solve the K x (N+K) problem: landmark columns, then one private dummy column an observation."""
        K, N = gate.allowed.shape
        cost = np.full((K, N + K), FORBIDDEN)
        cost[:, :N][gate.allowed] = gate.cost[gate.allowed]
        cost[np.arange(K), N + np.arange(K)] = gate.dummy_cost
        return self._solver.solve(cost)


def doubles(observations: Observations, allowed: BoolArray, columns: IntArray) -> BoolArray:
    """Return (K,) bool: unassigned observations that are a second box of a landmark already assigned in this image.

    Such an observation passed the gate of that landmark, and its box lies in the box that won it (or the other way round). Two
    cups side by side have separate boxes and stay two.
    """
    K, N = allowed.shape
    inside = containment(observations.boxes_px, observations.boxes_px) > SAME_BOX_CONTAINMENT
    out = np.zeros(K, dtype=np.bool_)
    winners = np.flatnonzero(columns < N)
    for k in np.flatnonzero(columns >= N):
        out[k] = bool((allowed[k, columns[winners]] & inside[k, winners]).any())
    return out


def _default_solver() -> AssignmentSolver:
    from seo_slam.registry import create

    solver: AssignmentSolver = create("assignment_solver", "scipy")
    return solver
