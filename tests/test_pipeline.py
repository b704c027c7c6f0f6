"""The main loop on a tiny world: what a frame does, what the world's failures do, and that the map disposes."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from seo_slam.association.nearest import NearestAssociator
from seo_slam.association.two_stage import TwoStageAssociator
from seo_slam.backends.gtsam_smoother import GtsamSmoother
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.memory_store import MemoryStore
from seo_slam.backends.no_detector import NoDetector
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.config import Component, Config
from seo_slam.errors import AgentError, ConfigError, DatasetError, FrameError, MissingBackendError, UnknownBackendError
from seo_slam.geometry import exp, inverse
from seo_slam.interfaces import Agent
from seo_slam.map import Map
from seo_slam.pipeline import LEVEL_FIRST_CAMERA, Pipeline
from seo_slam.records import Confirm, Merge, Relabel, Remove
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_frames, tiny_trajectory
from seo_slam.types import NEW, Detections, Motion
from tiny_run import BlockDetector, centre_world, frames, pipeline, recorded, trajectory


def run(made, given):
    with made:
        steps = list(made.stream(given))
        return steps, made.result()


def test_things_are_where_they_are():
    _, result = run(pipeline(), frames())
    found = {row.label: row for row in result.map.landmarks}
    assert sorted(found) == ["book", "cup"]
    for label, row in found.items():
        assert np.linalg.norm(row.position_m - centre_world(label)) < 0.03
        assert row.observations == 4
    assert result.map.gravity == "poses"
    assert result.map.embedder == "hashed"
    np.testing.assert_allclose(result.trajectory.T_world_camera, tiny_trajectory(8), atol=0.01)
    np.testing.assert_array_equal(result.trajectory.timestamps_s, trajectory(8).timestamps_s)


def test_step_results_say_what_a_frame_did():
    steps, result = run(pipeline(), frames())
    assert [step.is_keyframe for step in steps] == [True, False] * 4
    assert [step.keyframe_id for step in steps if step.is_keyframe] == [0, 1, 2, 3]
    assert [step.index for step in steps] == list(range(8))
    first, second, third = steps[:3]
    assert first.landmark_ids.tolist() == [0, 1]
    assert (first.association.landmark_ids == NEW).all()
    assert [(event.kind, event.landmark_id) for event in first.events] == [("created", 0), ("created", 1)]
    assert len(first.detections) == len(first.observations) == 2
    assert second.detections is second.observations is second.association is second.landmark_ids is None
    assert second.events == ()
    assert second.keyframe_id is None
    assert third.landmark_ids.tolist() == [0, 1]
    assert third.association.landmark_ids.tolist() == [0, 1]
    assert all(step.warnings == () and step.odometry_status == "ok" for step in steps)
    assert {"odometry", "detect", "observe", "associate", "smooth", "map", "store"} <= set(first.seconds)
    assert set(second.seconds) == {"odometry"}
    for step, T in zip(steps, tiny_trajectory(8), strict=True):
        np.testing.assert_allclose(step.T_world_camera, T, atol=0.02)
    assert (result.frames, result.keyframes, result.lost_frames, result.detections, result.observations) == (8, 4, 0, 8, 8)
    assert [event for _, event in result.events] == [event for step in steps for event in step.events]
    assert result.seconds["detect"]["number"] == 4
    assert result.warnings == {}


def test_the_detector_sees_keyframes_only():
    made = pipeline()
    run(made, frames())
    assert made.parts.detector.calls == 4


@pytest.mark.parametrize(
    ("keyframes", "wanted"),
    [
        ({"distance_m": 0.04, "angle_deg": 90.0, "period_s": 9.0}, [0, 1, 2, 3, 4, 5]),
        ({"distance_m": 0.1, "angle_deg": 90.0, "period_s": 9.0}, [0, 3]),
        ({"distance_m": 9.0, "angle_deg": 2.0, "period_s": 9.0}, [0, 2, 4]),
        ({"distance_m": 9.0, "angle_deg": 90.0, "period_s": 0.3}, [0, 3]),
        ({"distance_m": 9.0, "angle_deg": 90.0, "period_s": 9.0}, [0]),
    ],
)
def test_keyframes_by_distance_angle_or_time(keyframes, wanted):
    steps, _ = run(pipeline(6, {"keyframes": keyframes}), frames(6))
    assert [step.index for step in steps if step.is_keyframe] == wanted


def test_the_map_can_be_looked_at_while_it_grows():
    made = pipeline()
    with made:
        sizes = [len(made.snapshot().landmarks) for _ in made.stream(frames())]
        early = made.result()
    assert sizes[0] == 0
    assert sizes[-1] == 2
    assert len(early.trajectory) == 8
    assert len(made.result().map.landmarks) == 2  # after close, too


def test_nothing_seen_yet_is_an_empty_result():
    result = pipeline().result()
    assert (result.frames, len(result.map), len(result.trajectory)) == (0, 0, 0)
    assert result.map.to_json()


# --- the world's failures --------------------------------------------------------------------------------------------------------


def test_a_frame_without_depth_is_a_warning_and_the_run_goes_on():
    steps, result = run(pipeline(), frames(without_depth=(2,)))
    assert "no depth" in steps[2].warnings[0]
    assert len(steps[2].observations) == 0
    assert len(steps[2].detections) == 2
    assert len(result.map.landmarks) == 2
    assert [row.observations for row in result.map.landmarks] == [3, 3]
    assert list(result.warnings.values()) == [1]


def test_a_recording_without_any_depth_gives_an_empty_map_and_a_trajectory():
    _, result = run(pipeline(), frames(without_depth=range(8)))
    assert len(result.map) == 0
    assert len(result.trajectory) == 8
    assert list(result.warnings.values()) == [4]


def test_no_detections_is_a_warning():
    steps, result = run(pipeline(detector=NoDetector()), frames())
    assert [step.warnings for step in steps[:2]] == [("no detections",), ()]
    assert result.warnings == {"no detections": 4}
    assert len(result.trajectory) == 8


class Losing:
    """Loses the camera at some frames."""

    def __init__(self, inner, lost):
        self.inner, self.lost = inner, lost

    def update(self, frame):
        motion = self.inner.update(frame)
        if frame.index not in self.lost:
            return motion
        return replace(
            motion, T_previous_current=np.eye(4), covariance=np.diag([0.03**2] * 3 + [0.06**2] * 3), status="lost", message="too dark"
        )


def test_lost_odometry_is_a_warning_and_the_map_helps_out():
    steps, result = run(pipeline(odometry=Losing(recorded(8), {4})), frames())
    assert steps[4].odometry_status == "lost"
    assert any("odometry is lost: too dark" in warning for warning in steps[4].warnings)
    assert result.lost_frames == 1
    assert len(result.map.landmarks) == 2
    # The keyframe saw both blocks, which put the camera near where it was, though odometry said nothing of this step.
    assert np.linalg.norm(steps[4].T_world_camera[:3, 3] - tiny_trajectory(8)[4][:3, 3]) < 0.05


def test_a_gap_in_the_poses_places_nothing_where_the_camera_is_a_guess():
    """Between frames 4 and 7 there are no poses: what is seen then makes no landmarks, so that none is where nothing is."""
    gap = recorded(12, max_gap_s=0.15)
    keep = np.r_[0:4, 8:12]
    gap.trajectory = replace(
        gap.trajectory, timestamps_s=gap.trajectory.timestamps_s[keep], T_world_camera=gap.trajectory.T_world_camera[keep]
    )
    made = pipeline(12, odometry=gap, detector=BlockDetector(tiny_trajectory(12)))
    steps, result = run(made, frames(12))
    assert [step.odometry_status for step in steps] == ["ok"] * 4 + ["lost"] * 4 + ["ok"] * 4
    for step in steps[4:9]:
        assert [event.kind for event in step.events if event.kind == "created"] == []
    assert sorted(result.warnings.values()) == [4]  # one warning for the gap, not one a frame
    rows = (*result.map.landmarks, *result.map.tentative)
    assert {row.label for row in rows} == {"cup", "book"}
    for row in rows:
        assert np.linalg.norm(row.position_m - centre_world(row.label)) < 0.08
    np.testing.assert_allclose(steps[-1].T_world_camera, tiny_trajectory(12)[-1], atol=0.05)


def test_frames_before_the_first_pose_are_left_out():
    late = recorded(8)
    late.trajectory = replace(
        late.trajectory, timestamps_s=late.trajectory.timestamps_s[3:], T_world_camera=late.trajectory.T_world_camera[3:]
    )
    steps, result = run(pipeline(odometry=late), frames())
    assert [step.odometry_status for step in steps] == ["lost"] * 3 + ["ok"] * 5
    assert all("not found its first pose" in step.warnings[-1] for step in steps[:3])
    assert [step.keyframe_id for step in steps] == [None] * 3 + [0, None, 1, None, 2]
    np.testing.assert_allclose(steps[3].T_world_camera, tiny_trajectory(8)[3], atol=1e-6)
    assert (result.frames, result.lost_frames, len(result.trajectory)) == (8, 3, 5)
    assert {row.label for row in result.map.landmarks} == {"cup", "book"}


def test_odometry_without_absolute_poses_starts_level():
    class Relative:
        def __init__(self):
            self.inner = recorded(8)

        def update(self, frame):
            return replace(self.inner.update(frame), T_world_camera=None)

    steps, result = run(pipeline(odometry=Relative()), frames())
    np.testing.assert_allclose(steps[0].T_world_camera, LEVEL_FIRST_CAMERA, atol=1e-9)
    assert result.map.gravity == "unknown"
    assert len(result.map.landmarks) == 2


@pytest.mark.parametrize("stamp", [0.1, 0.05, -1.0])
def test_time_going_backwards_is_an_error_and_changes_nothing(stamp):
    def everything(made):
        result = made.result()
        return result.map.to_json(), result.frames, result.keyframes, dict(result.warnings), len(result.trajectory)

    given = frames()
    made, control = pipeline(), pipeline()
    for frame in given[:2]:
        made.step(frame)
        control.step(frame)
    before = everything(made)
    with pytest.raises(FrameError, match=r"frame 77: time goes backwards, t=.* after t=0\.1"):
        made.step(replace(given[2], timestamp_s=stamp, index=77))
    assert everything(made) == before
    for frame in given[2:]:
        made.step(frame)
        control.step(frame)
    assert made.result().map.to_json() == control.result().map.to_json()


class FailsOnce(BlockDetector):
    """Returns NaN for one frame."""

    def __init__(self, poses, at):
        super().__init__(poses)
        self.at = at

    def detect(self, frame):
        found = super().detect(frame)
        if frame.index == self.at:
            return {"boxes": np.full((1, 4), np.nan), "labels": ["cup"], "scores": [0.5]}
        return found


@pytest.mark.parametrize("at", [0, 4])
def test_a_detector_that_returns_nonsense_is_an_error_and_the_next_frame_goes_on(at):
    made = pipeline(detector=FailsOnce(tiny_trajectory(8), at))
    with made:
        for frame in frames():
            if frame.index == at:
                with pytest.raises(FrameError, match=f"frame {at}.*FailsOnce|FailsOnce.*frame {at}"):
                    made.step(frame)
            else:
                made.step(frame)
        result = made.result()
    found = {row.label: row for row in result.map.landmarks}
    assert sorted(found) == ["book", "cup"]
    for label, row in found.items():
        assert np.linalg.norm(row.position_m - centre_world(label)) < 0.03
    np.testing.assert_allclose(result.trajectory.T_world_camera[-1], tiny_trajectory(8)[-1], atol=0.01)


# --- determinism, stores, continuation --------------------------------------------------------------------------------------------


def test_the_same_frames_give_the_same_bytes():
    assert run(pipeline(), frames())[1].map.to_json() == run(pipeline(), frames())[1].map.to_json()


def test_the_store_holds_what_the_result_says(tmp_path):
    store = SqliteStore(tmp_path / "map.db")
    _, result = run(pipeline(store=store), frames())
    loaded = Map.load(tmp_path / "map.db")
    assert loaded.gravity == "poses"
    assert loaded.embedder == "hashed"
    assert [row.id for row in loaded.landmarks] == [row.id for row in result.map.landmarks]
    for kept, row in zip(loaded.landmarks, result.map.landmarks, strict=True):
        np.testing.assert_allclose(kept.position_m, row.position_m, atol=0.02)
        assert (kept.label, kept.observations, kept.version) == (row.label, row.observations, row.version)


def test_a_map_is_continued_with_its_ids_and_none_is_reused():
    made = pipeline(config=AS_PROPOSED, agents=[Once(lambda rows: [Remove(rows[1].id, rows[1].version)], keyframe=3)])
    _, first = run(made, frames())
    assert [row.id for row in first.map.landmarks] == [0]
    assert first.map.next_id == 2
    _, second = run(pipeline(map=first.map), frames())
    found = {row.label: row for row in second.map.landmarks}
    assert {label: row.id for label, row in found.items()} == {"cup": 0, "book": 2}
    assert found["cup"].observations == first.map.landmarks[0].observations + 4
    assert second.map.next_id == 3
    trace = np.trace(found["cup"].covariance_m2)
    assert trace <= np.trace(first.map.landmarks[0].covariance_m2) * 1.01


def test_a_map_loaded_from_json_alone_can_be_continued(tmp_path):
    _, first = run(pipeline(), frames())
    first.map.save(tmp_path)
    _, second = run(pipeline(map=Map.load(tmp_path)), frames())
    assert [row.id for row in second.map.landmarks] == [0, 1]
    assert [row.observations for row in second.map.landmarks] == [8, 8]


def test_what_was_lost_and_how_likely_it_is_there_goes_on_in_a_map_that_is_continued(tmp_path):
    _, first = run(pipeline(), frames())
    away = replace(first.map.landmarks[1], id=7, position_m=np.array([50.0, 50.0, 1.0]), state="lost", existence=0.25)  # never in view
    Map([*first.map.landmarks, away], "poses", first.map.embedder).save(tmp_path)
    with SqliteStore(tmp_path / "map.db") as store:
        _, second = run(pipeline(map=Map.load(tmp_path / "map.json"), store=store), frames())
    for result in (second.map, Map.load(tmp_path / "map.db")):
        (lost,) = [row for row in result.tentative if row.id == 7]
        assert (lost.state, lost.existence) == ("lost", 0.25)
        assert [row.state for row in result.landmarks] == ["stable", "stable"]
        assert all(row.existence > 0.5 for row in result.landmarks)


def test_a_map_made_by_another_embedder_can_be_continued():
    _, first = run(pipeline(embedder=HashedEmbedder(size=64)), frames())
    _, second = run(pipeline(map=first.map), frames())
    assert [row.id for row in second.map.landmarks] == [0, 1]
    assert {row.embedding.shape for row in second.map.landmarks} == {(256,)}


def test_the_old_map_is_shown_until_the_first_frame_and_is_never_changed():
    _, first = run(pipeline(), frames())
    before = first.map.to_json()
    made = pipeline(map=first.map)
    assert made.snapshot().to_json() == before
    run(made, frames())
    assert first.map.to_json() == before


def test_a_second_run_into_a_store_numbers_its_keyframes_on(tmp_path):
    path = tmp_path / "map.db"
    for count in (4, 8):
        old = Map.load(path) if count == 8 else None
        _, result = run(pipeline(store=SqliteStore(path), map=old), frames())
        with SqliteStore(path, read_only=True) as store:
            assert store.keyframe_ids().tolist() == list(range(count))
    assert [row.id for row in result.map.landmarks] == [0, 1]
    assert [row.observations for row in result.map.landmarks] == [8, 8]


def test_an_interrupted_source_leaves_a_whole_result():
    def cut(given):
        yield from given[:5]
        raise KeyboardInterrupt

    made = pipeline()
    with pytest.raises(KeyboardInterrupt), made:
        for _ in made.stream(cut(frames())):
            pass
    result = made.result()
    assert (result.frames, len(result.trajectory), len(result.map.landmarks)) == (5, 5, 2)


# --- agents ----------------------------------------------------------------------------------------------------------------------


AS_PROPOSED = {"edits": {"rails": False}}


class Once(Agent):
    """Proposes edits at one keyframe, made by a function of the landmarks it sees."""

    def __init__(self, make, keyframe):
        self.make, self.keyframe, self.calls, self.views = make, keyframe, 0, []

    def propose(self, view):
        self.views.append(view)
        self.calls += 1
        if self.calls - 1 != self.keyframe:
            return []
        rows = [row_of(view.landmarks, k) for k in range(len(view.landmarks))]
        return self.make(rows)


def row_of(landmarks, k):
    class Row:
        id, version = int(landmarks.ids[k]), int(landmarks.versions[k])

    return Row


def test_an_agent_sees_stable_landmarks_with_versions_and_boxes():
    agent = Once(lambda rows: [], keyframe=99)
    run(pipeline(agents=[agent]), frames())
    assert [len(view.landmarks) for view in agent.views] == [0, 0, 2, 2]
    view = agent.views[-1]
    assert set(view.boxes_px) == set(view.landmarks.ids.tolist()) == {0, 1}
    assert set(view.landmarks.states) == {"stable"}
    assert view.frame.index == 6
    np.testing.assert_allclose(view.T_world_camera, tiny_trajectory(8)[6], atol=0.02)
    box = view.boxes_px[0]
    inside = view.frame.camera.project(np.array(inverse(view.T_world_camera) @ [*view.landmarks.p_world[0], 1.0])[:3])
    assert (box[:2] < inside).all()
    assert (inside < box[2:]).all()


def test_an_agent_is_given_no_box_of_what_is_out_of_the_image():
    agent = Once(lambda rows: [], keyframe=99)
    _, first = run(pipeline(), frames())
    beside = [
        replace(row, position_m=row.position_m + 5.0 * np.array(T_WORLD_FIRST)[:3, 0] * (row.label == "cup")) for row in first.map.landmarks
    ]
    run(pipeline(map=Map(beside, first.map.gravity, "hashed"), agents=[agent]), frames())
    view = agent.views[0]
    assert {0, 1} <= set(view.landmarks.ids.tolist())
    assert set(view.boxes_px) == {row.id for row in beside if row.label == "book"}


def test_relabel_remove_and_confirm_are_applied():
    def edits(rows):
        return [Relabel(0, rows[0].version, "teapot", "me"), Remove(1, rows[1].version, "me")]

    agents = [Once(edits, keyframe=2), Once(lambda rows: [Confirm(0, rows[0].version)], keyframe=3)]
    steps, result = run(pipeline(config=AS_PROPOSED, agents=agents), frames())
    kinds = [(event.kind, event.landmark_id, event.source) for event in steps[4].events]
    assert ("relabelled", 0, "me") in kinds
    assert ("removed", 1, "me") in kinds
    unsigned = [(event.kind, event.landmark_id, event.source) for event in steps[6].events]
    assert ("confirmed", 0, "Once") in unsigned  # an edit that names nobody bears the agent's name
    found = {row.id: row.label for row in (*result.map.landmarks, *result.map.tentative)}
    assert found == {0: "teapot", 2: "book"}  # what was removed is seen again under a new id
    assert result.warnings == {}


def test_merge_by_an_agent():
    class Doubled(BlockDetector):
        """Calls the cup's halves two things."""

        def detect(self, frame):
            found = super().detect(frame)
            left, right = found.boxes_px[0].copy(), found.boxes_px[0].copy()
            left[2] = right[0] = 0.5 * (left[0] + left[2])
            return Detections(np.array([left, right]), ("cup", "cup"), np.array([0.9, 0.8]))

    def merge(rows):
        return [Merge(rows[0].id, rows[0].version, rows[1].id, rows[1].version)]

    steps, result = run(pipeline(config=AS_PROPOSED, detector=Doubled(tiny_trajectory(8)), agents=[Once(merge, keyframe=2)]), frames())
    assert [step.landmark_ids.tolist() for step in steps[:3:2]] == [[0, 1], [0, 1]]
    merged = [event for event in steps[4].events if event.kind == "merged"]
    assert [(event.landmark_id, event.other_id) for event in merged] == [(1, 0)]
    assert 1 not in {row.id for row in (*result.map.landmarks, *result.map.tentative)}


