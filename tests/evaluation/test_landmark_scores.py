"""Protocol landmarks/1: who matches whom, what is counted, and its laws."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.errors import EvaluationError, FrameError
from seo_slam.evaluation.ceilings import geometry_ceiling, oracle_ceiling, share_of_way
from seo_slam.evaluation.labels import LabelRule
from seo_slam.evaluation.landmarks import FormerPlace, Truth, TruthObject, assign, evaluate_landmarks, moved
from seo_slam.geometry import exp
from seo_slam.types import Landmark


def landmark(number, label, position, state="stable"):
    return Landmark(
        id=number,
        label=label,
        labels={label: 1.0},
        position_m=np.array(position, dtype=float),
        covariance_m2=np.diag([1e-4, 2e-4, 3e-4]),
        size_m=np.array([0.1, 0.2, 0.3]),
        embedding=np.zeros(2),
        observations=5,
        first_seen_s=0.0,
        last_seen_s=1.0,
        state=state,
    )


def thing(name, label, *centers, half=0.0, seen=None):
    return TruthObject(name, (label,), np.array(centers, dtype=float), half, seen)


CUP, BOOK = thing("c", "cup", (0, 0, 0)), thing("b", "book", (1, 0, 0))


def brute_force(distance_m, allowed):
    """The best (count, sum) over all one-to-one partial assignments."""
    n, m = distance_m.shape
    best = (0, 0.0)
    for columns in itertools.product([None, *range(m)], repeat=n):
        pairs = [(i, j) for i, j in enumerate(columns) if j is not None]
        if len({j for _, j in pairs}) < len(pairs) or not all(allowed[i, j] for i, j in pairs):
            continue
        total = sum(distance_m[i, j] for i, j in pairs)
        if (len(pairs), -total) > (best[0], -best[1]):
            best = (len(pairs), total)
    return best


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 4), st.floats(0.0, 1.0))
def test_assignment_is_the_best_there_is(seed, n, m, share):
    rng = np.random.default_rng(seed)
    distance_m, allowed = rng.uniform(0, 1, (n, m)), rng.uniform(size=(n, m)) < share
    pairs = assign(distance_m, allowed)
    assert len({i for i, _ in pairs}) == len({j for _, j in pairs}) == len(pairs)
    assert all(allowed[pair] for pair in pairs)
    count, total = brute_force(distance_m, allowed)
    assert len(pairs) == count
    assert sum(distance_m[pair] for pair in pairs) == pytest.approx(total)


def test_number_of_matches_comes_before_distance():
    # The nearer pair alone would be 0.0 m; two matches are worth more, though they are 0.19 + 0.19 m.
    truth = Truth((thing("left", "cup", (0, 0, 0)), thing("right", "cup", (0.19, 0, 0))))
    result = evaluate_landmarks([landmark(1, "cup", (0.19, 0, 0)), landmark(2, "cup", (0.38, 0, 0))], truth)
    assert [(pair.object_id, pair.landmark_id) for pair in result.matched] == [("left", 1), ("right", 2)]


def test_counts_and_ratios():
    truth = Truth((CUP, BOOK, thing("t", "tv", (2, 0, 0))))
    found = [
        landmark(1, "cup", (0.05, 0, 0)),
        landmark(2, "cup", (0.1, 0, 0)),
        landmark(3, "book", (1.3, 0, 0)),
        landmark(4, "tv", (2, 0, 0), state="tentative"),
    ]
    result = evaluate_landmarks(found, truth)
    assert result.protocol == "landmarks/1"
    assert (result.score.landmarks, result.score.objects, result.score.matched, result.tentative) == (3, 3, 1, 1)
    assert (result.score.precision, result.score.recall) == (pytest.approx(1 / 3), pytest.approx(1 / 3))
    assert result.score.f1 == pytest.approx(1 / 3)
    assert (result.score.false_positives, result.duplicates, result.ghosts) == (2, 1, 0)
    assert [(item.landmark_id, item.kind, item.of) for item in result.extra] == [(2, "duplicate", "c"), (3, "false", None)]
    assert result.extra[1].nearest_object_id == "b"
    assert result.extra[1].nearest_m == pytest.approx(0.3)
    assert [(gone.object_id, gone.nearest_landmark_id) for gone in result.missing] == [("b", 3), ("t", 3)]
    assert [(row.radius_m, row.matched) for row in result.sweep] == [(0.1, 1), (0.2, 1), (0.3, 1), (0.5, 2)]


def test_radius_or_half_the_smaller_horizontal_extent():
    table = thing("t", "table", (0, 0, 0), half=0.4)
    near, far = landmark(1, "table", (0.39, 0, 0)), landmark(1, "table", (0.41, 0, 0))
    assert evaluate_landmarks([near], Truth((table,))).score.matched == 1
    assert evaluate_landmarks([far], Truth((table,))).score.matched == 0
    assert evaluate_landmarks([far], Truth((table,)), radius_m=0.45).score.matched == 1
    assert evaluate_landmarks([landmark(1, "cup", (0.21, 0, 0))], Truth((CUP,))).score.matched == 0


def test_the_nearer_centre_counts():
    monitor = thing("m", "tv", (0, 0, 0), (0.5, 0, 0))
    result = evaluate_landmarks([landmark(1, "tv", (0.52, 0, 0))], Truth((monitor,)))
    assert result.matched[0].distance_m == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("rule", "word", "agrees"),
    [
        (LabelRule.exact(), "Tape_Measure", True),
        (LabelRule.exact(), "tapemeasure", True),
        (LabelRule.exact(), "ruler", False),
        (LabelRule.exact(), "", False),
        (LabelRule.synonyms([["ruler", "tape measure"], ["ruler", "stick"]]), "RULER", True),
        (LabelRule.synonyms([["ruler", "tape measure"], ["ruler", "stick"]]), "stick", False),
        (LabelRule.synonyms([["ruler", "stick"]]), "tape measure", True),
        (LabelRule.geometry(), "elephant", True),
        (LabelRule.geometry(), "", True),
    ],
)
def test_label_rules(rule, word, agrees):
    assert rule.agree((word,) if word else (), ("tape measure",)) is agrees
    scored = evaluate_landmarks([landmark(1, word, (0, 0, 0))], Truth((thing("x", "tape measure", (0, 0, 0)),)), rule)
    assert scored.score.matched == int(agrees)


def test_truth_may_spell_accents_otherwise_than_the_map():
    assert LabelRule.exact().agree(("caf\u00e9",), ("cafe\u0301",))


def test_any_accepted_label_and_the_category_count():
    truth = Truth((TruthObject("c", ("red cup", "cup"), np.zeros((1, 3))),))
    assert evaluate_landmarks([landmark(1, "cup", (0, 0, 0))], truth).score.matched == 1
    described = SimpleNamespace(id=1, label="chipped coffee mug", category="cup", position_m=np.zeros(3), state="stable")
    assert evaluate_landmarks([described], truth).score.matched == 1
    described.category = "plate"
    assert evaluate_landmarks([described], truth).score.matched == 0


def test_the_rule_is_stated():
    groups = LabelRule.synonyms([["tv", "monitor"]], "words.json")
    assert evaluate_landmarks([], Truth((CUP,)), groups).label_rule == "synonyms:words.json"
    assert evaluate_landmarks([], Truth((CUP,))).label_rule == "exact"
    with pytest.raises(EvaluationError, match="group 0"):
        LabelRule.synonyms([["tv", "TV"]])


def test_ghosts_of_removed_and_moved_objects():
    places = (
        FormerPlace("gone", "removed", ("vase",), np.array([3.0, 0, 0])),
        FormerPlace("unnamed", "removed", (), np.array([4.0, 0, 0])),
        FormerPlace("b", "moved", ("book",), np.array([5.0, 0, 0])),
        FormerPlace("b", "moved", ("book",), np.array([1.0, 0, 0])),  # where it is now: no ghost
    )
    found = [
        landmark(1, "vase", (3.1, 0, 0)),
        landmark(2, "cup", (3.1, 0, 0)),
        landmark(3, "anything", (4, 0, 0)),
        landmark(4, "book", (5, 0, 0)),
        landmark(5, "book", (1, 0, 0)),
        landmark(6, "book", (1.1, 0, 0)),
        landmark(7, "vase", (3.3, 0, 0)),
    ]
    result = evaluate_landmarks(found, Truth((CUP, BOOK), places))
    kinds = {item.landmark_id: (item.kind, item.of) for item in result.extra}
    assert kinds == {
        1: ("ghost", "gone"),
        2: ("false", None),
        3: ("ghost", "unnamed"),
        4: ("ghost", "b"),
        6: ("duplicate", "b"),
        7: ("false", None),
    }
    assert (result.ghosts, result.duplicates, result.score.false_positives) == (3, 1, 6)


def test_of_two_places_that_fit_the_nearer_decides_between_ghost_and_duplicate():
    # Like things stand close together: one of two cups, 16 cm apart, was taken away.
    places = (FormerPlace("gone", "removed", ("cup",), np.array([0.16, 0, 0])),)
    found = [landmark(1, "cup", (0, 0, 0)), landmark(2, "cup", (0.15, 0, 0)), landmark(3, "cup", (0.02, 0, 0))]
    result = evaluate_landmarks(found, Truth((CUP,), places))
    assert {item.landmark_id: (item.kind, item.of) for item in result.extra} == {2: ("ghost", "gone"), 3: ("duplicate", "c")}


def test_a_ghost_of_a_large_thing_is_one_within_half_its_extent():
    places = (FormerPlace("t", "removed", ("table",), np.array([3.0, 0, 0]), 0.4),)
    assert evaluate_landmarks([landmark(1, "table", (3.35, 0, 0))], Truth((CUP,), places)).ghosts == 1
    assert evaluate_landmarks([landmark(1, "table", (3.45, 0, 0))], Truth((CUP,), places)).ghosts == 0


def test_a_moved_thing_with_landmarks_at_both_places_has_one_match_and_one_ghost():
    places = (FormerPlace("b", "moved", ("book",), np.array([5.0, 0, 0])), FormerPlace("b", "moved", ("book",), np.array([1.0, 0, 0])))
    result = evaluate_landmarks([landmark(1, "book", (5, 0, 0)), landmark(2, "book", (1, 0, 0))], Truth((CUP, BOOK), places))
    assert [(pair.landmark_id, pair.object_id) for pair in result.matched] == [(2, "b")]
    assert (result.ghosts, result.duplicates, result.false) == (1, 0, 0)


def test_objects_in_view_are_counted_apart_when_the_truth_says_so():
    truth = Truth((thing("c", "cup", (0, 0, 0), seen=5), thing("b", "book", (1, 0, 0), seen=4)))
    score = evaluate_landmarks([landmark(1, "cup", (0, 0, 0)), landmark(2, "book", (1, 0, 0))], truth).score
    assert (score.objects, score.matched, score.visible_objects, score.visible_matched) == (2, 2, 1, 1)
    assert evaluate_landmarks([], Truth((CUP,))).score.visible_objects is None
    assert evaluate_landmarks([], Truth((CUP,))).score.visible is None


def test_a_landmark_on_a_seldom_seen_object_is_neither_right_nor_wrong_but_a_second_one_is_false():
    truth = Truth((thing("c", "cup", (0, 0, 0), seen=5), thing("b", "book", (1, 0, 0), seen=4), thing("t", "tv", (2, 0, 0), seen=9)))
    found = [landmark(1, "cup", (0, 0, 0)), landmark(2, "book", (1, 0, 0)), landmark(3, "book", (1.1, 0, 0)), landmark(4, "cup", (9, 0, 0))]
    score = evaluate_landmarks(found, truth).score
    assert (score.landmarks, score.objects, score.matched) == (4, 3, 2)
    assert (score.visible.landmarks, score.visible.objects, score.visible.matched) == (3, 2, 1)
    assert (score.visible.precision, score.visible.recall, score.visible.f1) == (pytest.approx(1 / 3), 0.5, pytest.approx(0.4))
    assert score.visible.false_positives == score.false_positives == 2
    alone = evaluate_landmarks([landmark(2, "book", (1, 0, 0))], Truth((thing("b", "book", (1, 0, 0), seen=0),))).score
    assert (alone.f1, alone.visible.landmarks, alone.visible.objects, alone.visible.f1) == (1.0, 0, 0, 0.0)


def test_a_count_of_the_callers_own_is_reported_beside_the_others():
    result = evaluate_landmarks([landmark(1, "cup", (0, 0, 0))], Truth((CUP, BOOK)), truth_count=4)
    assert (result.score.recall, result.score.given.recall, result.score.given.precision) == (0.5, 0.25, 1.0)
    assert [row.given.objects for row in result.sweep] == [4, 4, 4, 4]
    assert evaluate_landmarks([], Truth((CUP,))).score.given is None
    for bad, matched in ((0, 0), (1, 2)):
        rows = [landmark(1, "cup", (0, 0, 0)), landmark(2, "book", (1, 0, 0))][:matched]
        with pytest.raises(EvaluationError, match=f"truth_count: got {bad}, .* the {matched} objects matched"):
            evaluate_landmarks(rows, Truth((CUP, BOOK)), truth_count=bad)


def rows_of(result):
    return {row.label: (row.objects, row.matched, row.missing, row.duplicates, row.ghosts, row.false) for row in result.per_class}


def test_each_class_has_a_row_and_labels_of_no_class_have_one_of_their_own():
    truth = Truth(
        (CUP, thing("c2", "cup", (0, 1, 0)), BOOK, TruthObject("d", ("display", "screen"), np.array([[0, 5, 0.0]]))),
        (FormerPlace("v", "removed", ("vase",), np.array([3.0, 0, 0])), FormerPlace("u", "removed", (), np.array([4.0, 0, 0]))),
    )
    found = [
        landmark(1, "cup", (0, 0, 0)),
        landmark(2, "cup", (0.1, 0, 0)),
        landmark(3, "cup", (7, 0, 0)),
        landmark(4, "vase", (3, 0, 0)),
        landmark(5, "screen", (8, 0, 0)),
        landmark(6, "dragon", (9, 0, 0)),
        landmark(7, "", (9, 1, 0)),
        landmark(8, "book", (4, 0, 0)),
    ]
    result = evaluate_landmarks(found, truth)
    assert rows_of(result) == {
        "book": (1, 0, 1, 0, 1, 0),
        "cup": (2, 1, 1, 1, 0, 1),
        "display": (1, 0, 1, 0, 0, 1),
        "vase": (0, 0, 0, 0, 1, 0),
        None: (0, 0, 0, 0, 0, 2),
    }
    assert [row.label for row in result.per_class][-1] is None
    assert [row.landmarks for row in result.per_class] == [1, 3, 1, 1, 2]
    # Where labels are ignored, a false landmark still counts under the class of its own word.
    assert rows_of(evaluate_landmarks(found, truth, LabelRule.geometry()))["cup"] == (2, 1, 1, 1, 0, 1)


def test_a_false_landmark_counts_under_the_class_that_its_category_names():
    truth = Truth((thing("a", "shoe", (0, 0, 0)), thing("b", "boot", (5, 0, 0))))
    boot = replace(landmark(1, "boot", (9, 9, 9)), category="shoe")
    table = rows_of(evaluate_landmarks([boot], truth))
    assert (table["shoe"][-1], table["boot"][-1]) == (1, 0)
    unheard = replace(boot, category="footwear")  # it names no class, but the label does
    assert rows_of(evaluate_landmarks([unheard], truth))["boot"][-1] == 1


def test_a_mislabelled_landmark_is_false_and_its_object_missing():
    result = evaluate_landmarks([landmark(1, "book", (0, 0, 0))], Truth((CUP, BOOK)))
    assert rows_of(result) == {"book": (1, 0, 1, 0, 0, 1), "cup": (1, 0, 1, 0, 0, 0)}
    assert result.extra[0].nearest_object_id == "c"
    assert oracle_ceiling([landmark(1, "book", (0, 0, 0))], Truth((CUP, BOOK))).score.f1 == pytest.approx(2 / 3)


def made_up_case(seed):
    """A crowded table, with seldom seen and removed things, and a map of it that is partly wrong."""
    rng = np.random.default_rng(seed)
    words = ["cup", "book", "bottle"]
    objects = tuple(thing(str(i), words[i % 3], rng.uniform(0, 0.8, 3), seen=int(rng.integers(0, 10))) for i in range(6))
    places = tuple(FormerPlace(f"gone {i}", "removed", (words[i],), rng.uniform(0, 0.8, 3)) for i in range(3))
    found = [
        landmark(i, str(rng.choice([*words, "dragon"])), rng.uniform(0, 0.8, 3), rng.choice(["stable", "tentative"], p=[0.9, 0.1]))
        for i in range(9)
    ]
    return found, Truth(objects, places), rng


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_the_order_of_landmarks_changes_nothing(seed):
    found, truth, rng = made_up_case(seed)
    shuffled = [found[i] for i in rng.permutation(len(found))]
    assert evaluate_landmarks(shuffled, truth).as_dict() == evaluate_landmarks(found, truth).as_dict()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6))
def test_ceilings_are_above_the_score_and_every_landmark_is_one_thing(seed):
    found, truth, _ = made_up_case(seed)
    exact, geometry, oracle = evaluate_landmarks(found, truth), geometry_ceiling(found, truth), oracle_ceiling(found, truth)
    assert oracle.score.f1 >= geometry.score.f1 >= exact.score.f1
    assert oracle.score.recall == geometry.score.recall
    assert oracle.score.precision == (1.0 if oracle.matched else 0.0)
    assert (oracle.score.false_positives, oracle.extra) == (0, ())
    for result in (exact, geometry, oracle):
        assert result.duplicates + result.ghosts + result.false == result.score.false_positives == len(result.extra)
        assert sum(row.objects for row in result.per_class) == result.score.objects
        assert sum(row.landmarks for row in result.per_class) == result.score.landmarks
        assert sum(row.matched for row in result.per_class) == result.score.matched
        assert all(0 <= row.visible.false_positives <= row.false_positives for row in result.sweep)


def test_the_share_of_the_way_to_the_oracle():
    assert share_of_way(0.6, 0.7, 0.8) == pytest.approx(0.5)
    assert share_of_way(0.6, 0.5, 0.8) == pytest.approx(-0.5)
    assert share_of_way(0.8, 0.8, 0.8) is None


def test_an_empty_map():
    result = evaluate_landmarks([], Truth((CUP, BOOK)))
    assert (result.score.precision, result.score.recall, result.score.f1) == (0.0, 0.0, 0.0)
    assert [gone.object_id for gone in result.missing] == ["c", "b"]
    assert result.missing[0].nearest_landmark_id is None


def test_bad_arguments():
    with pytest.raises(EvaluationError, match="no objects"):
        evaluate_landmarks([], Truth(()))
    with pytest.raises(EvaluationError, match="radius_m: got -1"):
        evaluate_landmarks([], Truth((CUP,)), radius_m=-1)


def test_moving_a_map_moves_positions_covariances_and_sizes():
    T = exp([0, 0, np.pi / 2, 0, 0, 0])
    T[:3, 3] = [1, 2, 3]
    (there,) = moved([landmark(1, "cup", (1, 0, 0))], T)
    np.testing.assert_allclose(there.position_m, [1, 3, 3])
    np.testing.assert_allclose(there.covariance_m2, np.diag([2e-4, 1e-4, 3e-4]), atol=1e-12)
    np.testing.assert_allclose(there.size_m, [0.2, 0.1, 0.3])
    with pytest.raises(FrameError, match="T_truth_map"):
        moved([landmark(1, "cup", (1, 0, 0))], 2 * np.eye(4))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.lists(st.floats(-1, 1), min_size=3, max_size=3))
def test_turning_map_and_truth_about_the_vertical_changes_nothing(seed, shift):
    rng = np.random.default_rng(seed)
    words = ["cup", "book"]
    found = [landmark(i, words[i % 2], rng.uniform(0, 0.5, 3)) for i in range(5)]
    centers = rng.uniform(0, 0.5, (4, 3))
    T = exp([0, 0, rng.uniform(-3, 3), *shift])

    def score(landmarks, points):
        truth = Truth(tuple(thing(str(i), words[i % 2], point) for i, point in enumerate(points)))
        return [(p.object_id, p.landmark_id) for p in evaluate_landmarks(landmarks, truth).matched]

    assert score(moved(found, T), centers @ T[:3, :3].T + T[:3, 3]) == score(found, centers)
