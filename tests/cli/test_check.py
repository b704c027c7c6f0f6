import json

import pytest
from typer.testing import CliRunner

from seo_slam.cli.app import app


def check(*arguments):
    return CliRunner().invoke(app, ["check", *map(str, arguments)])


def test_a_sane_recording_exits_0(shared):
    result = check(shared / "data/tum_fr1_xyz")
    assert result.exit_code == 0, result.output
    assert result.output.splitlines()[0].endswith("tum recording")
    assert result.output.splitlines()[-1] == "sane"
    assert "397 pairs" in result.output


def test_warnings_exit_0_and_say_what_to_fix(shared):
    result = check(shared / "data/tum_fr1_desk_9frames")
    assert result.exit_code == 0
    assert "604 of the 613 images" in result.output
    assert "-> " in result.output
    assert result.output.splitlines()[-1] == "0 errors, 2 warnings"


def test_json_is_one_object(shared):
    result = check(shared / "data/tum_fr1_desk_9frames", "--json")
    report = json.loads(result.stdout)
    assert report["kind"] == "tum"
    assert report["facts"]["frames"] == 9
    assert {"level", "topic", "what", "fix"} == set(report["findings"][0])


@pytest.mark.parametrize("arguments", [[], ["--json"], ["--kind", "tum"]])
def test_errors_exit_1(tmp_path, arguments):
    (tmp_path / "notes.txt").write_text("hello")
    result = check(tmp_path, *arguments)
    assert result.exit_code == 1
    assert "notes.txt" in result.output
