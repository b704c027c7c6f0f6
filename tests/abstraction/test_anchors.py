"""Which landmarks rarely move."""

import numpy as np
import pytest
from boxes_of_points import SIZE, landmark, on_box, thing_points
from pydantic import ValidationError

from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.anchors import Mobility, words_for
from seo_slam.settings.abstraction import AbstractionSettings

BIG = on_box((0, 0, 0), (1.0, 0.6, 0.8))
SMALL = thing_points(0, 0, 0)


def is_anchor(row, embedder, settings):
    return len(abstract([row], embedder, settings).anchors) == 1


def test_a_word_of_either_list_decides_and_so_does_one_that_ends_in_it(embedder, settings):
    mobility = Mobility(embedder, settings)
    assert [mobility.of_word(word) for word in ("table", "Kitchen Table", "cup", "wooden cup", "table cup", "shelf_table")] == [
        1,
        1,
        -1,
        -1,
        -1,
        1,
    ]


def test_another_word_is_decided_by_the_nearer_names(embedder, settings):
    mobility = Mobility(embedder, settings)
    assert [mobility.of_word(word) for word in ("desk", "sofa", "mug", "banana", "gizmo")] == [1, 1, -1, -1, 0]


def test_a_majority_of_the_shares_decides(embedder, settings):
    for cup, expected in ((0.3, True), (0.7, False)):
        row = landmark(1, "table", SMALL, {"table": 1 - cup, "cup": cup}, np.zeros(SIZE))
        assert is_anchor(row, embedder, settings) is expected


def test_what_an_agent_named_is_judged_by_the_agents_word(embedder, settings):
    row = landmark(1, "tall thing", BIG, {"cup": 1.0})
    assert words_for(row) == {"tall thing": 1.0}
    assert is_anchor(row, embedder, settings)


def test_without_words_the_feature_decides_and_then_the_size(embedder, settings):
    def nameless(p_world, word=None):
        return landmark(1, "", p_world, {}, embedder.embed_text([word])[0] if word else np.zeros(SIZE))

    assert is_anchor(nameless(SMALL, "sofa"), embedder, settings)
    assert not is_anchor(nameless(BIG, "banana"), embedder, settings)
    assert is_anchor(nameless(BIG), embedder, settings)
    assert not is_anchor(nameless(SMALL), embedder, settings)
    assert not is_anchor(nameless(on_box((0, 0, 0), (4.0, 0.1, 2.5), step_m=0.05)), embedder, settings)  # a wall
    assert not is_anchor(nameless(BIG), embedder, settings.model_copy(update={"large_is_anchor": False}))


def test_the_papers_template_has_one_threshold(embedder, settings):
    template = settings.model_copy(update={"anchor_rule": "template", "template_threshold": 0.5})
    assert [Mobility(embedder, template).of_word(word) for word in ("table", "sofa", "cup", "gizmo")] == [1, 1, -1, -1]


def test_lists_that_contradict_each_other_are_refused():
    with pytest.raises(ValidationError, match="both hold table"):
        AbstractionSettings(movable_names=("Table",))
    with pytest.raises(ValidationError, match="replace_overlap"):
        AbstractionSettings(update_overlap=0.9, replace_overlap=0.5)
