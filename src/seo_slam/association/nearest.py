"""The baseline of SEO-SLAM's Table II: the nearest landmark within the gate, whatever its label."""

import numpy as np
from scipy.stats import chi2

from seo_slam.association.costs import mahalanobis, predicted_measurements, within_reach
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
        pairs = within_reach(observations, landmarks, estimate, self._settings.search_distance_m, self._threshold)
        candidates = landmarks[np.any(pairs, axis=0)]
        squared, _ = mahalanobis(observations, candidates, *predicted_measurements(estimate, candidates))
        ids = np.full(len(observations), NEW, dtype=np.int64)
        costs = np.full(len(observations), np.nan)
        taken: set[int] = set()
        rows, columns = np.nonzero(squared < self._threshold)
        for pair in np.argsort(squared[rows, columns], kind="stable"):
            k, n = int(rows[pair]), int(columns[pair])
            if ids[k] == NEW and n not in taken:
                ids[k], costs[k] = candidates.ids[n], squared[k, n]
                taken.add(n)
        return Association(landmark_ids=ids, costs=costs)
