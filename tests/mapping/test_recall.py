"""How often things are found and how long they go unfound, measured from all things at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.mapping.recall import LEAST_VIEWS, WEIGHTS, BetaRate, MeasuredGaps, measured_recall


def drawn(a, b, things, views, seed=0):
    """(hits, misses) of things whose rates come from a Beta distribution."""
    rng = np.random.default_rng(seed)
    hits = rng.binomial(views, rng.beta(a, b, things))
    return [(float(h), float(views - h)) for h in hits]


def mean(rate):
    return rate.a / (rate.a + rate.b)


@pytest.mark.parametrize(("a", "b"), [(6.0, 2.0), (4.0, 4.0), (2.0, 1.0)])
def test_of_drawn_things_the_better_found_three_quarters_are_matched(a, b):
    """The least found quarter is left out as if it were mistakes, so mean and spread are those of the rest."""
    rng = np.random.default_rng(1)
    rates = np.sort(rng.beta(a, b, 4000))[1000:]
    fit = measured_recall(drawn(a, b, 2000, 400))
    assert mean(fit) == pytest.approx(rates.mean(), abs=0.02)
    variance = fit.a * fit.b / ((fit.a + fit.b) ** 2 * (fit.a + fit.b + 1))
    weight = rates.mean() * (1 - rates.mean()) / rates.var() - 1
    if weight < WEIGHTS[1]:
        assert variance == pytest.approx(rates.var(), rel=0.15)
    else:
        assert fit.a + fit.b == pytest.approx(WEIGHTS[1])


def test_nothing_measured_is_a_wide_guess_around_a_half():
    rate = measured_recall([])
    assert mean(rate) == pytest.approx(0.5)
    assert rate.a + rate.b < 3.0


def test_few_things_leave_it_wider_than_many_alike():
    few, many = measured_recall([(18, 2)]), measured_recall([(18, 2)] * 40)
    assert few.a + few.b < many.a + many.b
    assert mean(few) < mean(many) < 0.91


def test_things_hardly_looked_at_say_nothing():
    assert measured_recall([(0, LEAST_VIEWS - 1)] * 50) == measured_recall([])
    assert measured_recall([(LEAST_VIEWS, 0)] * 50) != measured_recall([])


def test_mistakes_among_well_found_things_do_not_spoil_the_rate():
    clean = measured_recall([(19, 1)] * 30)
    spoilt = measured_recall([(19, 1)] * 30 + [(2, 18)] * 6)
    assert mean(spoilt) == pytest.approx(mean(clean), abs=0.02)


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=40))
def test_any_counts_give_a_proper_distribution(counts):
    rate = measured_recall(counts)
    assert rate.a > 0
    assert rate.b > 0
    assert WEIGHTS[0] - 1e-9 <= rate.a + rate.b <= WEIGHTS[1] + 1e-9
    assert measured_recall(reversed(counts)) == rate


def test_a_rate_can_be_compared():
    assert BetaRate(1.0, 2.0) == BetaRate(1.0, 2.0) != BetaRate(2.0, 1.0)


def test_gaps_that_never_were_are_unlikely_and_those_that_often_were_are_not():
    short, long = MeasuredGaps([0, 0, 1, 0, 0] * 40), MeasuredGaps([0, 9, 12, 0, 15] * 40)
    assert short.outlasting(8, []) < 0.01
    assert long.outlasting(8, []) == pytest.approx(0.6, abs=0.05)


def test_nothing_measured_lets_gaps_last():
    none = MeasuredGaps([])
    assert none.outlasting(0, []) == pytest.approx(1.0)
    assert none.outlasting(4, []) > 0.1


def test_a_things_own_gaps_count_beside_all_others():
    gaps = MeasuredGaps([0] * 300)
    assert gaps.outlasting(5, [6, 7, 6, 5]) > 0.5 > gaps.outlasting(5, [])
    assert gaps.outlasting(5, [0] * 20) < gaps.outlasting(5, [])


lengths = st.lists(st.integers(0, 40), max_size=40)


@given(lengths, lengths, st.integers(0, 60))
def test_a_chance_that_falls_with_the_length(gaps, own, length):
    measured = MeasuredGaps(gaps)
    now, later = measured.outlasting(length, own), measured.outlasting(length + 1, own)
    assert 0.0 < later <= now <= 1.0
    assert measured.outlasting(0, own) == pytest.approx(1.0)
