"""A part that raises in the middle of a step: what was done stays whole, and the next frame goes on from there."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest

from seo_slam.association.two_stage import TwoStageAssociator
from seo_slam.backends.memory_store import MemoryStore
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.errors import MapError
from seo_slam.interfaces import Agent
from seo_slam.map import Map
from seo_slam.records import Remove
from seo_slam.testing.worlds import tiny_trajectory
from tiny_run import centre_world, frames, pipeline


class FailingAssociator(TwoStageAssociator):
    """Fails at one keyframe."""

    def __init__(self, at):
        super().__init__()
        self.left = at

    def associate(self, observations, landmarks, estimate):
        self.left -= 1
        if self.left == -1:
            raise RuntimeError("a fault of the plug-in")
        return super().associate(observations, landmarks, estimate)


class FailingAgent(Agent):
    """Fails at one keyframe."""

    def __init__(self, at):
        self.left = at

    def propose(self, view):
        self.left -= 1
        if self.left == -1:
            raise RuntimeError("a fault of the plug-in")
        return []


class FailingStore(MemoryStore):
    """Refuses one keyframe, as a full disk would."""

    def __init__(self, at):
        super().__init__()
        self.left = at

    def commit(self, record):
        self.left -= 1
        if self.left == -1:
            raise MapError("the disk is full")
        super().commit(record)


@pytest.mark.parametrize("at", [0, 1, 2])
@pytest.mark.parametrize(
    "broken",
    [lambda at: {"associator": FailingAssociator(at)}, lambda at: {"agents": [FailingAgent(at)]}, lambda at: {"store": FailingStore(at)}],
)
def test_a_part_that_fails_once_spoils_nothing(broken, at):
    failures = 0
    with pipeline(12, **broken(at)) as made:
        for frame in frames(12):
            try:
                made.step(frame)
            except (RuntimeError, MapError):
                failures += 1
        result = made.result()
        kept = made.parts.store.landmarks()
    assert failures == ("agents" not in broken(at))  # an agent's fault is a warning, and no frame is lost
    assert ("agent FailingAgent: RuntimeError: a fault of the plug-in" in result.warnings) == ("agents" in broken(at))
    found = {row.label: row for row in result.map.landmarks}
    assert sorted(found) == ["book", "cup"]
    for label, row in found.items():
        assert np.linalg.norm(row.position_m - centre_world(label)) < 0.03
    rows = np.searchsorted(np.round(0.1 * np.arange(12), 6), result.trajectory.timestamps_s)
    np.testing.assert_allclose(result.trajectory.T_world_camera, tiny_trajectory(12)[rows], atol=0.01)
    assert [row.id for row in kept] == sorted(row.id for row in (*result.map.landmarks, *result.map.tentative))


def test_what_an_agent_removed_before_another_one_failed_leaves_the_store(tmp_path):
    class RemovesFirst(Agent):
        def propose(self, view):
            return [Remove(0, int(view.landmarks.versions[0]))] if 0 in view.landmarks.ids else []

    config = {"edits": {"rails": False}}
    with pipeline(config=config, store=SqliteStore(tmp_path / "map.db"), agents=[RemovesFirst(), FailingAgent(2)]) as made:
        for frame in frames():
            with contextlib.suppress(RuntimeError):
                made.step(frame)
        in_map = made.snapshot()
        kept = made.parts.store.landmarks()
    assert [row.id for row in kept] == sorted(row.id for row in (*in_map.landmarks, *in_map.tentative))
    assert 0 not in [row.id for row in kept]


def test_ids_in_a_store_are_not_reused_by_a_run_without_its_map(tmp_path):
    with pipeline(store=SqliteStore(tmp_path / "map.db")) as made:
        for frame in frames():
            made.step(frame)
    with pipeline(store=SqliteStore(tmp_path / "map.db")) as made:  # no map=: what it finds is new
        for frame in frames():
            made.step(frame)
        ids = {row.id for row in made.snapshot().landmarks}
    assert ids == {2, 3}
    with SqliteStore(tmp_path / "map.db", read_only=True) as store:
        assert [keyframe for keyframe, kind, _, _ in store.history(0) if kind == "created"] == [0]
    assert {0, 1, 2, 3} == {row.id for row in Map.load(tmp_path / "map.db").landmarks}


def test_a_label_without_any_score_is_a_label():
    made = pipeline()
    real = made.parts.detector.detect
    made.parts.detector.detect = lambda frame: replace(real(frame), scores=np.zeros(len(real(frame))))
    with made:
        for frame in frames():
            made.step(frame)
        rows = made.result().map.landmarks
    assert sorted(row.label for row in rows) == ["book", "cup"]
    for row in rows:
        assert row.labels == {row.label: 1.0}
        assert np.linalg.norm(row.embedding) == pytest.approx(1.0)
