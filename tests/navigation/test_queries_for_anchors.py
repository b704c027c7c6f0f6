"""From words to candidates: Eq 5 and 6, and names of rooms."""

from dataclasses import replace

import numpy as np
import pytest
from fake_home import EMBEDDER, KITCHEN, STUDY, abstract_map, furniture, resting
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.abstraction.abstract_map import Room
from seo_slam.abstraction.room_finding import room_of
from seo_slam.errors import ConfigError
from seo_slam.navigation.query import candidates, cosine, parsed, with_hints

ROOMS = (Room(1, "kitchen", 10.0), Room(2, "living room", 20.0), Room(3, "room", 5.0), Room(4, "room 4", 5.0))


def word(text):
    return EMBEDDER.embed_text([text])[0]


def mapped():
    things = furniture()
    small = [
        (resting(10, "mug", things[0]), things[0]),
        (resting(11, "book", things[0]), things[0]),
        (resting(12, "cup", things[2]), things[2]),
    ]
    return abstract_map(things, small)


@pytest.mark.parametrize(
    ("text", "words", "room"),
    [
        ("mug", "mug", None),
        ("the mug", "mug", None),
        ("  A  red   mug. ", "red mug", None),
        ("the mug in the kitchen", "mug", "kitchen"),
        ("mug in Kitchen", "mug", "kitchen"),
        ("the lamp of the living room", "lamp", "living room"),
        ("a book from room 4", "book", "room 4"),
        ("book inside my room", "book", "room"),
        ("the mug in the garage", "mug in the garage", None),
        ("kitchen", "kitchen", None),
        ("in the kitchen", "in the kitchen", None),
        ("the kitchen table", "kitchen table", None),
        ("the mug in the kitchen sink", "mug in the kitchen sink", None),
        ("the picture of the kitchen in the living room", "picture of the kitchen", "living room"),
        ("", "", None),
        ("the", "", None),
        ("A.", "", None),
        ("the my cup", "cup", None),
        ("an anchor", "anchor", None),
        ("thermos", "thermos", None),
        ("the in the kitchen", "", "kitchen"),
        (" ?! ", "", None),
    ],
)
def test_what_and_where(text, words, room):
    query = parsed(text, ROOMS)
    assert (query.text, query.words, query.room) == (text, words, room)


def test_without_rooms_every_word_is_of_the_thing():
    assert parsed("the mug in the kitchen").words == "mug in the kitchen"


@pytest.mark.parametrize("text", [None, 3, b"mug"])
def test_no_text(text):
    with pytest.raises(ConfigError, match="wanted text"):
        parsed(text)


def test_the_score_is_the_best_of_the_anchor_and_what_is_on_it():
    first, second, *rest = candidates(mapped(), word("mug"))
    assert (first.anchor_id, first.because, first.volatile) == (1, "mug", True)
    assert first.score == pytest.approx(1.0)
    assert (second.anchor_id, second.because) == (3, "cup")
    assert second.score == pytest.approx(word("cup") @ word("mug"))
    assert [row.score for row in rest] == [0.0, 0.0]


def test_an_anchor_scores_for_itself():
    first = candidates(mapped(), word("desk"))[0]
    assert (first.anchor_id, first.because, first.volatile) == (3, "desk", False)


def test_equal_scores_go_by_id_and_some_can_be_left_out():
    assert [row.anchor_id for row in candidates(mapped(), word("banana"))] == [1, 2, 3, 4]
    assert [row.anchor_id for row in candidates(mapped(), word("mug"), exclude={1, 4})] == [3, 2]


def test_a_room_leaves_the_others_out():
    assert {row.anchor_id for row in candidates(mapped(), word("mug"), room="kitchen")} == {1, 2}
    assert {row.anchor_id for row in candidates(mapped(), word("mug"), room="STUDY")} == {3, 4}
    assert candidates(mapped(), word("mug"), room="garage") == ()


def test_without_a_layout_a_room_says_nothing():
    assert len(candidates(replace(mapped(), layout=None), word("mug"), room="kitchen")) == 4


def test_furniture_that_covers_its_floor_is_in_the_room_around_it():
    given_map = mapped()
    rooms = [room_of(given_map.layout, anchor.footprint_world) for anchor in given_map.anchors]
    assert rooms == [KITCHEN, KITCHEN, STUDY, STUDY]
    assert room_of(given_map.layout, np.array([[-9.0, -9.0], [-8.0, -8.0]])) == 0


def test_features_of_another_size():
    with pytest.raises(ConfigError, match=r"feature \(3,\)"):
        candidates(mapped(), np.ones(3))


@given(st.integers(0, 2**31), st.floats(0.1, 10.0))
def test_length_tells_nothing_and_zero_is_like_nothing(seed, length):
    draws = np.random.default_rng(seed)
    rows, feature = draws.normal(size=(5, 7)), draws.normal(size=7)
    rows[2] = 0.0
    scores = cosine(rows, feature)
    np.testing.assert_allclose(cosine(length * rows, feature / length), scores, atol=1e-12)
    assert scores[2] == 0.0
    assert (np.abs(scores) <= 1 + 1e-12).all()


def test_a_hint_is_no_candidate_before_it_is_asked_for():
    source = mapped()
    table = source.anchors[0]
    hinted = replace(source, anchors=(replace(table, volatiles=(), hints=table.volatiles), *source.anchors[1:]))
    best = candidates(hinted, word("mug"))[0]
    assert (best.anchor_id, best.because) != (table.id, "mug")
    trusting = with_hints(hinted, word("mug"), 0.99)
    assert [[v.label for v in rows] for rows in (trusting.anchors[0].volatiles, trusting.anchors[0].hints)] == [["mug"], ["book"]]
    best = candidates(trusting, word("mug"))[0]
    assert (best.anchor_id, best.because, best.volatile) == (table.id, "mug", True)
    assert best.score == pytest.approx(1.0)
