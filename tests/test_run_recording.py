"""A run's folder: made before anything is computed, whole after every kind of end."""

import json
import os
import signal
import threading
import time

import pytest

from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.datasets.trajectory_files import read_trajectory
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.interfaces import Agent
from seo_slam.map import Map
from seo_slam.records import Confirm
from seo_slam.run_files import RESULT_FILES, prepare_folder, require_free
from seo_slam.run_recording import run_recording
from tiny_run import frames, pipeline

WRITTEN = ["map.db", "map.json", "report.html", "run.json", "trajectory.txt"]


def run(folder, given, **options):
    out = prepare_folder(folder, overwrite=False)
    return run_recording(given, pipeline(store=SqliteStore(out / "map.db")), out, dataset="tiny", **options)


def names(folder):
    return sorted(file.name for file in folder.iterdir())


def require_whole(folder, finished, count):
    assert names(folder) == WRITTEN
    content = json.loads((folder / "run.json").read_text())
    assert content == json.loads(json.dumps(finished.run))
    assert content["complete"] is finished.complete
    assert content["counts"]["frames"] == count == len(read_trajectory(folder / "trajectory.txt"))
    assert [row.id for row in Map.load(folder).landmarks] == [row.id for row in finished.result.map.landmarks]


def test_a_run_to_the_end(tmp_path):
    finished = run(tmp_path / "out", frames())
    require_whole(tmp_path / "out", finished, 8)
    assert finished.complete
    assert len(finished.result.map.landmarks) == 2


def test_on_step_is_called_once_a_frame_when_its_keyframe_is_kept(tmp_path):
    seen = []

    def look(step):
        if step.is_keyframe:
            with SqliteStore(tmp_path / "out" / "map.db", read_only=True) as store:
                assert store.keyframe_ids()[-1] == step.keyframe_id
        seen.append(step.index)

    run(tmp_path / "out", frames(), on_step=look)
    assert seen == list(range(8))


def test_no_frames_at_all_is_a_valid_result(tmp_path):
    finished = run(tmp_path / "out", [])
    assert finished.complete
    assert names(tmp_path / "out") == WRITTEN
    assert len(Map.load(tmp_path / "out")) == 0


def test_an_interrupt_from_the_source_leaves_what_was_seen(tmp_path):
    def cut():
        yield from frames()[:5]
        raise KeyboardInterrupt

    finished = run(tmp_path / "out", cut(), record_detections=tmp_path / "seen.jsonl")
    require_whole(tmp_path / "out", finished, 5)
    assert not finished.complete
    assert len((tmp_path / "seen.jsonl").read_text().splitlines()) == 3


class PressesCtrlC:
    """A stage that is interrupted in the middle."""

    def __init__(self, inner, name, at):
        self.inner, self.name, self.at, self.calls = inner, name, at, 0

    def __getattr__(self, name):
        value = getattr(self.inner, name)
        if name != self.name:
            return value

        def call(*arguments, **options):
            done = value(*arguments, **options)
            self.calls += 1
            if self.calls == self.at:
                os.kill(os.getpid(), signal.SIGINT)
            return done

        return call


@pytest.mark.parametrize("part", ["smoother.update", "store.commit", "detector.detect", "odometry.update"])
def test_ctrl_c_waits_for_the_frame_in_work(tmp_path, part):
    """Wherever in a frame it comes: graph, map and store hold the whole frame, and the result is written."""
    out = prepare_folder(tmp_path / "out", overwrite=False)
    made = pipeline(store=SqliteStore(out / "map.db"))
    kind, method = part.split(".")
    pressed = PressesCtrlC(getattr(made.parts, kind), method, at=5 if kind == "odometry" else 3)
    object.__setattr__(made.parts, kind, pressed)
    finished = run_recording(frames(), made, out, dataset="tiny")
    require_whole(out, finished, 5)  # the third keyframe is the fifth frame
    assert not finished.complete
    with SqliteStore(out / "map.db", read_only=True) as store:
        assert store.keyframe_ids().tolist() == [0, 1, 2]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


class AnswersWhenAsked(Agent):
    """Confirms everything, once it may."""

    def __init__(self):
        self.asked, self.may = threading.Event(), threading.Event()

    def propose(self, view):
        if len(view.landmarks):
            self.asked.set()
            self.may.wait(60.0)
        return [Confirm(int(i), int(version)) for i, version in zip(view.landmarks.ids, view.landmarks.versions, strict=True)]


