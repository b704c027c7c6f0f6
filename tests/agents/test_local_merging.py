import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from local_scenes import BOX, evidence, landmark, view_of, wall

from seo_slam.agents.local_merging import LocalMerging, extent_inside
from seo_slam.records import Merge
from seo_slam.registry import create
from seo_slam.testing import check_agent

SIZE = (0.4, 0.3, 0.2)


def merged(second=None, apart=None, box=BOX, first=None):
    rows = [landmark(1, "box", size_m=SIZE, **(first or {})), landmark(2, **{"label": "box", "size_m": SIZE} | (second or {}))]
    given = {1: evidence(np.zeros((0, 3)), apart=apart), 2: evidence(np.zeros((0, 3)))}
    return LocalMerging().propose(view_of(*wall(), rows=rows, boxes={1: BOX, 2: box}, evidences=given))


def test_two_of_one_word_in_one_place_are_merged_into_the_one_seen_more():
    assert merged({"at": [0.05, 0.0, 2.0], "version": 3}) == [Merge(1, 0, 2, 3, "local merging")]
    (edit,) = merged({"observations": 50})
    assert (edit.keep_id, edit.drop_id) == (2, 1)


@pytest.mark.parametrize(
    ("second", "apart", "box"),
    [
        ({"at": [0.35, 0.0, 2.0]}, None, BOX),  # beside it
        ({}, {2: 1}, BOX),  # detected beside each other
        ({"label": "vase", "at": [0.1, 0.0, 2.0]}, None, BOX),  # another word, not quite the same place
        ({"size_m": (1.2, 0.3, 0.2)}, None, BOX),  # a box around several
        ({}, None, BOX + 45.0),  # elsewhere in the image
    ],
)
def test_what_speaks_against_it(second, apart, box):
    assert merged(second, apart, box) == []


def test_no_landmark_twice():
    rows = [landmark(i, "box", size_m=SIZE) for i in (1, 2, 3)]
    edits = LocalMerging().propose(view_of(*wall(), rows=rows))
    ids = [i for edit in edits for i in (edit.keep_id, edit.drop_id)]
    assert edits
    assert len(ids) == len(set(ids))


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6), st.lists(st.floats(0.01, 2), min_size=6, max_size=6))
@settings(max_examples=60)
def test_the_share_inside_is_symmetric_and_between_none_and_all(places, sizes):
    p_world, size_m = np.array(places).reshape(2, 3), np.array(sizes).reshape(2, 3)
    share = extent_inside(p_world, size_m)
    assert 0.0 <= share <= 1.0 + 1e-9
    assert share == pytest.approx(extent_inside(p_world[::-1], size_m[::-1]))
    assert extent_inside(np.zeros((2, 3)), size_m[[0, 0]]) == pytest.approx(1.0)


def test_contract():
    check_agent(create("agent", "local_merging"))