def test_what_agents_changed_is_in_the_store(tmp_path):
    def edits(rows):
        return [Relabel(0, rows[0].version, "teapot", "me"), Remove(1, rows[1].version, "me")]

    with SqliteStore(tmp_path / "map.db") as store:
        run(pipeline(config=AS_PROPOSED, store=store, agents=[Once(edits, keyframe=3)]), frames())
    with SqliteStore(tmp_path / "map.db", read_only=True) as store:
        assert {row.id: row.label for row in store.landmarks()} == {0: "teapot"}
        assert [kind for _, kind, _, source in store.history(1) if source == "me"] == ["removed"]


@pytest.mark.parametrize(
    "edit",
    [Relabel(0, 99, "teapot"), Remove(55, 0), Merge(0, 1, 1, 1), Relabel(0, 1, " "), Confirm(0, 99)],
    ids=lambda edit: type(edit).__name__,
)
def test_an_edit_that_does_not_hold_is_a_warning(edit):
    steps, result = run(pipeline(agents=[Once(lambda rows: [edit], keyframe=2)]), frames())
    assert len(steps[4].warnings) == 1
    assert re.match("agent Once: (edit refused: |proposed edits of what it was not shown)", steps[4].warnings[0])
    assert {row.label for row in result.map.landmarks} == {"cup", "book"}


