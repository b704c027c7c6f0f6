"""``seo-slam run --classes``: the words that a map is made of, from a file, the detector, or a chat model asked once."""

import json

import pytest
from typer.testing import CliRunner

from seo_slam import ClassList, SimulatedDesk, classes_of_place
from seo_slam.backends.recorded_detector import RecordedDetector
from seo_slam.cli import app as application
from seo_slam.cli.classes import with_classes
from seo_slam.config import LOCAL_AGENTS, Config
from seo_slam.errors import AgentError, ConfigError, SeoSlamError
from seo_slam.map import Map
from seo_slam.perception.hybrid import HybridDetector
from seo_slam.testing import ChatServer

KNOWS = """
from seo_slam.backends.recorded_detector import RecordedDetector

class Knows(RecordedDetector):
    names = ("cup", "book", "cup")
"""


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    SimulatedDesk(frames=30, width=160, height=120).write(folder)
    return folder


@pytest.fixture
def run(desk, tmp_path):
    """Run the command on the desk; return run.json and the words of all detections."""

    def run(*arguments, detector=("--detector", "recorded"), out="out"):
        seen = tmp_path / f"{out}.jsonl"
        fixed = ["run", "tum", desk, "--out", tmp_path / out, "--set", "embedder.name=hashed", "--record-detections", seen, *detector]
        result = CliRunner().invoke(application.app, [str(a) for a in (*fixed, *arguments)])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        assert result.exit_code == 0, result.stderr
        rows = [json.loads(line) for line in seen.read_text().splitlines()]
        words = {word for row in rows for word in row.get("labels", [d["label"] for d in row.get("detections", [])])}
        return json.loads((tmp_path / out / "run.json").read_text()), words

    return run


def kept(out):
    return ClassList.from_file(out / "classes.txt").words


def test_only_the_words_of_a_file_are_mapped_and_the_result_keeps_them(run, tmp_path):
    everything, words = run(out="all")
    assert {"cup", "book"} < words
    assert not (tmp_path / "all" / "classes.txt").exists()
    (tmp_path / "mine.txt").write_text("Cup  # to drink from\n\nbook\n")
    ran, words = run("--classes", tmp_path / "mine.txt")
    assert words == {"cup", "book"}
    assert 0 < ran["counts"]["detections"] < everything["counts"]["detections"]
    features = ran["config"]["features"]
    assert (features["classes"], features["only_classes"]) == (["Cup", "book"], True)
    assert kept(tmp_path / "out") == ("Cup", "book")
    assert {word for row in Map.load(tmp_path / "out").tentative for word in row.labels} <= {"cup", "book"}
    again, _ = run("--classes", tmp_path / "out" / "classes.txt", out="again")
    assert again["counts"] == ran["counts"]


def test_the_words_of_a_detector(run, desk, tmp_path, monkeypatch):
    (tmp_path / "knowing_detector.py").write_text(KNOWS)
    monkeypatch.syspath_prepend(tmp_path)
    knows = [
        "--detector",
        "knowing_detector:Knows",
        "--set",
        f'detector={{"name":"knowing_detector:Knows","options":{{"path":"{desk}/detections.jsonl"}}}}',
    ]
    ran, words = run("--classes", "detector", detector=knows)
    assert words == {"cup", "book"}
    assert kept(tmp_path / "out") == ("cup", "book")
    assert ran["config"]["detector"]["name"] == "knowing_detector:Knows"
    with pytest.raises(ConfigError, match="RecordedDetector does not say which words"):
        run("--classes", "detector", out="other")
    assert not (tmp_path / "other").exists()


def test_a_model_is_asked_once_about_the_place_and_is_no_agent(run, tmp_path):
    asked = []

    def answer(request):
        asked.append(request.text)
        return json.dumps({"classes": ["desk", "Cup", "book", "wall"]})

    with ChatServer(answer) as server:
        ran, words = run("--classes", "place:an office", "--chat-model", "m", "--chat-url", server.base_url)
    assert sum("an office" in text for text in asked) == 1  # besides what finds out which formats the server knows
    assert kept(tmp_path / "out") == ("desk", "cup", "book")
    assert words == {"cup", "book"}
    assert not any(agent["options"].get("chat") for agent in ran["config"]["agents"])


def test_the_kept_words_of_a_place_are_a_list_of_that_place(run, tmp_path):
    with ChatServer(lambda _: json.dumps({"classes": ["desk", "cup", "book"]})) as server:
        run("--classes", "place:an office", "--chat-model", "m", "--chat-url", server.base_url, "--max-frames", 2)
    file = tmp_path / "out" / "classes.txt"
    assert file.read_text().startswith("# classes of: an office\n")
    assert classes_of_place("an office", None, cache=file).words == ("desk", "cup", "book")
    with pytest.raises(ConfigError, match="holds the classes of 'an office'"):
        classes_of_place("a kitchen", None, cache=file)


