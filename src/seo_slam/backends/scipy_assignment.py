"""Linear assignment by scipy (Crouse, "On implementing 2D rectangular assignment algorithms", 2016)."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from seo_slam.backends.cost_matrix import require_cost_matrix
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray


class ScipyAssignment:
    """Shortest augmenting paths on the rectangle itself: the fastest dense solver here."""

    def solve(self, cost: FloatArray) -> IntArray:
        """Return (K,) int64, the column of each row; the sum of their ``cost`` (K, M), M >= K, is least.

        Raises:
            FrameError: a cost is not finite, or there are fewer columns than rows.
        """
        _, columns = linear_sum_assignment(require_cost_matrix(cost))  # rows come back in order
        return np.asarray(columns, dtype=np.int64)
