"""A landmark's list of observations: counted, parted, joined, and taken over from a map that is continued."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam.mapping.observation_record import NULL, ObservationRecord
from seo_slam.settings.observing import CloudSettings
from seo_slam.testing.store import make_landmark
from seo_slam.testing.worlds import T_WORLD_FIRST

SETTINGS = CloudSettings(enabled=True)
POSES = T_WORLD_FIRST[None]
POINTS = np.array([0.0, 0.0, 1.0]) + np.random.default_rng(5).uniform(-0.05, 0.05, (200, 3))


def restored(**changes):
    landmark = replace(make_landmark(3), cloud_world=POINTS, **changes)
    return ObservationRecord.restored(landmark, SETTINGS, T_WORLD_FIRST)


@pytest.mark.parametrize(
    ("labels", "observations", "counts"),
    [
        ({"cup": 0.75, "bowl": 0.25}, 4, {"cup": 3, "bowl": 1}),
        ({"cup": 0.4, "bowl": 0.3, "mug": 0.3}, 1, {"cup": 1}),
        ({"cup": 0.5, "bowl": 0.5}, 1, {"cup": 1}),
        ({"cup": 0.3333, "bowl": 0.3333, "mug": 0.3333}, 3000, {"cup": 1000, "bowl": 1000, "mug": 1000}),
        ({"cup": 1.0, "bowl": 0.0}, 5, {"cup": 5}),
        ({}, 7, {NULL: 7}),
    ],
)
def test_a_restored_list_has_as_many_observations_as_the_landmark_had(labels, observations, counts):
    record = restored(labels=labels, observations=observations)
    assert (record.counts(), len(record)) == (counts, observations)
    assert not len(record.of_words(set(counts)))  # the smoother has no measurement of any


@pytest.mark.parametrize("labels", [{"cup": 0.75, "bowl": 0.25}, {"cup": 1.0}, {}])
@pytest.mark.parametrize("cloud", [POINTS, np.zeros((0, 3))], ids=["cloud", "no cloud"])
def test_every_restored_word_has_a_look_and_a_place(labels, cloud):
    landmark = replace(make_landmark(3), labels=labels, cloud_world=cloud)
    record = ObservationRecord.restored(landmark, SETTINGS, T_WORLD_FIRST)
    assert record.majority(alike_cosine=0.75) == pytest.approx(1.0)  # of one look, so names of one thing
    assert record.majority() == pytest.approx(max(labels.values(), default=1.0))
    np.testing.assert_allclose(record.feature(), landmark.embedding)
    sizes = [len(record.cloud_of(word, POSES)) for word in record.counts()]
    assert sizes[0] == len(record.cloud(POSES)) > 0
    assert not any(sizes[1:])
    record.add("bowl", 0, landmark.embedding, np.array([[0.0, 0.0, 9.0]]), POSES)
    assert len(record.cloud(POSES)) == sizes[0] + 1


def test_what_comes_without_a_cloud_is_taken_for_its_box():
    landmark = make_landmark(3)
    low, high = ObservationRecord.restored(landmark, SETTINGS, T_WORLD_FIRST).cloud(POSES).bounds
    np.testing.assert_allclose(0.5 * (low + high), landmark.position_m, atol=1e-6)
    np.testing.assert_allclose(high - low, landmark.size_m, atol=2 * SETTINGS.voxel_m)


def test_a_restored_list_can_be_parted_by_any_of_its_words():
    record = restored()
    rest = record.taken({"cup"})
    assert (record.counts(), rest.counts()) == ({"bowl": 1}, {"cup": 3})
    assert (len(record.cloud(POSES)), record.nbytes) == (0, 0)
    record.absorb(rest, POSES)
    assert len(record.cloud(POSES)) == len(rest.cloud(POSES)) > 0
