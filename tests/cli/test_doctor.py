"""seo-slam doctor and the diagnosis behind it."""

import json
from importlib import metadata

import pytest
from typer.testing import CliRunner

from seo_slam import diagnosis
from seo_slam.cli.app import app


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(diagnosis, "_automatic_embedder", lambda: "some model")


def test_table():
    result = CliRunner().invoke(app, ["doctor"])
    assert result.exit_code == 0
    for text in (
        "gtsam",
        metadata.version("numpy"),
        "with R*Tree",
        "'auto' takes some model",
        "yolox",
        "minilm",
        "sim",
        "nav",
        "no problems",
    ):
        assert text in result.output


def test_json():
    content = json.loads(CliRunner().invoke(app, ["doctor", "--json"]).output)
    assert {entry["name"]: entry["version"] for entry in content["packages"]}["scipy"] == metadata.version("scipy")
    assert [entry["name"] for entry in content["extras"]] == ["yolox", "minilm", "sim", "nav"]
    assert content["problems"] == []
    assert "two_stage" in content["plug_ins"]["associator"]


def test_the_extras_are_those_of_the_package():
    announced = set(metadata.metadata("seo-slam").get_all("Provides-Extra"))
    assert set(diagnosis.EXTRAS) == announced - {"all", "dev"}


def test_what_is_missing_is_said(monkeypatch):
    def without(name):
        if name in ("onnxruntime", "embreex", "lap"):
            raise metadata.PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(metadata, "version", without)
    monkeypatch.setattr(diagnosis, "_has_rtree", lambda: False)
    found = diagnosis.diagnose()
    assert [extra.installed for extra in found.extras] == [False, True, False, True]
    assert found.problems[0] == "lap is required and not installed"
    assert "no R*Tree" in found.problems[1]
    output = CliRunner().invoke(app, ["doctor"]).output
    assert "pip install 'seo-slam[yolox]'" in output
    assert "pip install 'seo-slam[sim]'" in output
    assert "problem: lap is required" in output