def test_an_edit_of_a_landmark_that_changed_meanwhile_is_stale():
    def edits(rows):
        a, b = rows
        return [Merge(a.id, a.version, b.id, b.version), Relabel(a.id, a.version, "teapot"), Remove(b.id, b.version)]

    steps, _ = run(pipeline(config=AS_PROPOSED, agents=[Once(edits, keyframe=2)]), frames())
    assert [(edit.kind, edit.outcome) for edit in steps[4].edits] == [("merge", "applied"), ("relabel", "stale"), ("remove", "stale")]
    assert "version" in steps[4].edits[1].detail
    assert steps[4].warnings == ()  # the world moves on while agents think


def test_a_name_given_by_an_agent_makes_its_other_edits_not_stale():
    def edits(rows):
        return [Relabel(0, rows[0].version, "teapot"), Confirm(0, rows[0].version)]

    steps, result = run(pipeline(agents=[Once(edits, keyframe=2)]), frames())
    assert [edit.outcome for edit in steps[4].edits] == ["applied", "applied"]
    assert {row.label for row in result.map.landmarks} == {"teapot", "book"}


def test_an_agent_that_cannot_answer_is_a_warning_and_the_others_are_asked():
    class Mute(Agent):
        name = "mute"

        def propose(self, view):
            raise AgentError("no reply within 2 s")

    asked = Once(lambda rows: [], keyframe=99)
    steps, result = run(pipeline(agents=[Mute(), asked]), frames())
    assert steps[0].warnings == ("agent mute: no reply within 2 s",)
    assert asked.calls == 4
    assert len(result.map.landmarks) == 2


