"""Both solvers find the same optimum, whatever the matrix."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seo_slam.backends.lap_assignment import LapAssignment
from seo_slam.backends.scipy_assignment import ScipyAssignment
from seo_slam.errors import FrameError

SOLVERS = (ScipyAssignment(), LapAssignment())
costs = st.one_of(st.floats(-1e3, 1e3), st.integers(0, 2).map(float), st.sampled_from([0.0, 11.34, 1e6]))
shapes = st.integers(0, 7).flatmap(lambda k: st.tuples(st.just(k), st.integers(k, 9)))


@given(arrays(np.float64, shapes, elements=costs))
def test_same_optimum(cost):
    totals = []
    for solver in SOLVERS:
        columns = solver.solve(cost)
        assert columns.dtype == np.int64
        assert len(set(columns.tolist())) == len(cost)
        totals.append(cost[np.arange(len(cost)), columns].sum())
    assert totals[0] == pytest.approx(totals[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("order", ["C", "F"])
def test_views_and_integers_are_taken(solver, order):
    cost = np.asarray([[4, 1, 3], [2, 4, 5]], order=order)
    assert solver.solve(cost).tolist() == [1, 0]
    assert solver.solve(np.repeat(cost, 2, axis=1)[:, ::2]).tolist() == [1, 0]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize(
    ("cost", "words"),
    [
        ([[0.0, np.nan]], "row 0, column 1 is nan"),
        ([[0.0], [1.0]], r"\(2, 1\)"),
        ([1.0, 2.0], r"\(2,\)"),
        ([[np.inf, 1.0]], "column 0 is inf"),
    ],
)
def test_what_has_no_optimum_is_refused(solver, cost, words):
    with pytest.raises(FrameError, match=words):
        solver.solve(np.array(cost))
