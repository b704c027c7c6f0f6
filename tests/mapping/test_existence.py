"""Three explanations of hits and misses: it is there, it never was, it is gone."""

from collections import Counter
from dataclasses import astuple, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.mapping.existence import MOST_FREE_VIEWS, Sightings, believe
from seo_slam.mapping.recall import MeasuredGaps, MeasuredRecall

GOOD = MeasuredRecall([(18, 2)] * 10)
"""A detector that finds most things in most views."""

POOR = MeasuredRecall([(5, 25), (4, 20), (6, 22), (3, 19), (8, 24)])
"""One that finds things in one view of six."""

VANISHING = 0.002

rates = st.builds(MeasuredRecall, st.lists(st.tuples(st.integers(0, 30), st.integers(0, 30)), max_size=6))
counts = st.integers(0, 60)
chances = st.floats(1e-4, 1.0)


@st.composite
def sightings(draw):
    tail = draw(counts)
    return Sightings(draw(counts), draw(counts), tail, draw(st.integers(0, tail)))


def there(seen, rate=GOOD, outlasting=1e-3):
    return believe(seen, rate, outlasting, VANISHING).there


def of(pattern):
    """Sightings of a string of "x" (seen), "." (missed) and "o" (seen through)."""
    seen = Sightings()
    for view in pattern:
        if view == "x":
            seen.hit(should_be_seen=True)
        else:
            seen.miss(seen_through=view == "o")
    return seen


def test_what_is_always_found_and_then_missed_again_and_again_is_gone():
    gaps = MeasuredGaps([Counter([0, 0, 0, 1, 0] * 40)])

    def belief(pattern):
        seen = of(pattern)
        return believe(seen, GOOD, gaps.outlasting(seen.tail, seen.gaps), VANISHING)

    assert belief("x" * 20 + "." * 10).there < 0.2
    assert belief("x" * 20 + "." * 10).gone > 0.8
    assert belief("x" * 20 + ".").there > 0.5


def test_what_is_found_in_one_view_of_six_is_not_gone_after_six():
    """A detector of such a kind, measured by all it finds, leaves gaps of five and more behind everything."""
    seen = of("x.....xx......x....x" + "." * 6)
    gaps = MeasuredGaps([Counter([0, 5, 0, 6, 4, 5, 7, 3, 5, 6, 9, 4] * 5)])
    belief = believe(seen, POOR, gaps.outlasting(seen.tail, seen.gaps), VANISHING)
    assert belief.there > 0.5


def test_what_is_seen_now_and_then_among_things_found_always_never_was():
    belief = believe(of("x....x.....x......"), MeasuredRecall([(30, 0)] * 20), 1e-3, VANISHING)
    assert belief.false > max(belief.there, belief.gone)


def test_nothing_known_speaks_for_it():
    assert there(Sightings(), outlasting=1.0) > 0.5


def test_free_space_counts_more_than_a_miss_but_not_without_end():
    before = "x" * 8
    assert there(of(before + "oo")) < there(of(before + ".."))
    many = of(before + "o" * 30)
    capped = replace(many, free=MOST_FREE_VIEWS)
    assert astuple(believe(many, GOOD, 1e-3, VANISHING)) == astuple(believe(capped, GOOD, 1e-3, VANISHING))


def test_a_hit_ends_the_tail_and_is_remembered_as_a_gap():
    seen = of("xx..o.x")
    assert seen == Sightings(hits=3, misses=4, tail=0, free=0, gaps=Counter([0, 0, 4]))
    seen.hit(should_be_seen=False)
    assert (seen.hits, seen.gaps) == (3, Counter([0, 0, 4, 0]))
    seen.miss(seen_through=True)
    assert (seen.tail, seen.free, seen.misses) == (1, 1, 4)


@given(sightings(), rates, chances, st.floats(1e-4, 0.5))
def test_probabilities_are_such_and_sum_to_one(seen, rate, outlasting, vanishing):
    belief = astuple(believe(seen, rate, outlasting, vanishing))
    assert sum(belief) == pytest.approx(1.0)
    assert all(0.0 <= share <= 1.0 for share in belief)


@given(sightings(), rates, chances)
def test_a_further_free_view_never_speaks_for_it(seen, rate, outlasting):
    more = replace(seen, free=seen.free + 1)
    assert there(more, rate, outlasting) <= there(seen, rate, outlasting) + 1e-12


@given(sightings(), rates, chances, chances)
def test_the_longer_things_go_unfound_the_less_likely_it_is_gone(seen, rate, one, other):
    low, high = sorted((one, other))
    assert believe(seen, rate, high, VANISHING).gone <= believe(seen, rate, low, VANISHING).gone + 1e-12


def test_a_miss_never_makes_a_landmark_likelier():
    """A phantom must not come back by not being seen: mistakes are granted the same streaks as things."""
    recall = MeasuredRecall([(30, 0)] * 4 + [(3, 22)])
    believed = [there(Sightings(3, 22, tail, 0), recall, 0.51) for tail in (0, 5, 11)]
    assert max(believed) < believed[0] + 0.02


@given(sightings(), rates, chances, st.floats(1e-4, 0.4), st.floats(1e-4, 0.4))
def test_where_things_vanish_often_more_are_gone(seen, rate, outlasting, one, other):
    low, high = sorted((one, other))
    assert believe(seen, rate, outlasting, low).gone <= believe(seen, rate, outlasting, high).gone + 1e-12


@given(st.integers(0, 30), st.integers(0, 10), st.integers(0, 30))
def test_a_further_hit_speaks_for_what_is_found_more_often_than_not(misses, tail, more):
    """Of what is found seldom, a hit may speak for a mistake that comes back."""
    hits = misses + tail + more
    now, later = (there(Sightings(h, misses, tail), GOOD, 1.0 / (1 + tail)) for h in (hits, hits + 1))
    assert later >= now - 1e-9


@given(st.integers(1, 40), st.integers(0, 20), st.integers(0, 40))
def test_a_further_miss_speaks_for_gone_rather_than_there(hits, misses, tail):
    """Where gaps are the less likely the longer they are. (Against its being a mistake a miss may speak, too.)"""
    now, later = (believe(Sightings(hits, misses, t), GOOD, 0.5**t, VANISHING) for t in (tail, tail + 1))
    assert later.there * now.gone <= now.there * later.gone * (1 + 1e-9)


@given(sightings(), sightings())
def test_two_halves_make_no_more_views_than_the_longer_had(one, other):
    whole = one.merged(other)
    assert whole.hits + whole.misses == max(one.hits + one.misses, other.hits + other.misses)
    assert whole.hits >= max(one.hits, other.hits)
    assert whole.misses >= 0
    assert whole.tail == min(one.tail, other.tail)
    assert (whole.hits, whole.misses, whole.tail) == (lambda swapped: (swapped.hits, swapped.misses, swapped.tail))(other.merged(one))


def test_a_poor_detectors_things_live_where_a_good_ones_would_be_gone():
    """The same sightings, and what else was seen while they were made."""
    seen = of("x....x...x...x" + "." * 12)
    assert there(seen, POOR, 0.2) > there(seen, GOOD, 0.2)


def test_a_part_has_no_more_hits_than_observations():
    whole = of("xxxxxx..x")
    part = whole.of_a_part(3)
    assert (part.hits, part.misses, part.gaps) == (3, whole.misses, whole.gaps)
    part.hit(should_be_seen=True)
    assert whole == of("xxxxxx..x")
    assert whole.of_a_part(50).hits == whole.hits
