"""Information-weighted means of many points at once, with a Cauchy loss: a few steps of iteratively reweighted least squares."""

import numpy as np

from seo_slam.geometry import FloatArray

COLUMNS = 10
"""A measurement: the point (3), the upper triangle of its information (6, row by row), and its looseness ``1 / k**2``.

``k`` is the scale of the Cauchy loss in standard deviations; a looseness of 0 is no loss at all, just least squares.
"""

_MOST_STEPS = 8
_SETTLED_M = 1e-4  # a step that short is the last one; what is left is a small part of it

_UPPER = np.triu_indices(3)
_SQUARE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
_TWICE_OFF_DIAGONAL = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])


def rows_of(p: FloatArray, information: FloatArray, looseness: float) -> FloatArray:
    """Return (K, COLUMNS) rows of points (K, 3) with their information (K, 3, 3)."""
    return np.column_stack([p, information[:, _UPPER[0], _UPPER[1]], np.full(len(p), looseness)])


def robust_means(rows: FloatArray, counts: list[int]) -> tuple[FloatArray, FloatArray]:
    """Return the mean (L, 3) and its information (L, 3, 3) of L groups of measurements.

    Each group starts from its plain mean and takes the same steps whatever the other groups are and in whatever order its
    measurements stand. So the result depends on the set alone, also where the loss has more than one minimum.

    Args:
        rows: (sum of counts, COLUMNS), group after group.
        counts: L numbers of measurements, all above 0.
    """
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    group = np.repeat(np.arange(len(counts)), counts)
    p, upper, looseness = rows[:, :3], rows[:, 3:9], rows[:, 9]
    middle, information = _solve(np.add.reduceat(_pulled(p, upper), first))
    if not looseness.any():
        return middle, information
    p = p - middle[group]  # from here on positions are relative to the plain means
    pulled = _pulled(p, upper)
    # The squared residual of a point at m is linear in the products of m's coordinates, in m, and in 1.
    squared = np.column_stack([upper, pulled[:, 6:], np.einsum("ni,ni->n", p, pulled[:, 6:])])
    mean, going = np.zeros_like(middle), np.ones(len(counts), dtype=np.bool_)
    last, factors = np.zeros_like(middle), np.ones((len(counts), COLUMNS))
    for _ in range(_MOST_STEPS):
        factors[:, :6], factors[:, 6:9] = _products(mean), -2.0 * mean
        weights = 1.0 / (1.0 + looseness * np.einsum("ni,ni->n", squared, factors[group]))
        better, weighted = _solve(np.add.reduceat(weights[:, None] * pulled, first))
        step = better - mean
        information = np.where(going[:, None, None], weighted, information)
        mean = mean + going[:, None] * _lengthened(step, last)
        going &= np.abs(step).max(axis=1) > _SETTLED_M
        if not going.any():
            break
        last = step
    return middle + mean, information


def cauchy_weights(residual: FloatArray, upper: FloatArray, looseness: FloatArray) -> FloatArray:
    """Return ``1 / (1 + r^T I r / k**2)`` (N,) of residuals (N, 3), information (N, 6) and looseness (N,)."""
    return np.asarray(1.0 / (1.0 + looseness * np.einsum("ni,ni->n", _products(residual), upper)), dtype=np.float64)


def _lengthened(step: FloatArray, last: FloatArray) -> FloatArray:
    """Steps (L, 3) as long as the steps before let expect in all, but less than doubled: the loss then still falls with each.

    (Each step goes to the lowest point of a parabola above the loss that touches it; up to twice as far that parabola is lower, too.)
    """
    shrinks = np.einsum("li,li->l", step, last) / np.maximum(np.einsum("li,li->l", last, last), 1e-30)
    return np.asarray(step / (1.0 - np.minimum(np.maximum(shrinks, 0.0), 0.49))[:, None], dtype=np.float64)


def square(upper: FloatArray) -> FloatArray:
    """Return (N, 3, 3) symmetric matrices from their upper triangles (N, 6)."""
    return np.asarray(upper[:, _SQUARE], dtype=np.float64)


def _products(v: FloatArray) -> FloatArray:
    """(N, 6): so that its row product with an upper triangle is ``v^T I v``."""
    return np.asarray(v[:, _UPPER[0]] * v[:, _UPPER[1]] * _TWICE_OFF_DIAGONAL, dtype=np.float64)


def _pulled(p: FloatArray, upper: FloatArray) -> FloatArray:
    """(N, 9): information and information times point; what is summed up."""
    return np.concatenate([upper, np.einsum("nij,nj->ni", upper[:, _SQUARE], p)], axis=1)


def _solve(sums: FloatArray) -> tuple[FloatArray, FloatArray]:
    """From summed information (L, 6) and information times point (L, 3) to the points and the information (L, 3, 3)."""
    information = square(sums[:, :6])
    p = np.asarray(np.linalg.solve(information, sums[:, 6:, None])[..., 0], dtype=np.float64)
    return p, information
