"""Whether a match still holds from right before it."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from fake_home import EMBEDDER

from seo_slam.navigation.judging import Judge
from seo_slam.navigation.local_match import Match
from seo_slam.navigation.query import Query
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.testing.store import make_landmark

MUG = EMBEDDER.embed_text(["mug"])[0]


def seen(landmark_id, label, at):
    """A landmark without a cloud."""
    return replace(make_landmark(landmark_id, at), label=label, embedding=EMBEDDER.embed_text([label])[0])


HERE = (1.0, 2.0, 0.8)
MATCH = Match(seen(7, "mug", HERE), 1.0)
BESIDE = seen(8, "book", (1.2, 2.0, 0.8))


def again(landmarks, forgotten=(), in_view=True):
    senses = SimpleNamespace(landmarks=tuple(landmarks), forgotten=tuple(forgotten))
    still = Judge(Query("mug", "mug"), MUG, 1.0, senses, NavigationSettings()).again(MATCH, in_view)
    return None if still is None else still.landmark.id


def test_the_same_landmark_holds_while_it_is_like_the_query():
    assert again([MATCH.landmark, BESIDE]) == 7
    assert again([seen(7, "book", HERE)]) is None


def test_another_landmark_like_it_in_its_place_stands_in():
    assert again([BESIDE, seen(9, "mug", (1.1, 2.0, 0.8))]) == 9
    assert again([BESIDE, seen(9, "mug", (2.0, 2.0, 0.8))]) is None


@pytest.mark.parametrize("others", [(), (BESIDE,)], ids=["alone", "beside a book"])
def test_what_the_mapper_dropped_holds_only_where_it_is_out_of_view(others):
    assert again(others, [MATCH.landmark], in_view=False) == 7
    assert again(others, [MATCH.landmark], in_view=True) is None


def test_what_was_seen_to_be_something_else_does_not_hold_because_it_is_out_of_view():
    assert again([seen(7, "book", HERE)], [MATCH.landmark], in_view=False) is None
