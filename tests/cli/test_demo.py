"""The demo, short: it writes a result folder that the other commands read, and says what was found."""

import json

import pytest
from typer.testing import CliRunner

from seo_slam.cli.app import app
from seo_slam.cli.demo import _aligned
from seo_slam.errors import ConfigError

SHORT = ["--frames", "12", "--seed", "3"]


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo") / "out"
    result = CliRunner().invoke(app, ["demo", "--out", str(folder), *SHORT], catch_exceptions=False)
    return folder, result


def test_writes_a_result_folder(ran):
    folder, result = ran
    assert result.exit_code == 0
    for name in ("map.json", "map.db", "trajectory.txt", "run.json", "report.html", "evaluation.html", "truth.json", "groundtruth.txt"):
        assert (folder / name).stat().st_size > 0, name
    run = json.loads((folder / "run.json").read_text())
    assert run["counts"]["frames"] == 12
    assert run["config"]["seed"] == 3


def test_says_what_was_found_and_where_to_look(ran):
    folder, result = ran
    lines = result.stdout.splitlines()
    named = {line.split()[0] for line in lines[3:18]}
    assert {"monitor", "cup", "bottle", "book"} <= named
    assert any(line.startswith("precision ") for line in lines)
    assert str(folder / "report.html") in result.stdout
    assert sum(" cm" in line for line in lines[3:18]) >= 5  # most things in view are found, even in 12 frames


def test_columns_do_not_run_together(ran):
    assert _aligned([("on it", "found as", "at"), ("cup", "grey and white keyboard", "2.04"), ("monitor", "b", "")]) == [
        "on it    found as                 at",
        "cup      grey and white keyboard  2.04",
        "monitor  b",
    ]
    lines = ran[1].stdout.splitlines()
    column = next(line for line in lines if line.startswith("on the desk")).index("at x, y, z")
    placed = [line for line in lines if line.endswith(" cm")]
    assert all(line[column - 2 : column] == "  " and line[column] in "-0123456789" for line in placed)
    assert f"seo-slam ask {ran[0]} " in ran[1].stdout


def test_score_agrees_with_eval(ran):
    folder, result = ran
    scored = CliRunner().invoke(app, ["eval", "landmarks", str(folder), str(folder / "truth.json"), "--json"], catch_exceptions=False)
    printed = next(line for line in result.stdout.splitlines() if line.startswith("precision "))
    content = json.loads(scored.stdout)
    assert f"precision {content['precision']:.2f}, recall {content['recall']:.2f}, F1 {content['f1']:.2f}" in printed


def test_refuses_to_overwrite(ran):
    folder, _ = ran
    with pytest.raises(ConfigError, match="--overwrite"):
        CliRunner().invoke(app, ["demo", "--out", str(folder), *SHORT], catch_exceptions=False)
