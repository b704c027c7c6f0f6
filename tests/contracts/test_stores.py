"""One suite over every store; a plug-in's author runs the same ``check_store``."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends.memory_store import MemoryStore
from seo_slam.errors import FrameError
from seo_slam.records import Amendment
from seo_slam.testing.store import check_store, make_edit, make_landmark, make_record


@pytest.fixture(params=["memory", "sqlite"])
def make_store(request, tmp_path):
    numbers = itertools.count()
    return lambda: registry.create("store", request.param, path=tmp_path / f"{next(numbers)}" / "map.db")


def test_contract(make_store):
    check_store(make_store)


class KeepsRemoved(MemoryStore):
    def commit(self, record):
        super().commit(replace(record, removed_ids=()))


class TakesIdsTwice(MemoryStore):
    def commit(self, record):
        self._last_id = None
        super().commit(record)


class FarthestFirst(MemoryStore):
    def near(self, p_world, radius_m):
        return super().near(p_world, radius_m)[::-1]


class WritesBeforeItChecks(MemoryStore):
    def commit(self, record):
        self._landmarks.update({row.id: row for row in record.landmarks})
        super().commit(record)


class LosesHistory(MemoryStore):
    def history(self, landmark_id):
        return super().history(landmark_id)[-1:]


class ReusesIds(MemoryStore):
    def next_id(self):
        return max((row.id + 1 for row in self.landmarks()), default=0)


class NeverCloses(MemoryStore):
    def close(self):
        pass


class ForgetsEditsOfKeyframes(MemoryStore):
    def edits(self):
        return tuple(edit for edit in super().edits() if edit.outcome == "applied")


class ForgetsHowItWas(MemoryStore):
    def edits(self):
        return tuple(replace(edit, before=()) for edit in super().edits())


class AmendsAnyKeyframe(MemoryStore):
    def amend(self, amendment):
        super().amend(replace(amendment, keyframe_id=self._last_id))


class AmendsTheKeyframeItself(MemoryStore):
    def amend(self, amendment):
        super().amend(amendment)
        kept = self._keyframes[amendment.keyframe_id]
        self._keyframes[amendment.keyframe_id] = replace(kept, events=(*kept.events, *amendment.events))


class CountsIdsOfEdits(MemoryStore):
    def next_id(self):
        return max(super().next_id(), *(edit.landmark_id + 1 for edit in self._edits), 0)


@pytest.mark.parametrize(
    "broken",
    [
        KeepsRemoved, TakesIdsTwice, FarthestFirst, WritesBeforeItChecks, LosesHistory, ReusesIds, NeverCloses,
        ForgetsEditsOfKeyframes, ForgetsHowItWas, AmendsAnyKeyframe, AmendsTheKeyframeItself, CountsIdsOfEdits,
    ],
)  # fmt: skip
def test_contract_catches(broken):
    with pytest.raises(AssertionError):
        check_store(broken)


@pytest.mark.parametrize(("point", "radius_m"), [([0, 0], 1), ([0, 0, np.nan], 1), ([0, 0, 0], -1), ([0, 0, 0], np.nan)])
def test_near_refuses_what_is_no_ball(make_store, point, radius_m):
    with make_store() as store, pytest.raises(FrameError):
        store.near(np.array(point, dtype=float), radius_m)


def test_near_agrees_with_distances_of_many(make_store):
    rng = np.random.default_rng(3)
    places = rng.uniform(-100, 100, size=(300, 3))
    with make_store() as store:
        store.commit(make_record(0, landmarks=tuple(make_landmark(i, p) for i, p in enumerate(places))))
        for centre, radius_m in ((places[5], 0.0), (np.zeros(3), 40.0), (places[7] + 1, 60.0), (np.zeros(3), np.inf)):
            distances_m = np.linalg.norm(places - centre, axis=1)
            wanted = [int(i) for i in np.argsort(distances_m) if distances_m[i] <= radius_m]
            assert list(store.near(centre, radius_m)) == wanted


def test_observations_of_a_landmark_rebuild_its_factors(make_store):
    first, second = make_record(0, (4, 2, 6)), make_record(1, (2, 4))
    with make_store() as store:
        for record in (first, second):
            store.commit(record)
        keyframe_ids, observations = store.observations(2)
        nowhere, none = store.observations(77)
    assert keyframe_ids.tolist() == [0, 1]
    assert np.array_equal(observations.p_camera, [first.observations.p_camera[1], second.observations.p_camera[0]])
    assert np.array_equal(observations.rows, [1, 1])
    assert observations.embeddings.shape == (2, 8)
    assert len(nowhere) == len(none) == 0


def test_poses_are_those_committed(make_store):
    records = [make_record(k) for k in (0, 1, 5)]
    with make_store() as store:
        for record in records:
            store.commit(record)
        stamps, poses = store.poses()
    assert stamps.tolist() == [r.timestamp_s for r in records]
    assert np.array_equal(poses, [r.T_world_camera for r in records])


def test_ids_of_landmarks_that_left_are_not_free_again(make_store):
    with make_store() as store:
        assert store.next_id() == 0
        store.commit(make_record(0, landmarks=(make_landmark(3),)))
        store.commit(make_record(1, removed_ids=(3,)))
        assert store.next_id() == 4
        store.commit(make_record(2, landmark_ids=(9,)))
        assert store.next_id() == 10
        store.set_meta("next_id", "20")
        assert store.next_id() == 20


def test_clouds_are_not_kept(make_store):
    with make_store() as store:
        store.commit(make_record(0, (1, 2)))
        assert [cloud.shape for cloud in store.keyframe(0).observations.clouds] == [(0, 3), (0, 3)]


def test_clouds_of_landmarks_are_not_kept_and_all_embeddings_in_single_precision(make_store):
    features = np.random.default_rng(5).normal(size=(3, 8))
    landmark = replace(make_landmark(1), embedding=features[0], cloud_world=np.ones((500, 3)))
    record = make_record(0, (1, 1), (landmark,), edits=(make_edit(before=(landmark,)),))
    with make_store() as store:
        store.commit(replace(record, observations=replace(record.observations, embeddings=features[1:])))
        kept = store.keyframe(0)
        measured = store.observations(1)[1].embeddings
        store.amend(Amendment(0, (landmark,), (), (), (make_edit(before=(landmark,)),)))
        rows = [*kept.landmarks, *kept.edits[0].before, *store.landmarks(), *(row for edit in store.edits() for row in edit.before)]
    assert [len(row.cloud_world) for row in rows] == [0] * 5
    rounded = features.astype(np.float32).astype(np.float64)
    for got, wanted in [(row.embedding, rounded[0]) for row in rows] + [
        (kept.observations.embeddings, rounded[1:]),
        (measured, rounded[1:]),
    ]:
        assert got.dtype == np.float64
        assert np.array_equal(got, wanted)


def test_an_embedding_that_stays_as_it_was_takes_no_memory_again():
    store = MemoryStore()
    for keyframe_id in range(2):
        store.commit(make_record(keyframe_id, (1,), (make_landmark(1, version=keyframe_id),)))
    kept = [store._keyframes[keyframe_id] for keyframe_id in range(2)]
    assert kept[0].landmarks[0].embedding is kept[1].landmarks[0].embedding
    assert {record.observations.embeddings.dtype for record in kept} == {np.dtype(np.float32)}
