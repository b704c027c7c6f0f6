"""Painted blocks through the whole pipeline: what is taken away leaves the map, what moves keeps its id, the store agrees."""

from dataclasses import replace

import numpy as np
import pytest

from painted_blocks import Block, boxes, frame, pose
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.config import Config
from seo_slam.map import Map
from seo_slam.pipeline import Pipeline
from seo_slam.records import Trajectory
from seo_slam.types import Detections

CUP, BOOK, LAMP, SHOE = Block("cup", -0.3), Block("book", 0.0), Block("lamp", 0.3), Block("shoe", 0.1, -0.25)
THERE = replace(CUP, x=-0.15, y=-0.25)
REST = [BOOK, LAMP, SHOE]
PRESENT = [[CUP, *REST]] * 12 + [REST] * 12 + [[THERE, *REST]] * 12
"""The blocks there are in each frame: the cup is taken away, and put down elsewhere."""

PAPERS = ["rg", "rg_d"]


class Finder:
    """Finds all blocks that there are, and what a mistake adds."""

    def __init__(self, present, mistakes=None):
        self.present, self.mistakes = present, mistakes or {}

    def detect(self, frame):
        found = boxes([*self.present[frame.index], *self.mistakes.get(frame.index, [])])
        return Detections(found.boxes_px, found.labels, found.scores)


def run(present, preset="seo_slam", mistakes=None, **parts):
    """Frames half a second apart, every one a keyframe, from a camera that stands still."""
    stamps_s = 0.5 * np.arange(len(present))
    odometry = RecordedOdometry(Trajectory(stamps_s, np.array([pose()] * len(present))))
    detector = Finder(present, mistakes)
    with Pipeline(Config.preset(preset), detector=detector, odometry=odometry, embedder=HashedEmbedder(), agents=(), **parts) as pipeline:
        for index, blocks in enumerate(present):
            pipeline.step(frame(index, blocks))
        return pipeline.result()


def kinds(result, *wanted):
    return [(event.kind, event.landmark_id) for _, event in result.events if event.kind in wanted]


def test_a_thing_that_moves_is_one_thing_all_along():
    result = run(PRESENT)
    assert kinds(result, "lost", "removed", "moved") == [("lost", 0), ("removed", 0), ("moved", 0)]
    found = {row.id: row for row in result.map.landmarks}
    assert {i: row.label for i, row in found.items()} == {0: "cup", 1: "book", 2: "lamp", 3: "shoe"}
    assert found[0].position_m == pytest.approx(THERE.p_world, abs=0.02)
    assert found[0].first_seen_s == 0.0
    assert found[0].observations == 24
    assert result.map.tentative == ()
    assert min(row.existence for row in result.map.landmarks) > 0.5


def test_store_and_map_agree_after_a_move(tmp_path):
    with SqliteStore(tmp_path / "map.db") as store:
        result = run(PRESENT, store=store)
    (move,) = [event for _, event in result.events if event.kind == "moved"]
    with SqliteStore(tmp_path / "map.db", read_only=True) as store:
        kept = {row.id: row for row in store.landmarks()}
        assert sorted(kept) == [0, 1, 2, 3]
        assert kept[0].position_m == pytest.approx(THERE.p_world, abs=0.02)
        assert (kept[0].label, kept[0].state, kept[0].observations) == ("cup", "stable", 24)
        assert [kind for _, kind, *_ in store.history(0)] == ["created", "stable", "lost", "removed", "moved"]
        assert [kind for _, kind, *_ in store.history(move.other_id)][:2] == ["created", "stable"]
        assert store.next_id() == result.map.next_id == move.other_id + 1
    loaded = Map.load(tmp_path / "map.db")
    assert [row.id for row in loaded.landmarks] == [row.id for row in result.map.landmarks]


def test_ids_of_what_left_are_not_given_again(tmp_path):
    with SqliteStore(tmp_path / "map.db") as store:
        first = run(PRESENT[:24], store=store)
    assert [row.id for row in first.map.landmarks] == [1, 2, 3]
    with SqliteStore(tmp_path / "map.db") as store:
        second = run([[BOOK, LAMP, SHOE, CUP]] * 6, store=store, map=Map.load(tmp_path / "map.db"))
    assert {row.label: row.id for row in second.map.landmarks} == {"book": 1, "lamp": 2, "shoe": 3, "cup": 4}