def test_answers_in_hand_are_judged_and_written_after_ctrl_c(tmp_path):
    agent = AnswersWhenAsked()
    out = prepare_folder(tmp_path / "out", overwrite=False)
    made = pipeline(16, {"runner": {"mode": "background", "view_period_s": 0.0}}, agents=[agent], store=SqliteStore(out / "map.db"))

    def press(step):
        if agent.asked.is_set():
            agent.may.set()
            deadline = time.monotonic() + 60.0
            while not made.result().agents["agents"][0]["proposed"] and time.monotonic() < deadline:
                time.sleep(0.005)
            time.sleep(0.05)  # counted, and then handed over
            os.kill(os.getpid(), signal.SIGINT)

    finished = run_recording(frames(16), made, out, dataset="tiny", on_step=press)
    assert not finished.complete
    with SqliteStore(out / "map.db", read_only=True) as store:
        assert {edit.kind for edit in store.edits()} == {"confirm"}
    assert "confirm" in (out / "report.html").read_text()
    made.close()
    assert made.poll() == made.drain(600.0) == ()  # a closed pipeline waits for nothing, and asks nothing of its store


def test_a_handler_of_the_program_is_left_alone(tmp_path):
    heard = []
    before = signal.signal(signal.SIGINT, lambda number, where: heard.append(number))
    try:
        finished = run(tmp_path / "out", frames(), on_step=lambda step: step.index == 2 and os.kill(os.getpid(), signal.SIGINT))
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard == [signal.SIGINT]
    assert finished.complete


def test_it_runs_in_another_thread(tmp_path):
    done = []
    thread = threading.Thread(target=lambda: done.append(run(tmp_path / "out", frames())))
    thread.start()
    thread.join(timeout=60)
    assert done[0].complete


def test_an_error_of_the_source_comes_through_and_the_store_keeps_what_was_done(tmp_path):
    def broken():
        yield from frames()[:5]
        raise DatasetError("frame 5: damaged")

    with pytest.raises(DatasetError, match="frame 5"):
        run(tmp_path / "out", broken())
    assert {row.label for row in Map.load(tmp_path / "out").landmarks} == {"cup", "book"}
    assert json.loads((tmp_path / "out" / "run.json").read_text())["complete"] is False
    assert (tmp_path / "out" / "report.html").is_file()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


# --- the folder ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RESULT_FILES)
def test_any_file_of_a_result_is_a_result(tmp_path, name):
    (tmp_path / name).write_text("old")
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=f"already holds a result .{name}.*--overwrite"):
        prepare_folder(tmp_path, overwrite=False)
    assert (tmp_path / name).read_text() == "old"
    assert prepare_folder(tmp_path, overwrite=True) == tmp_path
    assert names(tmp_path) == ["notes.txt"]


def test_a_folder_with_other_things_is_taken(tmp_path):
    (tmp_path / "groundtruth.txt").write_text("mine")
    assert prepare_folder(str(tmp_path), overwrite=False) == tmp_path
    assert names(tmp_path) == ["groundtruth.txt"]
    assert prepare_folder(tmp_path / "a" / "b", overwrite=False).is_dir()


def test_a_class_list_is_no_result_and_stays(tmp_path):
    (tmp_path / "classes.txt").write_text("cup  # mine")
    assert prepare_folder(tmp_path, overwrite=False) == tmp_path
    (tmp_path / "map.json").write_text("old")
    assert prepare_folder(tmp_path, overwrite=True) == tmp_path
    assert names(tmp_path) == ["classes.txt"]
    assert (tmp_path / "classes.txt").read_text() == "cup  # mine"


def test_a_folder_is_looked_at_without_writing(tmp_path):
    require_free(tmp_path / "a" / "b", overwrite=False)
    assert names(tmp_path) == []
    (tmp_path / "map.json").write_text("old")
    require_free(tmp_path, overwrite=True)
    assert names(tmp_path) == ["map.json"]
    with pytest.raises(ConfigError, match="already holds a result"):
        require_free(tmp_path, overwrite=False)
    for wrong, words in ((tmp_path / "map.json", "is a file"), (tmp_path / "map.json" / "out", "cannot be written")):
        with pytest.raises(ConfigError, match=words):
            require_free(wrong, overwrite=True)


def test_folders_that_cannot_be(tmp_path):
    (tmp_path / "file").write_text("")
    for wrong, words in (
        (tmp_path / "file", "is a file"),
        (tmp_path / "file" / "out", "cannot be written"),
        ("/proc/out", "cannot be written"),
    ):
        with pytest.raises(ConfigError, match=words):
            prepare_folder(wrong, overwrite=True)
