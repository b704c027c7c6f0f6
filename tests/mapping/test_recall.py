"""How often things are found and how long they go unfound, measured from all things at once."""

from collections import Counter
from math import comb, exp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.mapping.recall import LEAST_VIEWS, MeasuredGaps, MeasuredRecall


def drawn(a, b, things, views, seed=0):
    """(hits, misses) of things whose rates come from a Beta distribution."""
    rng = np.random.default_rng(seed)
    hits = rng.binomial(views, rng.beta(a, b, things))
    return [(float(h), float(views - h)) for h in hits]


def chance(recall, hits, misses):
    return exp(recall.log_likelihood(hits, misses))


@pytest.mark.parametrize(("a", "b"), [(6.0, 2.0), (4.0, 4.0), (2.0, 1.0)])
def test_of_drawn_things_the_better_found_three_quarters_are_matched(a, b):
    """The least found quarter is left out as if it were mistakes, so hit and miss come as often as of the rest."""
    rates = np.sort(np.random.default_rng(1).beta(a, b, 4000))[1000:]
    recall = MeasuredRecall(drawn(a, b, 2000, 400))
    assert chance(recall, 1, 0) == pytest.approx(rates.mean(), abs=0.05)
    assert chance(recall, 2, 0) == pytest.approx((rates**2).mean(), abs=0.08)
    assert chance(recall, 0, 2) == pytest.approx(((1 - rates) ** 2).mean(), abs=0.08)


def test_nothing_measured_is_a_wide_guess_around_a_half():
    none = MeasuredRecall([])
    assert chance(none, 1, 0) == pytest.approx(0.5)
    assert chance(none, 20, 0) > 0.05 < chance(none, 0, 20)


def test_few_things_leave_it_wider_than_many_alike():
    few, many = MeasuredRecall([(18, 2)]), MeasuredRecall([(18, 2)] * 40)
    assert chance(few, 1, 0) < chance(many, 1, 0) < 0.95
    assert chance(few, 2, 18) > 10 * chance(many, 2, 18)


def test_things_hardly_looked_at_say_nothing():
    def after(count):
        return MeasuredRecall([count] * 50).log_likelihood(3, 1)

    assert after((0, LEAST_VIEWS - 1)) == MeasuredRecall([]).log_likelihood(3, 1) != after((LEAST_VIEWS, 0))


def test_mistakes_among_well_found_things_do_not_spoil_the_rate():
    clean = MeasuredRecall([(19, 1)] * 30)
    spoilt = MeasuredRecall([(19, 1)] * 30 + [(2, 18)] * 6)
    assert chance(spoilt, 0, 4) == pytest.approx(chance(clean, 0, 4), rel=0.3)


def test_where_some_things_are_hardly_found_a_hardly_found_one_is_not_strange():
    both, good = MeasuredRecall([(58, 2)] * 20 + [(12, 48)] * 15), MeasuredRecall([(58, 2)] * 35)
    assert chance(both, 4, 16) > 3 * chance(good, 4, 16)
    assert chance(both, 20, 0) < chance(good, 20, 0)


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=40), st.integers(1, 12))
def test_all_that_can_come_of_some_views_sums_to_one(counts, views):
    recall = MeasuredRecall(counts)
    assert sum(comb(views, hits) * chance(recall, hits, views - hits) for hits in range(views + 1)) == pytest.approx(1.0)
    assert MeasuredRecall(reversed(counts)).log_likelihood(2, 1) == recall.log_likelihood(2, 1)


def measured(gaps):
    """Gaps of two things that share them."""
    return MeasuredGaps([Counter(gaps[::2]), Counter(gaps[1::2])])


def test_gaps_that_never_were_are_unlikely_and_those_that_often_were_are_not():
    short, long = measured([0, 0, 1, 0, 0] * 40), measured([0, 9, 12, 0, 15] * 40)
    assert short.outlasting(8, {}) < 0.01
    assert long.outlasting(8, {}) == pytest.approx(0.6, abs=0.05)


def test_nothing_measured_lets_gaps_last():
    none = MeasuredGaps([])
    assert none.outlasting(0, {}) == pytest.approx(1.0)
    assert none.outlasting(4, {}) > 0.1


def test_a_things_own_gaps_count_beside_all_others():
    gaps = measured([0] * 300)
    assert gaps.outlasting(5, Counter([6, 7, 6, 5])) > 0.5 > gaps.outlasting(5, {})
    assert gaps.outlasting(5, Counter({0: 20})) < gaps.outlasting(5, {})


lengths = st.lists(st.integers(0, 40), max_size=40)


@given(lengths, lengths, st.integers(0, 60))
def test_a_chance_that_falls_with_the_length(gaps, own, length):
    of_all, its = measured(gaps), Counter(own)
    now, later = of_all.outlasting(length, its), of_all.outlasting(length + 1, its)
    assert 0.0 < later <= now <= 1.0
    assert of_all.outlasting(0, its) == pytest.approx(1.0)