def test_a_mistake_seen_now_and_then_among_well_found_things_is_gone_at_the_end():
    """Its box lies on the wall: what it shows is still there, only the detector does not find it again."""
    names = ["cup", "book", "lamp", "shoe", "ball", "fork", "radio", "plant", "clock", "purse", "towel", "drum"]
    many = [Block(name, -0.6 + 0.24 * (k % 6), 0.05 + 0.3 * (k // 6), half_m=0.05) for k, name in enumerate(names)]
    now_and_then = {index: [Block("vase", -0.15, -0.3)] for index in range(4, 60, 14)}
    result = run([many] * 60, mistakes=now_and_then)
    assert sorted(row.label for row in result.map.landmarks) == sorted(names)
    assert result.map.next_id > len(names)


@pytest.mark.parametrize("preset", PAPERS)
def test_the_papers_variants_never_take_anything_away(preset):
    result = run(PRESENT, preset, mistakes={index: [Block("vase", 0.35, -0.25)] for index in range(4)})
    assert kinds(result, "lost", "removed", "moved", "found", "merged") == []
    assert sorted(row.label for row in result.map.landmarks) == ["book", "cup", "cup", "lamp", "shoe", "vase"]
    assert {row.existence for row in result.map.landmarks} == {1.0}


@pytest.mark.parametrize(
    ("preset", "associator", "enabled"),
    [("rg", "nearest", False), ("rg_d", "two_stage", False), ("seo_slam", "two_stage", True)],
)
def test_presets_say_what_they_are(preset, associator, enabled):
    config = Config.preset(preset)
    assert (config.associator.name, config.life.enabled, config.map.merge_duplicates) == (associator, enabled, enabled)


def test_the_same_frames_give_the_same_life():
    first, second = run(PRESENT), run(PRESENT)
    assert first.map.to_json() == second.map.to_json()
    assert first.events == second.events


def test_views_that_err_together_make_a_landmark_less_sure_and_not_elsewhere():
    def thing(views):
        config = Config.preset("seo_slam").updated({"graph": {"views_that_err_together": views}}, "test")
        odometry = RecordedOdometry(Trajectory(0.5 * np.arange(8), np.array([pose()] * 8)))
        with Pipeline(config, detector=Finder(PRESENT), odometry=odometry, embedder=HashedEmbedder(), agents=()) as pipeline:
            for index in range(8):
                pipeline.step(frame(index, PRESENT[index]))
            return pipeline.result().map.landmarks[0]

    alone, together = thing(1.0), thing(9.0)
    assert np.trace(together.covariance_m2) > 4 * np.trace(alone.covariance_m2)
    assert together.position_m == pytest.approx(alone.position_m, abs=1e-3)


class LostFrom:
    """Odometry that loses its way at a frame and guesses that the camera stands still."""

    def __init__(self, first, count):
        self.first = first
        self.inner = RecordedOdometry(Trajectory(0.5 * np.arange(count), np.array([pose()] * count)))

    def update(self, frame):
        motion = self.inner.update(frame)
        return motion if frame.index < self.first else replace(motion, status="lost", message="test")


def test_a_camera_that_lost_its_way_takes_nothing_off_the_map():
    present = [[CUP, *REST]] * 12 + [[]] * 8  # it looks elsewhere from then on, and thinks that it still stands there
    results = {}
    for first in (12, 99):
        with Pipeline(detector=Finder(present), odometry=LostFrom(first, len(present)), embedder=HashedEmbedder(), agents=()) as pipeline:
            for index, blocks in enumerate(present):
                pipeline.step(frame(index, blocks))
            results[first] = pipeline.result()
    assert len(results[12].map.landmarks) == 4
    assert kinds(results[12], "lost", "removed") == []
    assert len(results[99].map.landmarks) == 0  # had it really stood there, they would be gone
