"""A simulated room in which things are taken away and moved, seen without noise, through the whole pipeline."""

import pytest

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Config
from seo_slam.evaluation.landmarks import evaluate_landmarks
from seo_slam.evaluation.truth import truth_from
from seo_slam.pipeline import Pipeline
from seo_slam.simulation.rooms import SimulatedRoom


@pytest.fixture(scope="module")
def walked():
    """The room, and what two presets make of the same frames."""
    room = SimulatedRoom("SM1", seed=0, level=0, frames=100, width=240, height=180)
    pipelines = {
        name: Pipeline(Config.preset(name), detector=room.detector, odometry=RecordedOdometry(room.odometry), embedder=HashedEmbedder())
        for name in ("seo_slam", "rg")
    }
    for frame in room:
        for pipeline in pipelines.values():
            pipeline.step(frame)
    return room, {name: pipeline.result() for name, pipeline in pipelines.items()}


def scored(room, result):
    return evaluate_landmarks(result.map.landmarks, truth_from(room.truth))


def test_the_map_at_the_end_is_what_is_there_at_the_end(walked):
    room, results = walked
    score = scored(room, results["seo_slam"]).score
    assert score.objects == 9
    assert score.f1 >= 0.94  # one mistake at most


def test_without_a_life_cycle_what_was_there_haunts_the_map(walked):
    room, results = walked
    assert {item.kind for item in scored(room, results["rg"]).extra} >= {"ghost"}
    assert {event.kind for _, event in results["rg"].events} == {"created", "stable"}
    assert all(item.kind != "ghost" for item in scored(room, results["seo_slam"]).extra)


def test_what_moved_keeps_its_id(walked):
    """Each thing that the map says has moved did move in truth, and is where it is now."""
    room, results = walked
    moved = {event.landmark_id for _, event in results["seo_slam"].events if event.kind == "moved"}
    assert len(moved) >= 2
    truly = {str(entry["id"]) for entry in room.truth["timeline"] if entry["event"] == "moved"}
    matched = {match.landmark_id: match.object_id for match in scored(room, results["seo_slam"]).matched}
    assert {matched[landmark_id] for landmark_id in moved} <= truly
    halfway_s = room.trajectory.timestamps_s[len(room) // 2]
    rows = {row.id: row for row in results["seo_slam"].map.landmarks}
    assert all(rows[landmark_id].first_seen_s < halfway_s for landmark_id in moved)
