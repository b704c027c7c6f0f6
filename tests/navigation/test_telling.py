"""What is said of how a search ended."""

from dataclasses import replace

import numpy as np
import pytest
from fake_home import EMBEDDER, Robot, SeeingMapper, abstract_map, furniture, resting

from seo_slam.navigation.local_match import Match
from seo_slam.navigation.outcomes import Attempt, Candidate
from seo_slam.navigation.query import parsed
from seo_slam.navigation.telling import in_another_room, looked_in_vain, stopped_before, taken_for

TABLE, COUNTER, DESK, SHELF = 1, 2, 3, 4
THINGS = furniture()
MAP = abstract_map(THINGS, [(resting(10, "mug", THINGS[2]), THINGS[2])])
MUG = EMBEDDER.embed_text(["mug"])[0]


def met(label, carrier):
    """A match that rests on a piece of furniture."""
    thing = resting(10, label, THINGS[carrier - 1])
    mapper = SeeingMapper(Robot(), [thing])
    mapper.seen[10], mapper.words[10], mapper.last_s[10] = 5, [label], 0.0
    return Match(mapper.snapshot().landmarks[0], 0.8)


@pytest.mark.parametrize(
    ("text", "label", "carrier", "told"),
    [
        ("the Mug", "mug", DESK, "stopped before the mug (0.80)"),
        ("the mug in the study", "mug", DESK, "stopped before the mug (0.80)"),
        ("the mug in the kitchen", "mug", DESK, "stopped before the mug (0.80); it is in the study, not in the kitchen"),
        ("a book", "banana", DESK, "stopped before the banana (0.80), taken for the book that was asked for"),
        (
            "a book in the kitchen",
            "banana",
            DESK,
            "stopped before the banana (0.80), taken for the book that was asked for; it is in the study, not in the kitchen",
        ),
    ],
)
def test_what_it_stopped_before_names_both_words_and_another_room(text, label, carrier, told):
    assert stopped_before(parsed(text, MAP.rooms), met(label, carrier), MAP) == told


def test_without_rooms_none_is_told():
    assert stopped_before(parsed("mug in the kitchen", MAP.rooms), met("mug", DESK), replace(MAP, layout=None, rooms=())).endswith("(0.80)")


def test_what_was_asked_for_and_what_is_taken_for_it():
    assert taken_for(parsed("the mug"), met("mug", TABLE)) == "the mug is what was asked for"
    assert taken_for(parsed("the book"), met("mug", TABLE)) == "the mug is taken for the book that was asked for"


def attempt(anchor_id, reached, because="mug", label=None):
    return Attempt(Candidate(anchor_id, 0.9, because, True), reached, None, np.nan, "", "", anchor_label=label)


def test_only_places_that_were_come_to_are_counted_and_named():
    attempts = [attempt(DESK, True, label="desk"), attempt(SHELF, False, label="shelf"), attempt(-1, True, "cup")]
    told = looked_in_vain(parsed("mug"), attempts, None, "attempts are used up")
    assert told == "no mug was found at 2 places (desk 3, cup on no furniture), and attempts are used up; nothing was seen"
    one = looked_in_vain(parsed("mug"), attempts[:2], met("cup", TABLE), "there is no other candidate")
    assert one == "no mug was found at 1 place (desk 3), and there is no other candidate; the best seen is a cup (0.80)"


def test_a_place_is_told_by_the_word_that_its_anchor_had_then():
    told = looked_in_vain(parsed("mug"), [attempt(DESK, True, label="armchair"), attempt(7, True, label="")], None, "that is all")
    assert told == "no mug was found at 2 places (armchair 3, thing without a name 7), and that is all; nothing was seen"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("mug", ""),
        ("mug in the study", ""),
        ("mug in the kitchen", "the map has a mug at the desk 3 in the study, though"),
    ],
)
def test_another_room_that_has_it_is_told(text, told):
    assert in_another_room(parsed(text, MAP.rooms), MUG, 0.9, MAP) == told
    assert in_another_room(parsed("banana in the kitchen", MAP.rooms), EMBEDDER.embed_text(["banana"])[0], 0.9, MAP) == ""


def test_furniture_in_another_room_is_told_without_what_it_is_at():
    query = parsed("desk in the kitchen", MAP.rooms)
    assert in_another_room(query, EMBEDDER.embed_text(["desk"])[0], 0.9, MAP) == "the map has a desk in the study, though"
