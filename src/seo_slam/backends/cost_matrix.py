"""What both assignment solvers ask of a cost matrix; lap's JVC takes NaN and infinity without a word and answers nonsense."""

import numpy as np
from numpy.typing import ArrayLike

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray


def require_cost_matrix(cost: ArrayLike) -> FloatArray:
    """Return ``cost`` as a C-ordered float64 (K, M).

    Raises:
        FrameError: it is not a matrix, has more rows than columns, or a cost is not finite.
    """
    matrix = np.ascontiguousarray(cost, dtype=np.float64)
    if matrix.ndim != 2 or matrix.shape[0] > matrix.shape[1]:
        raise FrameError(f"assignment: cost is {matrix.shape}, wanted (K, M) with at least as many columns as rows")
    bad = ~np.isfinite(matrix)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        raise FrameError(f"assignment: cost of row {row}, column {column} is {matrix[row, column]}, wanted finite costs")
    return matrix
