"""Every registered assignment solver keeps the contract, and the check notices those that do not."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from seo_slam import registry
from seo_slam.testing import check_assignment_solver


@pytest.mark.parametrize("name", registry.known("assignment_solver"))
def test_contract(name):
    check_assignment_solver(registry.create("assignment_solver", name))


class Greedy:
    """Each row takes the cheapest column that is left."""

    def solve(self, cost):
        cost = cost.copy()
        columns = np.zeros(len(cost), np.int64)
        for row in range(len(cost)):
            columns[row] = np.argmin(cost[row])
            cost[:, columns[row]] = np.inf
        return columns


class Unchecked:
    """Scipy's solver without our errors."""

    def solve(self, cost):
        return np.asarray(linear_sum_assignment(cost)[1], np.int64)


class SharesColumns:
    """Each row takes the cheapest column, taken or not."""

    def solve(self, cost):
        return np.argmin(cost, axis=1) if len(cost) else np.zeros(0, np.int64)


class Floats(Unchecked):
    def solve(self, cost):
        return super().solve(cost).astype(float)


class Scribbles(Unchecked):
    def solve(self, cost):
        columns = super().solve(cost)
        cost[...] = 0
        return columns


@pytest.mark.parametrize(
    ("solver", "words"),
    [
        (Greedy, "the least is"),
        (SharesColumns, "different ones"),
        (Floats, "wanted kind 'i'"),
        (Scribbles, "changed the cost"),
        (object, "solve"),
    ],
)
def test_broken_ones_are_noticed(solver, words):
    with pytest.raises(AssertionError, match=words):
        check_assignment_solver(solver())


def test_one_that_takes_anything_is_noticed():
    class TakesAnything(Unchecked):
        def solve(self, cost):
            return super().solve(np.nan_to_num(cost[: cost.shape[1]]))

    with pytest.raises(AssertionError, match="did not raise FrameError"):
        check_assignment_solver(TakesAnything())
