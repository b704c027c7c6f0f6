"""``seo-slam run`` on a real recording, and what it says to bad input, before a byte is written."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from typer.testing import CliRunner

from seo_slam.cli import app as application
from seo_slam.datasets.trajectory_files import read_trajectory
from seo_slam.map import Map

RESULT = {"map.json", "map.db", "trajectory.txt", "run.json", "report.html"}
QUICK = ["--set", "embedder.name=hashed"]


class Ran:
    """Exit status and output of the command as a user sees them."""

    def __init__(self, status, out, err):
        self.status, self.out, self.err = status, out, err


def seo_slam(*arguments):
    """Run in this process, through ``main``: errors become one line and exit status 2."""
    result = CliRunner().invoke(application.app, [str(a) for a in arguments])
    error = result.exception
    if error is None or isinstance(error, SystemExit):
        return Ran(result.exit_code, result.stdout, result.stderr)
    from seo_slam.errors import SeoSlamError

    assert isinstance(error, SeoSlamError), f"not an error of ours: {error!r}"
    return Ran(2, result.stdout, result.stderr + f"error: {error}\n")


@pytest.fixture
def recording(shared):
    return shared / "data/tum_fr1_xyz"


@pytest.fixture(scope="session")
def tiny_recording(shared, tmp_path_factory):
    """Twelve frames of the real recording, to be broken in copies."""
    source, folder = shared / "data/tum_fr1_xyz", tmp_path_factory.mktemp("recording") / "tum_fr1_tiny"
    folder.mkdir()
    for name in ("rgb", "depth"):
        lines = [line for line in (source / f"{name}.txt").read_text().splitlines() if not line.startswith("#")][:12]
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
        (folder / name).mkdir()
        for line in lines:
            file = line.split()[1]
            shutil.copyfile(source / file, folder / file)
    (folder / "groundtruth.txt").write_text("\n".join((source / "groundtruth.txt").read_text().splitlines()[:300]) + "\n")
    return folder


@pytest.fixture
def broken(tiny_recording, tmp_path):
    """A copy to be broken."""
    return shutil.copytree(tiny_recording, tmp_path / "tum_fr1_tiny")


@pytest.fixture(scope="session")
def finished(shared, detections_file, tmp_path_factory):
    """A short run, done once: folder and output."""
    out = tmp_path_factory.mktemp("run") / "new" / "out"
    arguments = ["run", "tum", shared / "data/tum_fr1_xyz", "--detector", "recorded", "--detections", detections_file]
    return out, seo_slam(*arguments, *QUICK, "--max-frames", 60, "--out", out, "--print-keyframes")


def test_it_writes_a_result(finished):
    out, ran = finished
    assert ran.status == 0
    assert {file.name for file in out.iterdir()} == RESULT
    run = json.loads((out / "run.json").read_text())
    assert run["complete"] is True
    assert run["counts"]["frames"] == 60
    assert run["counts"]["keyframes"] >= 10
    assert run["config"]["detector"]["name"] == "recorded"
    assert run["config"]["seed"] == 0
    assert run["versions"]["gtsam"].startswith("4.3")
    assert run["peak_memory_mb"] > 50
    for stage in ("read", "odometry", "detect", "observe", "associate", "smooth", "map", "store", "report"):
        seconds = run["seconds_per_stage"][stage]
        assert 0 <= seconds["p50"] <= seconds["p95"] <= seconds["max"] <= seconds["total"]
    assert run["counts"]["landmarks_stable"] == len(Map.load(out).landmarks) > 3
    assert len(read_trajectory(out / "trajectory.txt")) == 60


def test_it_tells_keyframes_and_things(finished):
    out, ran = finished
    lines = ran.out.splitlines()
    keyframes = json.loads((out / "run.json").read_text())["counts"]["keyframes"]
    assert lines[:keyframes] == [f"keyframe {k}" for k in range(keyframes)]
    assert lines[keyframes].startswith("60 frames, ")
    assert sum(" book " in line for line in lines) == 2
    assert lines[-1] == f"report: {out / 'report.html'}"
    assert str(out) in ran.out


def test_json_is_what_run_json_holds(recording, detections_file, tmp_path):
    ran = seo_slam(
        "run", "auto", recording, "--detector", "recorded", "--detections", detections_file, *QUICK, "--max-frames", 8, "--stride", 2,
        "--out", tmp_path / "out", "--json",
    )  # fmt: skip
    assert ran.status == 0
    content = json.loads(ran.out)
    assert content == json.loads((tmp_path / "out" / "run.json").read_text())
    assert content["counts"]["frames"] == 8
    stamps = read_trajectory(tmp_path / "out" / "trajectory.txt").timestamps_s
    assert np.median(np.diff(stamps)) > 0.12  # every second one of 15 a second


def test_recorded_and_replayed_runs_give_the_same_map(shared, recording, tmp_path):
    """Done when 4: the real detector, its detections written; read back, the two maps are identical byte by byte."""
    weights, file = shared / "models/yolox_nano/yolox_nano.onnx", tmp_path / "F.jsonl"
    common = ["run", "tum", recording, "--max-frames", 60, "--score", 0.35]
    first = seo_slam(*common, "--detector", "yolox", "--weights", weights, "--record-detections", file, "--out", tmp_path / "A")
    second = seo_slam(*common, "--detector", "recorded", "--detections", file, "--out", tmp_path / "B")
    assert (first.status, second.status) == (0, 0)
    assert (tmp_path / "A/map.json").read_bytes() == (tmp_path / "B/map.json").read_bytes()
    assert (tmp_path / "A/trajectory.txt").read_bytes() == (tmp_path / "B/trajectory.txt").read_bytes()
    assert len(Map.load(tmp_path / "A")) >= 4
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    assert len(lines) == json.loads((tmp_path / "A/run.json").read_text())["counts"]["keyframes"]
    assert set(lines[0]) == {"timestamp_s", "boxes_px", "labels", "scores"}


def test_a_map_is_continued_from_the_command_line(finished, recording, detections_file, tmp_path):
    out, _ = finished
    common = ["run", "tum", recording, "--detector", "recorded", "--detections", detections_file, *QUICK, "--max-frames", 10]
    ran = seo_slam(*common, "--continue", out, "--out", tmp_path / "more")
    assert ran.status == 0
    before, after = Map.load(out), Map.load(tmp_path / "more")
    assert {row.id for row in before.landmarks} <= {row.id for row in after.landmarks} | {row.id for row in after.tentative}
    assert after.next_id >= before.next_id
    refused = seo_slam(*common, "--continue", out, "--odometry", "visual", "--out", tmp_path / "no")
    assert refused.status == 2
    assert "--initial-pose" in refused.err
    assert not (tmp_path / "no").exists()


def test_a_result_is_replaced_only_when_told(finished, recording, tmp_path):
    out = shutil.copytree(finished[0], tmp_path / "out")
    (out / "mine.txt").write_text("keep me")
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    short = ["run", "tum", recording, *QUICK, "--max-frames", 3, "--out", out]
    refused = seo_slam(*short)
    assert refused.status == 2
    assert "already holds a result" in refused.err
    assert "--overwrite" in refused.err
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before
    replaced = seo_slam(*short, "--overwrite")
    assert replaced.status == 0
    assert json.loads((out / "run.json").read_text())["counts"]["frames"] == 3
    assert (out / "mine.txt").read_text() == "keep me"
    assert len(Map.load(out)) == 0


# --- bad input: exit status 2, one clear line, nothing written --------------------------------------------------------------------


def refused(words, *arguments, out):
    before = sorted(out.parent.rglob("*"))
    ran = seo_slam("run", *arguments, "--out", out)
    assert ran.status == 2, ran.out
    errors = [line for line in ran.err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1, ran.err
    for word in words:
        assert word in errors[0], errors[0]
    assert "Traceback" not in ran.err
    assert sorted(out.parent.rglob("*")) == before


def edit(file, number, change):
    lines = file.read_text().splitlines()
    lines[number - 1] = change(lines[number - 1])
    file.write_text("\n".join(lines) + "\n")


def write_image(file, array):
    import cv2

    assert cv2.imwrite(str(file), array)


def depth_file(folder, k=4):
    return folder / (folder / "depth.txt").read_text().splitlines()[k].split()[1]


def no_folder(folder):
    shutil.rmtree(folder)
    return ["no such folder", str(folder)]


def no_associations(folder):
    lines = (folder / "depth.txt").read_text().splitlines()
    (folder / "depth.txt").write_text("\n".join(f"{float(line.split()[0]) + 500} {line.split()[1]}" for line in lines))
    return ["within 20 ms"]


def unequal_sizes(folder):
    write_image(depth_file(folder), np.ones((240, 320), np.uint16))
    return [depth_file(folder).name, "320x240", "640x480", "frame "]


def eight_bit_depth(folder):
    write_image(depth_file(folder), np.ones((480, 640), np.uint8))
    return [depth_file(folder).name, "8-bit", "16-bit"]


def unreadable_depth(folder):
    depth_file(folder).write_bytes(b"not an image at all, but long enough for a header")
    return [depth_file(folder).name]


def cut_off_depth(folder):
    file = depth_file(folder)
    file.write_bytes(file.read_bytes()[:5000])
    return [file.name, "cut off"]


def nan_pose(folder):
    edit(folder / "groundtruth.txt", 30, lambda line: line.replace(line.split()[1], "nan"))
    return ["groundtruth.txt:30"]


def no_rotation(folder):
    edit(folder / "groundtruth.txt", 40, lambda line: " ".join([*line.split()[:4], "0", "0", "0", "0"]))
    return ["groundtruth.txt:40", "quaternion"]


def time_backwards(folder):
    edit(folder / "groundtruth.txt", 50, lambda line: " ".join(["1305031000.0", *line.split()[1:]]))
    return ["groundtruth.txt:50", "back"]


def pose_line_cut_off(folder):
    edit(folder / "groundtruth.txt", 60, lambda line: " ".join(line.split()[:5]))
    return ["groundtruth.txt:60"]


@pytest.mark.parametrize(
    "damage",
    [
        no_folder,
        no_associations,
        unequal_sizes,
        eight_bit_depth,
        unreadable_depth,
        cut_off_depth,
        nan_pose,
        no_rotation,
        time_backwards,
        pose_line_cut_off,
    ],
    ids=lambda damage: damage.__name__,
)
def test_a_bad_recording_is_refused(broken, tmp_path, damage):
    words = damage(broken)
    (tmp_path / "results").mkdir()
    refused(words, "tum", broken, *QUICK, out=tmp_path / "results" / "out")


@pytest.mark.parametrize(
    ("boxes", "words"),
    [
        ([[700.0, 10, 800, 50]], ["file.jsonl:2", "outside the 640x480 image"]),
        ([[float("nan"), 10, 100, 50]], ["file.jsonl:2", "NaN"]),
        ([[100.0, 10, 50, 50]], ["file.jsonl:2", "x0 < x1"]),
        ([[100.0, 10, 150]], ["file.jsonl:2", "four finite numbers"]),
    ],
)
def test_bad_detections_are_refused(tiny_recording, tmp_path, boxes, words):
    good = {"timestamp_s": 1.0, "boxes_px": [[1.0, 1.0, 9.0, 9.0]], "labels": ["cup"], "scores": [0.5]}
    lines = [good, {**good, "timestamp_s": 2.0, "boxes_px": boxes}]
    (tmp_path / "file.jsonl").write_text("\n".join(json.dumps(line) for line in lines))
    refused(words, "tum", tiny_recording, "--detector", "recorded", "--detections", tmp_path / "file.jsonl", *QUICK, out=tmp_path / "out")


def test_detections_cut_off_in_a_line_are_refused(tiny_recording, detections_file, tmp_path):
    text = detections_file.read_text()
    (tmp_path / "file.jsonl").write_text(text[: len(text) // 2])
    number = text[: len(text) // 2].count("\n") + 1
    words = [f"file.jsonl:{number}", "not JSON"]
    refused(words, "tum", tiny_recording, "--detector", "recorded", "--detections", tmp_path / "file.jsonl", *QUICK, out=tmp_path / "out")


BAD_COMMANDS = {
    "weights that are no model": (["--detector", "yolox", "--weights", "{folder}/rgb.txt"], ["rgb.txt"]),
    "weights that are not there": (["--detector", "yolox", "--weights", "{folder}/no.onnx"], ["no.onnx"]),
    "yolox without weights": (["--detector", "yolox"], ["--weights"]),
    "recorded without a file": (["--detector", "recorded"], ["--detections"]),
    "detections for another detector": (["--detections", "{folder}/rgb.txt"], ["--detector recorded"]),
    "no such detections": (["--detector", "recorded", "--detections", "{folder}/no.jsonl"], ["no.jsonl"]),
    "unknown detector": (["--detector", "yolo"], ["'yolo'", "did you mean 'yolox'", "recorded"]),
    "unknown odometry": (["--odometry", "visul"], ["did you mean 'visual'"]),
    "unknown preset": (["--preset", "seoslam"], ["seoslam", "seo_slam_paper_gate"]),
    "misspelt key": (["--set", "keyframes.perid_s=1"], ["keyframes.perid_s", "did you mean 'period_s'"]),
    "bad value": (["--set", "keyframes.period_s=-1"], ["keyframes.period_s", "greater than 0"]),
    "setting without a value": (["--set", "keyframes.period_s"], ["wanted key=value"]),
    "no such config": (["--config", "{folder}/no.toml"], ["no.toml", "no such config file"]),
    "config of another kind": (["--config", "{folder}/rgb.txt"], ["rgb.txt", ".toml"]),
    "no such trajectory": (["--trajectory", "{folder}/no.txt"], ["no.txt"]),
    "no such camera": (["--camera", "{folder}/no.json"], ["no.json"]),
    "no such map": (["--continue", "{folder}/no"], ["no"]),
    "initial pose of recorded odometry": (["--initial-pose", "0 0 0 0 0 0 1"], ["--odometry visual"]),
    "initial pose that is none": (["--odometry", "visual", "--initial-pose", "1 2 3"], ["got 3 numbers"]),
    "detections into no folder": (["--record-detections", "{folder}/no/F.jsonl"], ["--record-detections", "No such file"]),
    "detections into a folder": (["--record-detections", "{folder}/rgb"], ["--record-detections", "directory"]),
    "detections into a file that holds some": (
        ["--record-detections", "{folder}/rgb.txt"],
        ["--record-detections", "already holds"],
    ),
}


@pytest.mark.parametrize("case", BAD_COMMANDS)
def test_a_bad_command_is_refused(tiny_recording, tmp_path, case):
    arguments, words = BAD_COMMANDS[case]
    inputs = sorted(tiny_recording.rglob("*"))
    refused(words, "tum", tiny_recording, *QUICK, *(a.format(folder=tiny_recording) for a in arguments), out=tmp_path / "out")
    assert sorted(tiny_recording.rglob("*")) == inputs


def test_unknown_kinds_of_recording_are_refused(tiny_recording, tmp_path):
    refused(["'tom'", "did you mean 'tum'"], "tom", tiny_recording, out=tmp_path / "out")
    refused(["rgb.txt"], "auto", tmp_path, out=tmp_path / "out")


def test_no_poses_and_no_odometry_named_means_visual(broken, tmp_path):
    (broken / "groundtruth.txt").unlink()
    refused(["--trajectory", "groundtruth.txt"], "tum", broken, *QUICK, "--odometry", "recorded", out=tmp_path / "out")
    ran = seo_slam("run", "tum", broken, *QUICK, "--max-frames", 4, "--out", tmp_path / "out", "--json")
    assert ran.status == 0
    assert json.loads(ran.out)["config"]["odometry"]["name"] == "visual"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("map.json", b'{"schema": "seo_slam.map/99", "landmarks": []}', ["map.json", "seo_slam.map/99"]),
        ("map.json", None, ["map.json"]),
        ("map.db", b"SQLite format 3\x00 and then nothing of the kind", ["map.db"]),
    ],
)
def test_a_map_of_another_schema_or_cut_off_is_refused(finished, tiny_recording, tmp_path, name, content, words):
    old = tmp_path / "old"
    old.mkdir()
    whole = (finished[0] / name).read_bytes()
    (old / name).write_bytes(whole[: len(whole) // 2] if content is None else content)
    (tmp_path / "results").mkdir()
    refused(words, "tum", tiny_recording, *QUICK, "--continue", old, out=tmp_path / "results" / "out")


def test_an_output_folder_that_cannot_be_written_is_refused(tiny_recording, tmp_path):
    (tmp_path / "file").write_text("in the way")
    refused([str(tmp_path / "file"), "is a file"], "tum", tiny_recording, *QUICK, out=tmp_path / "file")
    refused([str(tmp_path / "file" / "out")], "tum", tiny_recording, *QUICK, out=tmp_path / "file" / "out")
    refused(["cannot be written"], "tum", tiny_recording, *QUICK, out=tmp_path / ("x" * 300))
    ran = seo_slam("run", "tum", tiny_recording, *QUICK, "--out", "/proc/seo_slam_out")
    assert ran.status == 2
    assert "error: /proc/seo_slam_out: cannot be written" in ran.err


@pytest.mark.parametrize("arguments", [["--max-frames", "0"], ["--stride", "0"], ["--score", "1.5"], ["--scor", "0.5"]])
def test_what_the_parser_refuses_has_status_2_too(tiny_recording, tmp_path, arguments):
    ran = seo_slam("run", "tum", tiny_recording, "--out", tmp_path / "out", *arguments)
    assert ran.status == 2
    assert arguments[0] in ran.err
    assert not (tmp_path / "out").exists()


# --- as a process ----------------------------------------------------------------------------------------------------------------


def process(*arguments):
    command = [sys.executable, "-c", "from seo_slam.cli.app import main; main()", *(str(a) for a in arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_an_error_is_one_line_and_status_2(tmp_path):
    with process("run", "tum", tmp_path / "nothing", "--out", tmp_path / "out") as running:
        out, err = running.communicate(timeout=60)
    assert running.returncode == 2
    assert out == ""
    assert err == f"error: {tmp_path / 'nothing'}: no such folder\n"


def test_ctrl_c_leaves_a_valid_result_of_what_was_seen(recording, detections_file, tmp_path):
    out = tmp_path / "out"
    arguments = ["run", "tum", recording, "--detector", "recorded", "--detections", detections_file, *QUICK, "--print-keyframes"]
    with process(*arguments, "--out", out) as running:
        told = [running.stdout.readline() for _ in range(5)]
        time.sleep(0.05)
        os.kill(running.pid, signal.SIGINT)
        rest, err = running.communicate(timeout=60)
    assert told[-1] == "keyframe 4\n"
    assert running.returncode == 0, err
    assert err == ""
    assert "interrupted: the result holds what was seen until then" in rest
    assert {file.name for file in out.iterdir()} == RESULT
    run = json.loads((out / "run.json").read_text())
    assert run["complete"] is False
    assert 5 <= run["counts"]["keyframes"] < 60
    assert len(read_trajectory(out / "trajectory.txt")) == run["counts"]["frames"]
    assert len(Map.load(out).landmarks) == run["counts"]["landmarks_stable"]
