"""``seo-slam simulate``: a recording is written, checked, mapped and scored as the command says."""

import json
import shlex

import pytest
from typer.testing import CliRunner

from seo_slam.cli import app as application
from seo_slam.cli.app import main
from seo_slam.datasets.trajectory_files import read_trajectory
from seo_slam.errors import SeoSlamError

SMALL = ["--frames", "14", "--size", "160x120"]


def seo_slam(*arguments):
    """Exit status and what is printed, as a user sees it."""
    result = CliRunner().invoke(application.app, [str(a) for a in arguments])
    if isinstance(result.exception, SeoSlamError):
        return 2, f"error: {result.exception}"
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A small recording, written by the command, and what it printed."""
    folder = tmp_path_factory.mktemp("simulate") / "my desk"
    status, output = seo_slam("simulate", "DESK", "--seed", 1, "--level", 0, "--out", folder, *SMALL)
    assert status == 0, output
    return folder, output


def test_it_writes_a_recording_and_says_what_to_do_next(desk):
    folder, output = desk
    assert {"rgb", "depth", "rgb.txt", "depth.txt", "groundtruth.txt", "odometry.txt", "camera.json"} < {p.name for p in folder.iterdir()}
    assert len(list((folder / "rgb").iterdir())) == 14
    assert json.loads((folder / "simulation.json").read_text())["seed"] == 1
    assert "desk, seed 1, level 0: 14 frames of 160x120, 15 things at the end" in output


def test_the_next_commands_work_as_they_are_printed(desk, tmp_path):
    folder, output = desk
    commands = [line.split("seo-slam ", 1)[1] for line in output.splitlines() if "seo-slam " in line]
    assert [command.split()[0] for command in commands] == ["check", "run", "eval"]
    check, run, score = (shlex.split(command) for command in commands)
    assert seo_slam(*check)[0] == 0
    status, output = seo_slam(*run, "--set", "embedder.name=hashed")
    assert status == 0, output
    status, output = seo_slam(*score, "--json")
    assert status == 0, output
    assert json.loads(output)["f1"] > 0.6
    assert folder.with_name("my desk_map").is_dir()


def test_check_finds_it_sane(desk):
    status, output = seo_slam("check", desk[0], "--json")
    assert status == 0
    assert not [finding for finding in json.loads(output)["findings"] if finding["level"] == "error"]


def test_a_run_replays_the_drifting_odometry(tmp_path):
    folder = tmp_path / "desk"
    assert seo_slam("simulate", "desk", "--level", 1, "--out", folder, *SMALL)[0] == 0
    status, output = seo_slam("run", "tum", folder, "--detector", "none", "--out", tmp_path / "map", "--set", "embedder.name=hashed")
    assert status == 0, output
    estimate = read_trajectory(tmp_path / "map/trajectory.txt").T_world_camera[-1]
    odometry, truth = (read_trajectory(folder / name).T_world_camera[-1] for name in ("odometry.txt", "groundtruth.txt"))
    assert abs(estimate - odometry).max() < 1e-4 < abs(estimate - truth).max()


def test_detections_of_the_recording_are_not_overwritten(desk, tmp_path):
    before = (desk[0] / "detections.jsonl").read_bytes()
    file = desk[0] / "detections.jsonl"
    arguments = ["--detector", "recorded", "--record-detections", file, "--overwrite", "--out", tmp_path / "map"]
    status, output = seo_slam("run", "tum", desk[0], *arguments)
    assert status == 2
    assert "is the file that --detector recorded reads" in output
    assert file.read_bytes() == before


def test_a_room_from_the_command_line(tmp_path):
    status, output = seo_slam("simulate", "sm1", "--frames", 4, "--size", "64x48", "--no-changes", "--out", tmp_path / "room")
    assert status == 0, output
    assert "SM1, seed 0" in output
    assert json.loads((tmp_path / "room/truth.json").read_text())["timeline"] == []


BAD = {
    "unknown name": (["SM9"], ["'SM9'", "SM1", "apartment", "house"]),
    "level below 0": (["desk", "--level", "-1"], ["level", "-1"]),
    "no manifest": (["SM1", "--meshes", "{tmp}"], ["manifest.json"]),
    "no such mesh folder": (["SM1", "--meshes", "{tmp}/no"], ["no such folder"]),
    "house without meshes": (["house"], ["house", "mesh folder"]),
    "size in words": (["desk", "--size", "large"], ["--size", "'large'", "640x480"]),
    "size too small": (["desk", "--size", "8x8"], ["8x8"]),
    "one frame": (["desk", "--frames", "1"], ["frames"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_refused_and_nothing_written(tmp_path, case):
    arguments, words = BAD[case]
    status, output = seo_slam("simulate", *(a.format(tmp=tmp_path) for a in arguments), "--out", tmp_path / "out")
    assert status == 2
    for word in words:
        assert word in output
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_something_is_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    status, output = seo_slam("simulate", "desk", "--out", tmp_path, *SMALL)
    assert status == 2
    assert "wanted a new or empty folder" in output
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_an_error_is_one_line_and_status_2(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["seo-slam", "simulate", "SM9", "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
