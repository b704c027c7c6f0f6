"""Relations do not depend on where a home stands and how it is turned."""

import numpy as np
from boxes_of_points import WordEmbedder, chair_points, landmark, shelf_points, table_points, thing_points
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.updating import updated
from seo_slam.settings.abstraction import AbstractionSettings

SETTINGS = AbstractionSettings(
    static_names=("table", "chair", "shelf"), movable_names=("cup", "book", "shoe"), static_phrases=(), movable_phrases=()
)
SCENE = (
    ("table", table_points()),
    ("chair", chair_points((0.4, 0.95))),
    ("shelf", shelf_points((2.0, 0.0))),
    ("cup", thing_points(0.6, 0.4, 0.74)),
    ("book", thing_points(2.3, 0.17, 0.45, 0.15)),
    ("shoe", thing_points(1.45, 0.3, 0.0, 0.12)),
    ("cup", thing_points(0.62, 1.15, 0.45)),
)
EXPECTED = {3: (0, "on"), 4: (2, "on"), 5: (0, "next to"), 6: (1, "on")}
shifts = st.floats(-20, 20)
angles = st.floats(-np.pi, np.pi)


def moved(xyz, yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    rows = [landmark(k, label, points @ R.T + np.array(xyz)) for k, (label, points) in enumerate(SCENE)]
    return abstract(rows, WordEmbedder(), SETTINGS)


@settings(max_examples=25, deadline=None)
@given(st.tuples(shifts, shifts, shifts), angles)
def test_a_scene_may_stand_anywhere(xyz, yaw):
    made = moved(xyz, yaw)
    assert {v.landmark_id: (a.id, v.relation) for a in made.anchors for v in a.volatiles} == EXPECTED
    assert made.anchors[0].support_z_m - xyz[2] == np.clip(made.anchors[0].support_z_m - xyz[2], 0.7, 0.76)


@settings(max_examples=25, deadline=None)
@given(st.tuples(shifts, shifts, shifts), angles)
def test_a_map_updated_with_itself_is_the_same_map(xyz, yaw):
    made = moved(xyz, yaw)
    again = updated(made, made, SETTINGS)
    assert len(made.anchors) == 3
    for before, after in zip(made.anchors, again.anchors, strict=True):
        assert (after.id, after.label, after.points, after.volatiles) == (before.id, before.label, before.points, before.volatiles)
        np.testing.assert_allclose(after.feature, before.feature)


@settings(max_examples=25, deadline=None)
@given(st.permutations(range(3)))
def test_the_order_of_new_anchors_decides_nothing_but_new_ids(order):
    made = moved((0, 0, 0), 0.0)
    shuffled = AbstractMap(tuple(made.anchors[k] for k in order), embedder="words")
    assert [a.label for a in updated(made, shuffled, SETTINGS).anchors] == ["table", "chair", "shelf"]
