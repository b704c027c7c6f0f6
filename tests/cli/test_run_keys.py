"""A key that is missing is said before the first byte is written; one that is set is in no file and no log."""

import json
import logging

import pytest
from typer.testing import CliRunner

from seo_slam.cli import app as application
from seo_slam.errors import ConfigError
from seo_slam.testing import BadStatus, ChatServer, scripted

KEY = "sk-proj-0123456789-very-secret"
QUICK = ["--set", "embedder.name=hashed", "--max-frames", "45", "--stride", "3"]


def run(recording, out, *arguments):
    return CliRunner().invoke(application.app, ["run", "tum", str(recording), "--out", str(out), *QUICK, *map(str, arguments)])


@pytest.fixture
def recording(shared):
    return shared / "data/tum_fr1_xyz"


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for name in ("OPENAI_API_KEY", "AZURE_OPENAI_API_KEY", "GROQ_API_KEY", "MY_KEY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.parametrize(
    ("arguments", "variable"),
    [
        (["--preset", "seo_slam_chat"], "OPENAI_API_KEY"),
        (["--agents", "chat", "--chat-model", "gpt-4o"], "OPENAI_API_KEY"),
        (["--agents", "chat", "--chat-model", "m", "--chat-url", "https://api.groq.com/openai/v1"], "GROQ_API_KEY"),
        (["--agents", "chat", "--chat-model", "m", "--chat-url", "http://127.0.0.1:9/v1", "--key-env", "MY_KEY"], "MY_KEY"),
    ],
)
def test_a_missing_key_is_said_before_the_first_byte_is_written(arguments, variable, recording, tmp_path):
    ran = run(recording, tmp_path / "out", "--detector", "none", *arguments)
    assert isinstance(ran.exception, ConfigError)
    assert f"set the environment variable {variable}" in str(ran.exception)
    assert list(tmp_path.iterdir()) == []


def test_a_key_in_place_of_its_variables_name_is_refused_and_not_shown(recording, tmp_path):
    ran = run(recording, tmp_path / "out", "--detector", "none", "--agents", "chat", "--chat-model", "m", "--key-env", KEY)
    assert isinstance(ran.exception, ConfigError)
    assert KEY not in str(ran.exception) + ran.output
    assert list(tmp_path.iterdir()) == []


def everything_in(folder):
    return b"".join(file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file())


@pytest.mark.parametrize(
    "fault",
    [
        (),
        BadStatus(401, f"no such key: {KEY}"),
        BadStatus(500, f"cannot serve Bearer {KEY}"),
        BadStatus(400, f"header Authorization: Bearer {KEY}"),
    ],
    ids=["all well", "refused", "broken", "400"],
)
def test_a_key_is_in_no_file_and_no_log(fault, recording, detections_file, tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("MY_KEY", KEY)
    caplog.set_level(logging.DEBUG)
    with ChatServer(scripted(), faults=fault, api_key=KEY) as server:
        ran = run(
            recording, tmp_path / "out", "--detector", "recorded", "--detections", detections_file, "--agents", "chat",
            "--chat-model", "m", "--chat-url", server.base_url, "--key-env", "MY_KEY", "--set", "runner.view_period_s=0",
            "--set", "runner.drain_s=2",
        )  # fmt: skip
        assert ran.exit_code == 0, ran.output
        asked = len(server.requests)
    assert asked > 0
    written = everything_in(tmp_path / "out")
    content = json.loads((tmp_path / "out" / "run.json").read_text())
    agents = content["agents"]["agents"]
    assert sum(agent["asked"] for agent in agents) > 0
    answered = sum(agent["answered"] for agent in agents if agent["model"])  # the local witness needs no server
    assert (answered > 0) == (fault == ())
    for secret in (KEY, KEY[8:], KEY[:-4]):
        assert secret.encode() not in written
        assert secret not in ran.output + caplog.text
    if isinstance(fault, BadStatus) and fault.status != 500:  # that one is still being repeated when the run ends
        assert "[MY_KEY]" in json.dumps(content["warnings"])
    if fault:
        assert content["warnings"]
