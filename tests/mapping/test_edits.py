"""Edits of agents: applied to the version they were made for, else refused without a trace."""

import numpy as np
import pytest
from small_map import AT, SmallMap

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import EditRefused
from seo_slam.mapping.edits import apply_edit
from seo_slam.perception.labels import MAX_LABEL_CHARACTERS
from seo_slam.records import Confirm, Merge, Relabel, Remove

EMBEDDER = HashedEmbedder(size=8)


@pytest.fixture
def desk():
    """Two cups 8 cm apart (0, 1) and a book far away (2), all stable."""
    made = SmallMap()
    for _ in range(4):
        made.see({0: (AT, "cup"), 1: (AT + np.array([0, 0.08, 0]), "cup"), 2: (AT + np.array([0.3, -0.5, 0]), "book")})
    return made


def version(desk, landmark_id):
    return desk.objects[landmark_id].version


def state(desk):
    """All that an edit could change."""
    return [
        (row.id, row.label, dict(row.labels), row.position_m.tolist(), row.version, row.state) for row in desk.objects.rows(desk.smoother)
    ]


def apply(desk, edit):
    return apply_edit(edit, desk.objects, desk.smoother, EMBEDDER)


def test_confirm_changes_nothing(desk):
    before = state(desk)
    event = apply(desk, Confirm(0, version(desk, 0), "me"))
    assert (event.kind, event.landmark_id, event.detail, event.source) == ("confirmed", 0, "cup", "me")
    assert state(desk) == before


def test_relabel_wins_over_the_detector_from_then_on(desk):
    now = version(desk, 0)
    event = apply(desk, Relabel(0, now, "teapot", "me"))
    assert (event.kind, event.landmark_id, event.detail, event.source) == ("relabelled", 0, "cup -> teapot", "me")
    for _ in range(5):
        desk.see({0: (AT, "cup")})
    row = desk.row(0)
    assert row.label == "teapot"
    assert row.version > now
    assert next(iter(row.labels)) == "teapot"
    assert row.labels["teapot"] >= 0.5
    assert sum(row.labels.values()) == pytest.approx(1.0)
    assert row.labels["cup"] > 0


def test_a_query_finds_a_thing_by_the_word_that_an_agent_gave_it(desk):
    word = EMBEDDER.embed_text(["teapot"])[0]
    before = float(word @ desk.row(0).embedding)
    apply(desk, Relabel(0, version(desk, 0), "teapot"))
    assert float(word @ desk.row(0).embedding) > max(0.7, before + 0.2)
    assert np.linalg.norm(desk.row(0).embedding) == pytest.approx(1.0)
    for _ in range(5):
        desk.see({0: (AT, "cup")})
    assert float(word @ desk.row(0).embedding) > 0.7
    apply(desk, Merge(1, version(desk, 1), 0, version(desk, 0)))
    assert float(word @ desk.row(1).embedding) > 0.7


@pytest.mark.parametrize("edit", [None, "Remove 0", Relabel(0, 1, 3.5)])
def test_what_is_no_edit_is_refused(desk, edit):
    before = state(desk)
    with pytest.raises(EditRefused):
        apply(desk, edit)
    assert state(desk) == before


def test_relabel_cleans_and_caps_the_text(desk):
    apply(desk, Relabel(0, version(desk, 0), "  tea\x1b[31m\npot\u202e  "))
    assert desk.row(0).label == "tea[31m pot"
    apply(desk, Relabel(0, version(desk, 0), "x" * 1000))
    assert len(desk.row(0).label) == MAX_LABEL_CHARACTERS


@pytest.mark.parametrize("label", ["", "  ", "\n\x00\u200b"])
def test_an_empty_label_is_refused(desk, label):
    before = state(desk)
    with pytest.raises(EditRefused, match="empty label"):
        apply(desk, Relabel(0, version(desk, 0), label))
    assert state(desk) == before


def test_remove_takes_it_out_of_map_and_graph(desk):
    event = apply(desk, Remove(1, version(desk, 1), "me"))
    assert (event.kind, event.landmark_id, event.detail, event.source) == ("removed", 1, "cup", "me")
    assert desk.ids() == [0, 2]
    assert 1 not in desk.objects
    assert 1 not in desk.smoother.positions()[0]


def test_merge_keeps_one_of_two(desk):
    event = apply(desk, Merge(0, version(desk, 0), 1, version(desk, 1), "me"))
    assert (event.kind, event.landmark_id, event.other_id, event.source) == ("merged", 1, 0, "me")
    assert desk.ids() == [0, 2]
    assert -0.01 < desk.row(0).position_m[1] - AT[1] < 0.09  # somewhere between the two
    assert desk.row(0).observations == 8


STALE = [
    Confirm(0, 99),
    Relabel(0, 99, "teapot"),
    Remove(0, 99),
    Merge(0, 99, 1, 1),
    Merge(0, 1, 1, 99),
    Confirm(77, 1),
    Relabel(77, 1, "teapot"),
    Remove(77, 1),
    Merge(77, 1, 0, 1),
    Merge(0, 1, 77, 1),
    Merge(0, 1, 0, 1),
    Merge(0, 1, 2, 1),
]


@pytest.mark.parametrize("edit", STALE, ids=lambda edit: str(edit).replace(", source=''", ""))
def test_what_does_not_hold_any_more_is_refused_and_leaves_no_trace(desk, edit):
    assert [version(desk, i) for i in (0, 1, 2)] == [1, 1, 1]
    before = state(desk)
    with pytest.raises(EditRefused, match=r"version|not in the map|itself|apart"):
        apply(desk, edit)
    assert state(desk) == before


def test_an_edit_is_stale_after_another_one(desk):
    now = version(desk, 0)
    apply(desk, Relabel(0, now, "teapot"))
    with pytest.raises(EditRefused, match=f"for version {now}, it is at {version(desk, 0)}"):
        apply(desk, Remove(0, now))
    merged = version(desk, 0), version(desk, 1)
    apply(desk, Merge(0, merged[0], 1, merged[1]))
    with pytest.raises(EditRefused, match="version"):
        apply(desk, Remove(0, merged[0]))
    with pytest.raises(EditRefused, match="not in the map"):
        apply(desk, Confirm(1, merged[1]))
