"""Linear assignment by Jonker and Volgenant (1987), the solver of SEO-SLAM III-B, as the package lap has it."""

import lap
import numpy as np

from seo_slam.backends.cost_matrix import require_cost_matrix
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray


class LapAssignment:
    """JVC. A rectangle is padded to a square, so the cost of a call grows with the number of columns squared."""

    def solve(self, cost: FloatArray) -> IntArray:
        """Return (K,) int64, the column of each row; the sum of their ``cost`` (K, M), M >= K, is least.

        Raises:
            FrameError: a cost is not finite, or there are fewer columns than rows.
        """
        matrix = require_cost_matrix(cost)
        if not matrix.shape[0]:
            return np.zeros(0, dtype=np.int64)
        _, columns, _ = lap.lapjv(matrix, extend_cost=matrix.shape[0] != matrix.shape[1])
        return np.asarray(columns, dtype=np.int64)
