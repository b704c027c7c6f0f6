"""What is not trusted is kept as a hint; and small things that only look like furniture are none."""

from dataclasses import replace

import numpy as np
import pytest
from boxes_of_points import WordEmbedder, landmark, on_box, table_points, thing_points

from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.from_words import with_features_of_words
from seo_slam.abstraction.updating import updated

TABLE = landmark(1, "table", table_points())
CUP = replace(landmark(7, "cup", thing_points(0.6, 0.4, 0.74)), state="tentative", observations=3)
SOFA_LIKE = landmark(8, "desk", thing_points(0.6, 0.4, 0.74))  # by its vector a "table", and in no list


def hints(abstract_map):
    return {v.landmark_id: (a.id, v.relation) for a in abstract_map.anchors for v in a.hints}


@pytest.mark.parametrize("state", ["tentative", "lost"])
def test_what_is_not_trusted_is_a_hint_on_its_anchor_and_nothing_else(state, embedder, settings):
    made = abstract([TABLE], embedder, settings, tentative=[replace(CUP, state=state)])
    assert hints(made) == {7: (1, "on")}
    assert made.anchors[0].volatiles == ()
    np.testing.assert_allclose(made.anchors[0].hints[0].place.p_world, [0.6, 0.4, 0.78], atol=0.02)


@pytest.mark.parametrize(
    "row",
    [replace(CUP, observations=2), landmark(7, "", thing_points(0.6, 0.4, 0.74)), landmark(7, "chair", table_points((3.0, 3.0)))],
    ids=["seen too seldom", "without a word", "furniture"],
)
def test_no_hint(row, embedder, settings):
    made = abstract([TABLE], embedder, settings, tentative=[row])
    assert [anchor.id for anchor in made.anchors] == [1]
    assert hints(made) == {}


def test_an_anchor_carries_nothing_on_an_anchor_that_is_not_trusted(embedder, settings):
    made = abstract([landmark(7, "cup", thing_points(0.6, 0.4, 0.74))], embedder, settings, tentative=[TABLE])
    assert made.anchors == ()


def test_a_full_view_replaces_hints_and_a_view_of_a_corner_adds_to_them(embedder, settings):
    old = abstract([TABLE], embedder, settings, tentative=[CUP])
    (whole,) = updated(old, abstract([TABLE], embedder, settings), settings).anchors
    assert whole.hints == ()
    points = table_points()
    end = landmark(1, "table", points[points[:, 0] >= 0.84])
    shoe = replace(landmark(9, "shoe", thing_points(1.1, 0.7, 0.74)), state="tentative")
    (joined,) = updated(old, abstract([end], embedder, settings, tentative=[shoe]), settings).anchors
    assert [hint.label for hint in joined.hints] == ["cup", "shoe"]


def test_another_embedder_makes_the_features_of_hints_too(embedder, settings):
    made = abstract([TABLE], embedder, settings, tentative=[CUP])
    blurred = replace(made.anchors[0].hints[0], feature=np.zeros(3))
    again = with_features_of_words(replace(made, anchors=(replace(made.anchors[0], hints=(blurred,)),)), WordEmbedder())
    np.testing.assert_allclose(again.anchors[0].hints[0].feature, embedder.embed_text(["cup"])[0])


def test_a_small_thing_on_a_table_is_no_anchor_because_its_word_is_like_one(embedder, settings):
    made = abstract([TABLE, SOFA_LIKE], embedder, settings)
    assert [anchor.id for anchor in made.anchors] == [1]
    assert [v.landmark_id for v in made.anchors[0].volatiles] == [8]
    kept = abstract([TABLE, SOFA_LIKE], embedder, settings.model_copy(update={"small_side_m": 0.0}))
    assert [anchor.id for anchor in kept.anchors] == [1, 8]


@pytest.mark.parametrize(
    "row",
    [
        landmark(8, "desk", on_box((0.1, 0.1, 0.74), (0.7, 0.5, 1.0))),
        landmark(8, "chair", thing_points(0.6, 0.4, 0.74)),
        landmark(8, "desk", thing_points(4.0, 0.4, 0.0)),
    ],
    ids=["large", "in the list", "by itself"],
)
def test_an_anchor_all_the_same(row, embedder, settings):
    assert [anchor.id for anchor in abstract([TABLE, row], embedder, settings).anchors] == [1, 8]
