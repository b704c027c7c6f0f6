"""Poses that drift, taken as true, are warned of once."""

import json

import pytest
from typer.testing import CliRunner

from seo_slam import SimulatedDesk
from seo_slam.cli import app as application
from seo_slam.cli.believed_poses import believed_poses
from seo_slam.config import Component, Config
from seo_slam.datasets.open import open_dataset

GIVEN = ["--set", "smoother.name=given_poses"]


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    SimulatedDesk(frames=6).write(folder)
    return folder


def ran(desk, out, *arguments):
    fixed = ["run", "tum", desk, "--out", out, "--detector", "recorded", "--set", "embedder.name=hashed"]
    result = CliRunner().invoke(application.app, [str(a) for a in (*fixed, *arguments)])
    assert result.exit_code == 0, (result.stderr, result.exception)
    said = [line for line in (result.stderr + result.stdout).splitlines() if "given_poses" in line]
    kept = [row for row in json.loads((out / "run.json").read_text())["warnings"] if "given_poses" in row["message"]]
    return said, kept


def test_a_drifting_file_is_warned_of_once_and_the_result_keeps_it(desk, tmp_path):
    said, kept = ran(desk, tmp_path / "a", *GIVEN)
    assert len(said) == len(kept) == 1
    assert "odometry.txt" in said[0]
    assert "--preset dualmap_estimated_poses" in said[0]
    assert f"--trajectory {desk / 'groundtruth.txt'}" in said[0]
    assert kept[0]["count"] == 1


def test_true_poses_and_estimated_ones_are_not(desk, tmp_path):
    assert ran(desk, tmp_path / "a", *GIVEN, "--trajectory", desk / "groundtruth.txt") == ([], [])
    assert ran(desk, tmp_path / "b") == ([], [])


def test_where_the_poses_come_from(desk):
    recording = open_dataset("tum", desk)

    def warned(odometry, trajectory=None, preset="dualmap", options=None):
        config = Config.preset(preset).model_copy(update={"odometry": Component(name=odometry, options=options or {})})
        return believed_poses(config, recording, trajectory)

    assert "visual odometry" in warned("visual")[0]
    assert "odometry.txt" in warned("recorded")[0]
    assert "odometry.txt" in warned("recorded", trajectory=desk / "odometry.txt")[0]
    assert warned("recorded", options={"trajectory": str(desk / "groundtruth.txt")}) == ()
    assert warned("recorded", trajectory=desk / "groundtruth.txt") == ()
    assert warned("recorded", trajectory=desk / "drifting.txt") == (), "it goes by the name alone"
    assert warned("theirs:Odometry") == ()
    assert warned("recorded", preset="dualmap_estimated_poses") == warned("visual", preset="seo_slam") == ()