def test_a_front_end_that_takes_the_words_itself_gets_those_of_the_place(run, desk, monkeypatch):
    used, detect = [], HybridDetector.detect
    monkeypatch.setattr(HybridDetector, "detect", lambda self, frame: used.append(self.classes) or detect(self, frame))
    options = {"detector": {"name": "recorded", "options": {"path": str(desk / "detections.jsonl")}}}
    hybrid = ("--set", f"detector={json.dumps({'name': 'hybrid', 'options': options})}")
    with ChatServer(lambda _: json.dumps({"classes": ["desk", "cup", "lamp"]})) as server:
        place = ("--classes", "place:an office", "--chat-model", "m", "--chat-url", server.base_url)
        ran, words = run(*place, "--max-frames", 2, detector=hybrid)
    assert ran["config"]["detector"]["options"]["classes"] == ["desk", "cup", "lamp"]
    assert {classes.words for classes in used} == {("desk", "cup", "lamp")}
    assert words == {"cup", "lamp"}


def test_no_model_is_asked_while_anything_else_is_wrong(run, tmp_path):
    run("--max-frames", 2, out="full")
    (tmp_path / "full.jsonl").unlink()
    (tmp_path / "listed").mkdir()
    (tmp_path / "listed" / "classes.txt").write_text("cup")
    (tmp_path / "file").write_text("")
    with ChatServer(lambda _: json.dumps({"classes": ["desk", "cup", "book"]})) as server:
        place = ("--classes", "place:an office", "--chat-model", "m", "--chat-url", server.base_url)
        for words, out, told in (
            ((), "full", "already holds a result"),
            ((), "file", "is a file"),
            ((), "listed", "--overwrite to replace it"),
            (("--continue", tmp_path / "nowhere"), "out", "nowhere"),
            (("--set", "associator.name=nothing"), "out", "nothing"),
        ):
            with pytest.raises(SeoSlamError, match=told):
                run(*place, *words, out=out)
        with pytest.raises(ConfigError, match="got no place"):
            run("--classes", "place: ", *place[2:])
        assert server.requests == ()
    assert not (tmp_path / "out").exists()


def test_a_list_edited_in_the_result_stays_as_it_is_and_another_replaces_it_only_if_told_to(run, tmp_path):
    (tmp_path / "out").mkdir()
    mine = tmp_path / "out" / "classes.txt"
    mine.write_text("cup  # to drink from\n")
    run("--classes", mine, "--max-frames", 2)
    run("--classes", mine, "--max-frames", 2, "--overwrite")
    run("--max-frames", 2, "--overwrite")
    assert mine.read_text() == "cup  # to drink from\n"
    (tmp_path / "other.txt").write_text("book\n")
    run("--classes", tmp_path / "other.txt", "--max-frames", 2, "--overwrite")
    assert kept(tmp_path / "out") == ("book",)


def test_chat_agents_of_a_preset_get_the_named_model_too(run):
    with ChatServer(lambda _: json.dumps({"classes": ["desk", "cup", "book"]})) as server:
        asked = ("--classes", "place:an office", "--chat-model", "m", "--chat-url", server.base_url, "--max-frames", 2)
        ran, _ = run("--preset", "seo_slam_chat", *asked)
        options = [agent["options"]["chat"]["options"] for agent in ran["config"]["agents"][:3]]
        assert options == [{"model": "m", "base_url": server.base_url}] * 3
        local, _ = run("--preset", "seo_slam_chat", "--agents", "local", *asked, out="local")
    assert [agent["name"] for agent in local["config"]["agents"]] == [agent.name for agent in LOCAL_AGENTS]


def test_what_cannot_be_is_said_before_anything_is_written(run, tmp_path):
    (tmp_path / "twice.txt").write_text("cup\nbook\nCUP\n")
    with pytest.raises(ConfigError, match="lines 1 and 3"):
        run("--classes", tmp_path / "twice.txt")
    with pytest.raises(ConfigError, match="class list cannot be read"):
        run("--classes", "no_such_file.txt")
    with pytest.raises(ConfigError, match="needs --chat-model"):
        run("--classes", "place:an office")
    with ChatServer(["Sure!"]) as server, pytest.raises(AgentError):
        run("--classes", "place:an office", "--chat-model", "m", "--chat-url", server.base_url)
    with pytest.raises(ConfigError, match=r"only_classes.*empty"):
        run("--set", "features.only_classes=true")
    assert not (tmp_path / "out").exists()


def test_the_front_end_of_two_takes_them_itself(desk):
    options = {"detector": {"name": "recorded", "options": {"path": str(desk / "detections.jsonl")}}}
    config = with_classes(Config.from_dict({"detector": {"name": "hybrid", "options": options}}), ClassList(("cup", "book")))
    made = HybridDetector(**config.detector.options)
    assert made.classes.words == ("cup", "book")
    assert isinstance(made.detector, RecordedDetector)
