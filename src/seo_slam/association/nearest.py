"""The baseline of SEO-SLAM's Table II: the nearest landmark within the gate, whatever its label."""

import numpy as np
from scipy.stats import chi2

from seo_slam.association.candidates import candidate_rows, possible_pairs
from seo_slam.association.costs import mahalanobis_of_pairs, predicted_measurements
from seo_slam.config import AssociationSettings
from seo_slam.interfaces import Associator
from seo_slam.types import NEW, Association, Estimate, Landmarks, Observations


class NearestAssociator(Associator):
    """Single data association: pairs are taken greedily by rising Mahalanobis distance; labels are not looked at."""

    def __init__(self, settings: AssociationSettings | None = None) -> None:
        """Take the gate's settings."""
        self._settings = settings or AssociationSettings()
        self._threshold = float(chi2.ppf(self._settings.gate_probability, df=3))

    def associate(self, observations: Observations, landmarks: Landmarks, estimate: Estimate) -> Association:
        """See ``interfaces.Associator``."""
        near = landmarks[candidate_rows(observations, landmarks, estimate, self._settings.search_distance_m, self._threshold)]
        predicted = predicted_measurements(estimate, near)
        rows, columns = possible_pairs(observations, near, *predicted, self._threshold)
        squared, _ = mahalanobis_of_pairs(observations, near, *predicted, rows, columns)
        ids = np.full(len(observations), NEW, dtype=np.int64)
        costs = np.full(len(observations), np.nan)
        taken: set[int] = set()
        for pair in np.argsort(squared, kind="stable"):
            k, n = int(rows[pair]), int(columns[pair])
            if squared[pair] < self._threshold and ids[k] == NEW and n not in taken:
                ids[k], costs[k] = near.ids[n], squared[pair]
                taken.add(n)
        return Association(landmark_ids=ids, costs=costs)
