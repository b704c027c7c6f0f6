"""The life of a landmark: words, size, state, version, id."""

import numpy as np
import pytest
from small_map import AT, SmallMap, kinds

from seo_slam.config import MapSettings
from seo_slam.errors import UnknownLandmarkError
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.testing.store import make_landmark


def test_stable_after_three_keyframes_and_the_time():
    desk = SmallMap()
    assert kinds(desk.see({0: (AT, "cup")}, 0.0)) == [("created", 0)]
    assert desk.row(0).state == "tentative"
    assert kinds(desk.see({0: (AT, "cup")}, 0.2)) == []
    assert kinds(desk.see({0: (AT, "cup")}, 0.4)) == [("stable", 0)]
    assert desk.row(0).state == "stable"
    assert kinds(desk.see({0: (AT, "cup")}, 0.6)) == []


def test_three_keyframes_in_a_blink_are_not_enough():
    desk = SmallMap()
    for stamp in (0.0, 0.1, 0.2, 0.29):
        desk.see({0: (AT, "cup")}, stamp)
        assert desk.row(0).state == "tentative"
    assert kinds(desk.see({0: (AT, "cup")}, 0.3)) == [("stable", 0)]


def test_two_keyframes_long_apart_are_not_enough():
    desk = SmallMap()
    desk.see({0: (AT, "cup")}, 0.0)
    desk.see({0: (AT, "cup")}, 60.0)
    assert desk.row(0).state == "tentative"


def test_both_limits_are_settings():
    desk = SmallMap(stable_observations=2, stable_seconds=1.0)
    desk.see({0: (AT, "cup")}, 0.0)
    assert kinds(desk.see({0: (AT, "cup")}, 0.9)) == []
    assert kinds(desk.see({0: (AT, "cup")}, 1.0)) == [("stable", 0)]
    at_once = SmallMap(stable_observations=1, stable_seconds=0.0)
    assert kinds(at_once.see({0: (AT, "cup")})) == [("created", 0), ("stable", 0)]


def test_counts_and_stamps():
    desk = SmallMap()
    for stamp in (5.0, 5.5, 7.0):
        desk.see({0: (AT, "cup")}, stamp)
    row = desk.row(0)
    assert (row.observations, row.first_seen_s, row.last_seen_s) == (3, 5.0, 7.0)
    np.testing.assert_allclose(row.position_m, AT, atol=1e-3)
    assert np.linalg.eigvalsh(row.covariance_m2).min() > 0


def test_words_are_weighed_by_their_scores():
    desk = SmallMap()
    for label, score in (("cup", 0.9), ("mug", 0.3), (None, 1.0), ("cup", 0.6)):
        desk.see({0: (AT, label)}, scores=[score])
    row = desk.row(0)
    assert row.label == "cup"
    assert dict(row.labels) == pytest.approx({"cup": 1.5 / 1.8, "mug": 0.3 / 1.8})
    assert list(row.labels) == ["cup", "mug"]
    assert row.observations == 4
    assert np.linalg.norm(row.embedding) == pytest.approx(1.0)


def test_the_heavier_word_wins_and_the_version_rises_with_it():
    desk = SmallMap()
    desk.see({0: (AT, "mug")}, scores=[0.5])
    version = desk.row(0).version
    desk.see({0: (AT, "cup")}, scores=[0.4])
    assert (desk.row(0).label, desk.row(0).version) == ("mug", version)
    events = desk.see({0: (AT, "cup")}, scores=[0.4])
    assert ("relabelled", 0) in kinds(events)
    assert next(event.detail for event in events if event.kind == "relabelled") == "mug -> cup"
    assert desk.row(0).label == "cup"
    assert desk.row(0).version > version


def test_an_observation_alone_changes_no_version():
    desk = SmallMap()
    for _ in range(4):
        desk.see({0: (AT, "cup")})
    version = desk.row(0).version
    for _ in range(3):
        desk.see({0: (AT, "cup")})
    assert desk.row(0).version == version


def test_a_thing_without_a_word_has_an_empty_label_until_named():
    desk = SmallMap()
    desk.see({0: (AT, None)})
    row = desk.row(0)
    assert (row.label, dict(row.labels)) == ("", {})
    assert not row.embedding.any()
    desk.see({0: (AT, "cup")})
    assert desk.row(0).label == "cup"


def test_size_is_the_extent_of_the_surface_along_the_worlds_axes():
    desk = SmallMap()
    for _ in range(3):
        desk.see({0: (AT, "cup")}, half_m=0.05)
    np.testing.assert_allclose(desk.row(0).size_m, 0.1, atol=0.015)