# --- composition -----------------------------------------------------------------------------------------------------------------


class CountingAssociator(NearestAssociator):
    """For "module:Class"."""


def test_parts_are_objects_names_or_module_and_class():
    mine = MemoryStore()
    made = Pipeline(
        detector="none",
        odometry=recorded(8),
        associator=f"{__name__}:CountingAssociator",
        smoother=Component(name="gtsam"),
        embedder="hashed",
        store=mine,
    )
    assert isinstance(made.parts.detector, NoDetector)
    assert type(made.parts.associator).__name__ == "CountingAssociator"
    assert isinstance(made.parts.smoother, GtsamSmoother)
    assert made.parts.store is mine
    steps, _ = run(made, frames())
    assert len(steps) == 8


def test_presets():
    parts = {"odometry": recorded(8), "embedder": "hashed"}
    assert isinstance(Pipeline.from_preset("seo_slam", **parts).parts.associator, TwoStageAssociator)
    assert isinstance(Pipeline.from_preset("nearest", **parts).parts.associator, NearestAssociator)
    assert Pipeline.from_preset("seo_slam_paper_gate", **parts).config.association.semantic_gate == "cosine"
    with pytest.raises(ConfigError, match="seo_slam_paper_gate"):
        Pipeline.from_preset("seoslam", **parts)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("mine.toml", 'associator.name = "nearest"\nembedder.name = "hashed"\n[keyframes]\nperiod_s = 0.25\n'),
        ("mine.yaml", "associator: {name: nearest}\nembedder: {name: hashed}\nkeyframes: {period_s: 0.25}\n"),
    ],
)
def test_composed_from_a_file(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    made = Pipeline.from_file(tmp_path / name, odometry=recorded(8))
    assert isinstance(made.parts.associator, NearestAssociator)
    assert made.config.keyframes.period_s == 0.25


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"detector": object()}, "detector: object has no detect"),
        ({"odometry": object()}, "odometry: object has no update"),
        ({"associator": object()}, "associator: object has no associate"),
        ({"store": object()}, "store: object has no commit, no keyframe, no amend, no edits, no keyframe_ids"),
        ({"embedder": object()}, "embedder: object has no embed_text, no name"),
        ({"smoother": object()}, "smoother: object has no start, no predict"),
        ({"agents": [object()]}, "agent: object has no propose"),
        ({"detector": Config}, "detector: Config has no detect"),
    ],
)
def test_an_object_that_is_no_such_part_is_an_error_that_names_what_it_lacks(parts, words):
    with pytest.raises(ConfigError, match=words):
        Pipeline({"embedder": {"name": "hashed"}}, **{"odometry": recorded(8), **parts})


