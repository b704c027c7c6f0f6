"""Contract of an ``AssignmentSolver``."""

from itertools import permutations

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import AssignmentSolver
from seo_slam.testing.clauses import require, require_array


def check_assignment_solver(solver: AssignmentSolver) -> None:
    """Check that a solver finds the least total cost and refuses what has none.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(solver, AssignmentSolver), solver, "has no method solve(cost)")
    rng = np.random.default_rng(7)
    for K, M in ((1, 1), (1, 4), (2, 2), (3, 4), (4, 4), (4, 6)):
        for cost in (rng.random((K, M)), rng.normal(0.0, 100.0, (K, M)), rng.integers(0, 3, (K, M)).astype(float), np.zeros((K, M))):
            _check_optimum(solver, cost)
    for M in (0, 5):
        require_array(solver.solve(np.zeros((0, M))), (0,), "i", solver, f"the solution of a (0, {M}) cost")
    _check_dummies(solver, rng)
    for wrong in (np.array([[1.0, np.nan]]), np.array([[np.inf, np.inf]]), np.array([[-np.inf, 1.0]]), np.zeros((3, 2))):
        try:
            solver.solve(wrong)
        except FrameError:
            continue
        raise AssertionError(f"{type(solver).__name__}: solve({wrong.tolist()}) did not raise FrameError")


def _check_optimum(solver: AssignmentSolver, cost: FloatArray) -> None:
    K, M = cost.shape
    given = cost.copy()
    columns = solver.solve(cost)
    require(np.array_equal(given, cost), solver, "solve changed the cost matrix")
    require_array(columns, (K,), "i", solver, "the solution")
    legal = len(set(columns.tolist())) == K and columns.min() >= 0 and columns.max() < M
    require(bool(legal), solver, f"the columns {columns.tolist()} are not {K} different ones of 0..{M - 1}")
    least = min(sum(cost[k, c] for k, c in enumerate(choice)) for choice in permutations(range(M), K))
    total = float(cost[np.arange(K), columns].sum())
    require(total <= least + 1e-9 * (1.0 + abs(least)), solver, f"the total cost of {given.tolist()} is {total}, the least is {least}")


def _check_dummies(solver: AssignmentSolver, rng: np.random.Generator) -> None:
    """The association's form: landmark columns, then one private column an observation, all else forbidden by a large cost."""
    K, N, dummy, forbidden = 3, 2, 20.0, 1e6
    for _ in range(20):
        cost = np.full((K, N + K), forbidden)
        cost[:, :N] = np.where(rng.random((K, N)) < 0.6, rng.uniform(0.0, 15.0, (K, N)), forbidden)
        cost[np.arange(K), N + np.arange(K)] = dummy
        _check_optimum(solver, cost)
