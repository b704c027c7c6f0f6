"""``seo-slam ask``."""

import json
import socket
from dataclasses import replace

import numpy as np
import pytest

from seo_slam.map import Map
from seo_slam.testing import ChatServer
from seo_slam.testing.store import make_landmark

HIKING = "I am going hiking, anything good?"
REPLY = {"answer": "Take the brown hiking boot (1).", "landmarks": [{"id": 1, "why": "the best grip"}]}


@pytest.fixture
def result(tmp_path):
    places = {1: ("brown hiking boot", (-0.32, -0.48, 0.04)), 4: ("green boot", (-0.34, 0.34, 0.05)), 9: ("red mug", (1.2, 0.1, 0.8))}
    rows = [
        replace(make_landmark(i, where), label=label, labels={label: 1.0}, embedding=np.zeros(0)) for i, (label, where) in places.items()
    ]
    Map(rows, "poses", "hashed").save(tmp_path)
    return tmp_path


@pytest.fixture
def no_network(monkeypatch):
    """A socket made in this test is a failure."""

    def refuse(*_arguments, **_options):
        raise AssertionError("the network was touched")

    monkeypatch.setattr(socket, "socket", refuse)


@pytest.fixture
def server():
    """A chat server with replies of its own, and the options that name it."""
    running = []

    def start(*replies, **options):
        made = ChatServer([reply if isinstance(reply, str) else json.dumps(reply) for reply in replies], **options)
        running.append(made.__enter__())
        return made, ("--chat-model", "told", "--chat-url", made.base_url)

    yield start
    for made in running:
        made.__exit__(None, None, None)


@pytest.mark.usefixtures("no_network")
def test_without_a_model_the_answer_is_the_ranked_list(run, result):
    status, out, err = run("ask", result, HIKING)
    assert status == 0
    assert "1. brown hiking boot (landmark 1) at x -0.32, y -0.48, z 0.04 m" in out
    assert err.startswith('warning: the embedder "hashed" knows spelling')


@pytest.mark.usefixtures("no_network")
def test_json_is_for_programs(run, result):
    status, out, err = run("ask", result, HIKING, "--json", "-k", "2")
    answer = json.loads(out)
    assert (status, err) == (0, "")
    assert (answer["question"], answer["source"], answer["refused"], answer["embedder"]) == (HIKING, "embedding", "", "hashed")
    assert [hit["id"] for hit in answer["hits"]] == [1, 4]
    assert answer["hits"][0]["stands_out"] is False
    assert len(answer["warnings"]) == 1


def test_a_chat_model_words_the_answer(run, result, server):
    _, options = server(REPLY)
    status, out, err = run("ask", result, HIKING, *options)
    assert (status, err) == (0, "")
    assert out.splitlines()[0] == "Take the brown hiking boot (1)."
    assert out.splitlines()[1].startswith("- brown hiking boot (landmark 1) at x -0.32, y -0.48, z 0.04 m")
    status, out, _ = run("ask", result, HIKING, *options, "--json")
    answer = json.loads(out)
    assert answer["source"].endswith("told")
    assert [(row["id"], row["why"], row["position_m"]) for row in answer["landmarks"]] == [(1, "the best grip", [-0.32, -0.48, 0.04])]


def test_an_answer_with_an_unknown_id_is_refused(run, result, server):
    _, options = server({"answer": "Take it (77).", "landmarks": []})
    status, out, err = run("ask", result, HIKING, *options)
    assert status == 0
    assert "the answer of told was refused: it names landmark 77" in err
    assert "1. brown hiking boot (landmark 1)" in out
    assert "77" not in out


def test_a_key_is_taken_from_the_variable_that_is_named(run, result, server, monkeypatch):
    _, options = server(REPLY, api_key="open-sesame")
    monkeypatch.setenv("MY_KEY", "open-sesame")
    status, out, err = run("ask", result, HIKING, *options, "--key-env", "MY_KEY")
    assert (status, out.splitlines()[0]) == (0, REPLY["answer"])
    assert "sesame" not in out + err
    monkeypatch.setenv("MY_KEY", "wrong")
    status, out, err = run("ask", result, HIKING, *options, "--key-env", "MY_KEY")
    assert status == 0
    assert "did not answer" in err
    assert "1. brown hiking boot" in out
    monkeypatch.delenv("MY_KEY")
    status, out, err = run("ask", result, HIKING, *options, "--key-env", "MY_KEY")
    assert (status, out) == (2, "")
    assert "MY_KEY" in err


def test_an_empty_map_says_so(run, tmp_path):
    Map(embedder="hashed").save(tmp_path)
    status, out, err = run("ask", tmp_path, HIKING)
    assert (status, err) == (0, "")
    assert "holds no stable thing" in out


def test_another_embedder_can_be_named(run, tmp_path):
    Map([make_landmark(1)]).save(tmp_path)
    status, _, err = run("ask", tmp_path, "a cup")
    assert status == 2
    assert "--embedder NAME" in err
    status, out, _ = run("ask", tmp_path, "a cup", "--embedder", "hashed")
    assert status == 0
    assert "cup (landmark 1)" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("{result}/nothing", "boots"), "nothing: no such map file"),
        (("{result}", " "), "ask: got an empty question"),
        (("{result}", "boots", "-k", "0"), "-k"),
        (("{result}", "boots", "--chat-url", "http://127.0.0.1:1/v1"), "--chat-url is given without --chat-model"),
        (("{result}", "boots", "--key-env", "MY_KEY"), "--key-env is given without --chat-model"),
        (("{result}", "boots", "--embedder", "hushed"), "hushed"),
    ],
)
def test_mistakes_end_with_one_clear_line(run, result, words, message):
    status, out, err = run("ask", *(word.replace("{result}", str(result)) for word in words))
    assert (status, out) == (2, "")
    assert message in err
    assert "Traceback" not in err