def test_a_map_to_continue_must_be_a_map():
    with pytest.raises(ConfigError, match=r"map: got 'old_run', wanted a Map, as Map.load\(folder\) gives"):
        pipeline(map="old_run")


def test_a_class_is_made_with_what_its_constructor_takes():
    made = Pipeline({"association": {"gate_probability": 0.9}}, associator=NearestAssociator, detector=NoDetector, odometry=recorded(8))
    assert isinstance(made.parts.detector, NoDetector)
    assert made.parts.associator._settings.gate_probability == 0.9


@pytest.mark.parametrize(
    ("parts", "error", "words"),
    [
        ({"detector": "yolo"}, UnknownBackendError, "did you mean 'yolox'"),
        ({"detector": "seo_slam.nowhere:Thing"}, UnknownBackendError, "no module"),
        ({"associator": Component(name="two_stage", options={"solvr": "lap"})}, ConfigError, "did you mean 'solver'"),
        ({"odometry": "recorded"}, ConfigError, "trajectory"),
    ],
)
def test_names_that_cannot_be_made_into_parts(parts, error, words):
    with pytest.raises(error, match=words):
        Pipeline({"embedder": {"name": "hashed"}}, **{"odometry": recorded(8), **parts})
    assert issubclass(MissingBackendError, ImportError)