def test_one_wrong_size_is_outvoted():
    desk = SmallMap()
    for half_m in (0.05, 0.5, 0.05, 0.05):
        desk.see({0: (AT, "cup")}, half_m=half_m)
    assert desk.row(0).size_m.max() < 0.12


def test_ids_rise_and_are_never_reused():
    desk = SmallMap()
    assert desk.objects.new_ids(2).tolist() == [0, 1]
    desk.see({0: (AT, "cup"), 1: (AT + 0.2, "book")})
    desk.smoother.remove(1)
    desk.objects.forget(1)
    assert desk.objects.new_ids(2).tolist() == [2, 3]
    assert desk.objects.new_ids(0).shape == (0,)
    assert desk.ids() == [0]


def test_unknown_ids_are_errors():
    objects = ObjectMap(MapSettings(), 8)
    assert 3 not in objects
    for call in (lambda: objects[3], lambda: objects.forget(3), lambda: objects.relabel(3, "cup", np.ones(1)), lambda: objects.merge(3, 4)):
        with pytest.raises(UnknownLandmarkError, match="landmark 3"):
            call()


def test_a_restored_landmark_is_what_it_was_and_its_words_keep_their_weight():
    objects = ObjectMap(MapSettings(), embedding_size=4)
    old = make_landmark(7)
    objects.restore(old)
    assert objects.next_id == 8
    thing = objects[7]
    assert thing.label == old.label
    assert thing.distribution() == pytest.approx(dict(old.labels))
    np.testing.assert_allclose(thing.size_m(), old.size_m)
    assert (thing.state, thing.version, thing.observations) == (old.state, old.version, old.observations)
    assert sum(thing.weights.values()) == pytest.approx(old.observations)


def test_landmarks_for_association_are_those_of_the_rows():
    desk = SmallMap()
    for _ in range(3):
        desk.see({4: (AT + 0.3, "book"), 2: (AT, "cup")})
    many, rows = desk.objects.landmarks(desk.smoother), desk.objects.rows(desk.smoother)
    assert many.ids.tolist() == [row.id for row in rows] == [2, 4]
    np.testing.assert_allclose(many.p_world, [row.position_m for row in rows])
    assert [dict(words) for words in many.labels] == [dict(row.labels) for row in rows]
    assert many.states == tuple(row.state for row in rows)
    empty = SmallMap().objects.landmarks(SmallMap().smoother)
    assert (len(empty), empty.embeddings.shape) == (0, (0, 8))


def test_merging_adds_up_what_was_known():
    desk = SmallMap()
    desk.see({0: (AT, "cup")}, 1.0, scores=[0.5])
    desk.see({1: (AT, "mug")}, 2.0, scores=[0.9])
    desk.see({1: (AT, "mug")}, 3.0, scores=[0.9])
    version = desk.row(0).version
    desk.smoother.merge(0, 1)
    desk.objects.merge(0, 1)
    row = desk.row(0)
    assert desk.ids() == [0]
    assert row.label == "mug"
    assert dict(row.labels) == pytest.approx({"mug": 1.8 / 2.3, "cup": 0.5 / 2.3})
    assert (row.observations, row.first_seen_s, row.last_seen_s) == (3, 1.0, 3.0)
    assert row.version > version


def test_one_stable_half_makes_the_whole_stable():
    desk = SmallMap()
    for _ in range(3):
        desk.see({1: (AT, "cup")})
    desk.see({0: (AT, "cup")})
    assert (desk.row(0).state, desk.row(1).state) == ("tentative", "stable")
    desk.smoother.merge(0, 1)
    desk.objects.merge(0, 1)
    assert desk.row(0).state == "stable"


def test_what_proves_two_to_be_two_outlives_a_merge():
    """2 was seen apart from 1; 1 goes into 0, so 2 was seen apart from 0."""
    desk = SmallMap()
    for _ in range(3):
        desk.see({1: (AT, "cup"), 2: (AT + np.array([0, 0.2, 0]), "cup")})
    desk.see({0: (AT, "cup")})
    assert desk.objects.times_apart(1, 2) == desk.objects.times_apart(2, 1) == 3
    assert desk.objects.times_apart(0, 2) == 0
    desk.smoother.merge(0, 1)
    desk.objects.merge(0, 1)
    assert desk.objects.times_apart(0, 2) == 3
    assert desk.objects.times_apart(1, 2) == 0


def test_the_word_of_an_agent_outlives_a_merge():
    desk = SmallMap()
    desk.see({0: (AT, "cup")})
    desk.see({1: (AT, "cup")})
    desk.objects.relabel(1, "teapot", np.eye(8)[0])
    desk.smoother.merge(0, 1)
    desk.objects.merge(0, 1)
    assert desk.row(0).label == "teapot"
