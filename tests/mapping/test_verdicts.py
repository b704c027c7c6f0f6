"""Laws of what is believed of a landmark after agents spoke."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.mapping import verdicts
from seo_slam.mapping.verdicts import ANOTHER, Verdict, Verdicts

WORDS = ("cup", "mug", "book")
some_weights = st.dictionaries(st.sampled_from(WORDS), st.floats(1e-3, 50.0), max_size=3)
existences = st.floats(0.0, 1.0)


@st.composite
def verdicts_of(draw, who=("a m", "b m"), sides=range(8)):
    kind = draw(st.sampled_from(["confirm", "doubt", "remove", "name"]))
    word = "" if kind == "remove" else draw(st.sampled_from(WORDS))
    return Verdict(draw(st.sampled_from(who)), kind, word, draw(st.sampled_from(sides)))


def weigh(heard, landmark_id=0, existence=0.999, weights=None, seen=50):
    return heard.belief(landmark_id, existence=existence, observations=seen, weights={"cup": 20.0} if weights is None else weights)


def believed(said, existence=0.9, weights=None, heard=None):
    heard = heard or Verdicts()
    for verdict in said:
        heard.hear(0, verdict)
    return weigh(heard, 0, existence, {"cup": 3.0} if weights is None else weights)


def taught(right, wrong):
    """Verdicts of a run in which one model agreed with what is sure, and one contradicted it."""
    heard = Verdicts()
    for landmark_id in range(100, 130):
        heard.hear(landmark_id, Verdict(right, "confirm", "cup", 0))
        heard.hear(landmark_id, Verdict(wrong, "remove", "", 0))
        weigh(heard, landmark_id)
    return heard


@given(st.lists(verdicts_of(), max_size=12), existences, some_weights)
@settings(max_examples=100, deadline=None)
def test_belief_is_a_distribution_over_nothing_and_words(said, existence, weights):
    belief = believed(said, existence, weights)
    assert belief.nothing + sum(belief.words.values()) == pytest.approx(1.0)
    assert min(belief.nothing, *belief.words.values()) >= 0.0
    assert set(belief.words) == set(weights) | {v.word for v in said if v.kind == "name"} | {ANOTHER}
    assert belief.best in belief.words


@given(st.lists(verdicts_of(), max_size=8), st.randoms(use_true_random=False), existences, some_weights)
@settings(max_examples=100, deadline=None)
def test_the_order_in_which_things_are_said_does_not_matter(said, random, existence, weights):
    mixed = list(said)
    random.shuffle(mixed)
    one, other = believed(said, existence, weights), believed(mixed, existence, weights)
    assert one.nothing == pytest.approx(other.nothing)
    assert dict(one.words) == pytest.approx(dict(other.words))


@given(st.lists(verdicts_of(sides=range(7)), max_size=6), existences, some_weights, st.sampled_from(WORDS))
@settings(max_examples=100, deadline=None)
def test_a_confirmation_from_a_new_side_never_speaks_for_nothing(said, existence, weights, word):
    before = believed(said, existence, weights)
    after = believed([*said, Verdict("c m", "confirm", word, 7)], existence, weights)
    assert after.nothing <= before.nothing + 1e-9


@given(st.lists(verdicts_of(sides=range(7)), max_size=6), existences, some_weights)
@settings(max_examples=100, deadline=None)
def test_a_denial_from_a_new_side_always_does(said, existence, weights):
    before = believed(said, existence, weights)
    after = believed([*said, Verdict("c m", "remove", "", 7)], existence, weights)
    assert after.nothing >= before.nothing - 1e-9


def test_without_verdicts_it_is_what_the_detector_says():
    belief = believed([], weights={"cup": 3.0, "mug": 1.0})
    assert belief.best == "cup"
    assert belief.nothing < 0.1


def test_a_name_that_nobody_but_the_agent_said_wins_with_enough_verdicts():
    said = [Verdict("a m", "name", "jug", side) for side in range(4)]
    assert believed(said[:1]).words["jug"] < believed(said).words["jug"]
    assert believed(said).best == "jug"


def test_from_one_side_the_same_again_adds_little():
    one, same = [Verdict("a m", "remove", "", 0)], [Verdict("a m", "remove", "", 0)] * 3
    sides = [Verdict("a m", "remove", "", side) for side in range(3)]
    assert believed(one).nothing < believed(same).nothing < believed(sides).nothing


def test_what_was_seen_more_often_is_harder_to_argue_away():
    few, many = Verdicts(), Verdicts()
    for heard in (few, many):
        heard.hear(0, Verdict("a m", "remove", "", 0))
    assert weigh(many, seen=50).nothing <= weigh(few, seen=2).nothing
    assert weigh(few, existence=0.99).nothing < weigh(many, existence=0.3).nothing


def test_who_contradicts_what_is_sure_is_believed_less():
    heard = taught("good m", "bad m")
    assert heard.reliability("bad m") < heard.reliability("new m") < heard.reliability("good m")
    good = believed([Verdict("good m", "remove", "", 0)], heard=taught("good m", "bad m"))
    bad = believed([Verdict("bad m", "remove", "", 0)], heard=taught("good m", "bad m"))
    assert bad.nothing < good.nothing
    named = believed([Verdict("good m", "name", "jug", 0)], heard=taught("good m", "bad m"))
    misnamed = believed([Verdict("bad m", "name", "jug", 0)], heard=taught("good m", "bad m"))
    assert misnamed.words["jug"] < named.words["jug"]


@given(st.integers(1, 300))
@settings(max_examples=20, deadline=None)
def test_a_model_that_only_denies_never_argues_away_what_is_sure(times):
    """However often it says so from all sides; each landmark has one verdict from each."""
    heard = Verdicts()
    for landmark_id in range(times):
        heard.hear(landmark_id, Verdict("bad m", "remove", "", landmark_id % 8))
        assert weigh(heard, landmark_id).nothing < 0.9


def test_reliability_counts_each_landmark_as_it_is_believed_now():
    heard = Verdicts()
    heard.hear(0, Verdict("a m", "confirm", "cup", 0))
    weigh(heard)
    once = heard.reliability("a m")
    for _ in range(50):
        weigh(heard)  # thinking again is no new evidence
    assert heard.reliability("a m") == pytest.approx(once, abs=1e-3)


def test_what_was_said_of_two_halves_counts_for_the_whole_but_denials_of_the_half_that_goes():
    heard = Verdicts()
    heard.hear(0, Verdict("a m", "confirm", "cup", 0))
    heard.hear(1, Verdict("a m", "name", "mug", 1))
    heard.hear(1, Verdict("a m", "remove", "", 2))
    heard.merge(0, 1)
    assert [v.kind for v in heard.of(0)] == ["confirm", "name"]
    assert [heard.is_judged(i) for i in (0, 1)] == [True, False]
    heard.merge(0, 7)  # of which nothing was said
    assert len(heard.of(0)) == 2


def test_what_was_said_is_forgotten_with_the_landmark_but_not_who_was_right():
    heard = taught("good m", "bad m")
    before = heard.reliability("good m")
    assert len(heard.forget(100)) == 2
    assert heard.of(100) == ()
    assert heard.forget(100) == ()
    assert heard.reliability("good m") == before


def test_a_long_run_makes_believing_no_dearer(monkeypatch):
    calls = []
    monkeypatch.setattr(verdicts, "_chance", lambda *args: calls.append(args) or 0.5)
    heard, asked = Verdicts(), []
    for view in range(400):
        heard.hear(0, Verdict("a m", "confirm", "cup", view % 4, view))
        calls.clear()
        weigh(heard)
        asked.append(len(calls))
    assert asked[3] == asked[-1]
    assert len(heard.of(0)) == verdicts.MOST_VERDICTS