def test_a_misspelt_setting_names_the_nearest_one():
    with pytest.raises(ConfigError, match=r"keyframes\.period.*did you mean 'period_s'"):
        Pipeline({"keyframes": {"period": 1}})
    with pytest.raises(ConfigError):
        Pipeline("seo_slam")


def test_settings_reach_the_parts():
    lap = Pipeline(Config.from_dict({"association": {"solver": "lap"}, "embedder": {"name": "hashed"}}), odometry=recorded(8))
    _, result = run(pipeline(config={"association": {"solver": "lap"}, "map": {"stable_observations": 5, "stable_seconds": 0.0}}), frames())
    assert lap.config.association.solver == "lap"
    assert len(result.map.landmarks) == 0
    assert len(result.map.tentative) == 2


def test_odometry_noise_accumulates_over_the_frames_between_keyframes():
    """Covariances of composed motions: ten steps between keyframes are about ten times as uncertain as one."""
    motions = []

    class Listening(GtsamSmoother):
        def update(self, motion, *rest, **more):
            motions.append(motion)
            return super().update(motion, *rest, **more)

    slow = {"keyframes": {"distance_m": 9, "angle_deg": 90, "period_s": 0.5}}
    run(pipeline(12, slow, smoother=Listening(), detector=NoDetector()), frames(12))
    assert motions[0] is None
    one = recorded(12)
    for frame in tiny_frames(2):
        step = one.update(frame)
    assert isinstance(step, Motion)
    assert np.trace(motions[1].covariance[:3, :3]) == pytest.approx(5 * np.trace(step.covariance[:3, :3]), rel=0.1)
    np.testing.assert_allclose(motions[1].T_previous_current, exp(5 * np.array([0.01, 0.015, 0.005, 0.04, -0.01, 0.02])), atol=2e-3)


def test_the_package_says_what_it_needs_when_a_recording_breaks_off():
    """An error of the source comes through as it is, and the map up to there is whole."""

    def broken(given):
        yield from given[:5]
        raise DatasetError("frame 5 (t=0.5): depth/5.png: the depth image does not decode")

    made = pipeline()
    with pytest.raises(DatasetError, match="frame 5"), made:
        list(made.stream(broken(frames())))
    assert json.loads(made.result().map.to_json())["schema"] == "seo_slam.map/1"
    assert len(made.result().map.landmarks) == 2
