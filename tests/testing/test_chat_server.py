"""The chat server: real sockets, the wire format, its log, and its end."""

import asyncio
import base64
import http.client
import json
import logging
import random
import socket
import threading
import time

import httpx
import pytest
from chat_asking import DESCRIPTION, MERGING, VERIFICATION, ask, ask_many, body, client, post, said

from seo_slam.errors import ChatRequestError, ConfigError
from seo_slam.interfaces import ChatRequest
from seo_slam.simulation.chat_tokens import tokens_of_question
from seo_slam.testing import ChatServer, Hang, NotJson, Sometimes, scripted

PNG = b"\x89PNG\r\n\x1a\n" + bytes(24)


def server_threads():
    return [thread for thread in threading.enumerate() if "chat server" in thread.name]


def test_replies_come_in_their_order_and_the_last_one_again():
    with ChatServer(["one", "two"]) as server:
        replies = [post(server)[2] for _ in range(3)]
    assert [said(reply) for reply in replies] == ["one", "two", "two"]
    assert replies[0]["object"] == "chat.completion"
    assert replies[0]["model"] == "tiny"
    assert replies[0]["choices"][0]["finish_reason"] == "stop"


def test_a_function_gets_the_question_as_it_was_asked():
    questions = []

    def answer(question):
        questions.append(question)
        return "fine"

    def part(data):
        return {"type": "image_url", "image_url": {"url": "data:image/png;base64," + base64.b64encode(data).decode()}}

    schema = {"type": "object", "properties": {"a": {"type": "string"}}}
    asked = {
        "model": "tiny",
        "messages": [
            {"role": "system", "content": "Be brief."},
            {"role": "user", "content": [{"type": "text", "text": "What is it?"}, part(PNG), part(b"other")]},
            {"role": "assistant", "content": "a cup"},
            {"role": "user", "content": "That is no JSON."},
        ],
        "temperature": 0.2,
        "max_completion_tokens": 33,
        "response_format": {"type": "json_schema", "json_schema": {"name": "verdicts", "schema": schema, "strict": True}},
    }
    with ChatServer(answer) as server:
        _, _, reply = post(server, asked)
    expected = ChatRequest(
        "Be brief.", "What is it?", (PNG, b"other"), schema, "verdicts", (("a cup", "That is no JSON."),), temperature=0.2, max_tokens=33
    )
    assert questions == [expected]
    assert reply["usage"] == {
        "prompt_tokens": tokens_of_question(expected),
        "completion_tokens": 1,
        "total_tokens": tokens_of_question(expected) + 1,
    }


def test_connections_are_kept():
    with ChatServer(["x"]) as server:
        connection = http.client.HTTPConnection("127.0.0.1", int(server.base_url.split(":")[2].split("/")[0]))
        sockets = set()
        for _ in range(3):
            connection.request("POST", "/v1/chat/completions", json.dumps(body()))
            assert json.load(connection.getresponse())["choices"]
            sockets.add(connection.sock)
        assert len(sockets) == 1
        connection.close()


def test_many_at_once_wait_together():
    with ChatServer(["x"], latency_s=0.3) as server:
        replies = ask_many(server, 40)
    assert [status for status, _ in replies] == [200] * 40
    assert server.most_in_flight > 10
    assert all(seen.seconds >= 0.3 for seen in server.requests)


def test_jitter_is_drawn_by_seed_and_number():
    with ChatServer(["x"], latency_s=0.02, jitter_s=0.1, seed=1) as server:
        for _ in range(3):
            post(server)
    drawn_s = [0.1 * random.Random(f"1|jitter|{number}").random() for number in (1, 2, 3)]
    assert all(seen.seconds >= 0.02 + more_s for seen, more_s in zip(server.requests, drawn_s, strict=True))


def test_the_log_says_what_was_asked():
    with ChatServer(scripted(), api_key="secret") as server:
        for text in (VERIFICATION, DESCRIPTION, MERGING, "hello"):
            assert post(server, body(text, model="m-" + text[2:5]), {"Authorization": "Bearer secret"})[0] == 200
        assert post(server)[0] == 401
    seen = server.requests
    assert [entry.number for entry in seen] == [1, 2, 3, 4, 5]
    assert [entry.role for entry in seen] == ["verification", "description", "merging", "other", "other"]
    assert [entry.status for entry in seen] == [200, 200, 200, 200, 401]
    assert seen[0].model == "m-lan"
    assert seen[0].tokens == seen[0].prompt_tokens + seen[0].completion_tokens > 0
    assert seen[4].tokens == 0
    assert sorted(entry.time_s for entry in seen) == [entry.time_s for entry in seen]
    assert "secret" not in repr(seen)


def test_scripted_answers_go_by_role():
    with ChatServer(
        scripted(verification={"verdicts": []}, description=lambda question: {"n": len(question.boxes)}, merging=NotJson("no"))
    ) as server:
        assert [said(post(server, body(text))[2]) for text in (VERIFICATION, DESCRIPTION, MERGING)] == [
            '{"verdicts": []}',
            '{"n": 1}',
            "no",
        ]
    with ChatServer(scripted()) as server:
        replies = [said(post(server, body(text))[2]) for text in (VERIFICATION, DESCRIPTION, MERGING)]
    assert json.loads(replies[0]) == {"verdicts": [{"box": 1, "object": "cup", "score": 1.0}]}
    assert json.loads(replies[1]) == {"matched_label": "N/A", "generated_label": "cup", "category": "cup"}
    assert json.loads(replies[2]) == {"duplicates": []}


@pytest.mark.parametrize("header", [{"Authorization": "Bearer right"}, {"api-key": "right"}])
def test_the_key_is_asked_for(header):
    with ChatServer(["x"], api_key="right") as server:
        assert post(server, headers=header)[0] == 200
        for wrong in ({}, {"Authorization": "Bearer wrong"}, {"api-key": ""}):
            status, _, reply = post(server, headers=wrong)
            assert status == 401
            assert "right" not in json.dumps(reply)


def test_models_are_listed_and_others_do_not_exist():
    with ChatServer(["x"], model=["small", "large"]) as server:
        with httpx.Client(trust_env=False) as asking:
            listed = asking.get(server.base_url + "/models").json()
        assert [model["id"] for model in listed["data"]] == ["small", "large"]
        assert post(server, body(model="large"))[0] == 200
        assert post(server, body(model="huge"))[0] == 404
        assert post(server, path="/elsewhere")[0] == 404


SCHEMA = {"type": "json_schema", "json_schema": {"name": "a", "schema": {"type": "object"}}}
OBJECT = {"type": "json_object"}


@pytest.mark.parametrize(
    ("supports", "format_", "holds"),
    [
        ("json_schema", SCHEMA, True),
        ("json_schema", OBJECT, True),
        ("json_object", SCHEMA, False),
        ("json_object", OBJECT, True),
        ("prompt", SCHEMA, False),
        ("prompt", OBJECT, False),
        ("prompt", {"type": "text"}, True),
        ("prompt", None, True),
    ],
)
def test_servers_hold_to_what_they_support_and_refuse_or_ignore_the_rest(supports, format_, holds):
    asked = body(response_format=format_) if format_ else body()
    with ChatServer(['{"a": 1}'], supports=supports) as server:
        assert post(server, asked)[0] == (200 if holds else 400)
    schemas = []

    def answer(question):
        schemas.append(question.schema)
        return '{"a": 1}'

    with ChatServer(answer, supports=supports, fails_open=True) as server:
        status, _, reply = post(server, asked)
    assert status == 200
    assert (said(reply) == '{"a": 1}') == holds
    assert '{"a": 1}' in said(reply)
    assert (schemas[0] is not None) == (holds and format_ in (SCHEMA, OBJECT))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ([], "'model'"),
        ({"model": "m"}, "'messages'"),
        ({"model": "m", "messages": [{"role": "robot", "content": "x"}]}, "role"),
        ({"model": "m", "messages": [{"role": "system", "content": "x"}]}, "user"),
        ({"model": "m", "messages": [{"role": "user", "content": 3}]}, "neither text"),
        ({"model": "m", "messages": [{"role": "user", "content": [{"type": "audio"}]}]}, "audio"),
        (
            body() | {"messages": [{"role": "user", "content": [{"type": "image_url", "image_url": {"url": "http://example.org/a.png"}}]}]},
            "data URL",
        ),
        (
            body() | {"messages": [{"role": "user", "content": [{"type": "image_url", "image_url": {"url": "data:image/png;base64,*"}}]}]},
            "base64",
        ),
        (body(stream=True), "stream"),
        (body(max_tokens="many"), "max_tokens"),
        (body(response_format={"type": "xml"}), "response_format"),
    ],
)
def test_what_is_no_chat_completion_is_refused(asked, message):
    with ChatServer(["x"]) as server:
        status, _, reply = post(server, asked)
    assert status == 400
    assert message in reply["error"]["message"]
    assert server.requests[0].status == 400


def raw(server, data):
    """Send bytes, and return all that comes until the server closes."""
    port = int(server.base_url.split(":")[2].split("/")[0])
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(65536), b""))


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"rubbish\r\n\r\n", b"400"),
        (b"POST /v1/chat/completions HTTP/1.1\r\nContent-Length: -3\r\n\r\n", b"400"),
        (b"POST /v1/chat/completions HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n", b"411"),
        (b"POST /v1/chat/completions HTTP/1.1\r\nContent-Length: 2000\r\n\r\n", b"413"),
        (b"POST /v1/chat/completions HTTP/1.1\r\n" + b"A: " + b"a" * 100_000, b"431"),
        (b"POST /v1/chat/completions HTTP/1.1\r\n" + b"".join(b"h%d: 1\r\n" % k for k in range(200)) + b"\r\n", b"431"),
        (b"GET /v1/models HTTP/1.0\r\n\r\n", b"200"),
        (b"POST /v1/chat/completions HTTP/1.1\r\nContent-Length: 5\r\n\r\n{{{{{", b"400"),
        (b"", b""),
        (b"POST /v1/chat/completions HTTP/1.1\r\nContent-Length: 900\r\n\r\n{", b""),
    ],
)
def test_rubbish_on_the_wire_does_no_harm(data, status):
    with ChatServer(["x"], most_bytes=1000) as server:
        answer = raw(server, data)
        assert answer[:12].endswith(status)
        assert bool(answer) == bool(status)
        assert said(post(server)[2]) == "x"


def test_an_answer_that_fails_is_an_error_of_the_server(caplog):
    def fails(question):
        raise ValueError("my own mistake")

    def refuses(question):
        raise ChatRequestError("no such frame", permanent=True)

    with caplog.at_level(logging.CRITICAL), ChatServer(fails) as server:
        status, _, reply = post(server)
    assert (status, reply["error"]["message"]) == (500, "ValueError: my own mistake")
    with ChatServer(refuses) as server:
        status, _, reply = post(server)
    assert (status, reply["error"]["message"]) == (400, "no such frame")


def test_it_closes_at_once_with_64_requests_hanging():
    async def run():
        with ChatServer(["x"], faults=Hang()) as server:
            async with client() as made:
                asking = [asyncio.create_task(ask(made, server)) for _ in range(64)]
                while server.in_flight < 64:
                    await asyncio.sleep(0.01)
                began_s = time.monotonic()
                server.close()
                took_s = time.monotonic() - began_s
                ends = await asyncio.gather(*asking, return_exceptions=True)
        return server, took_s, ends

    server, took_s, ends = asyncio.run(run())
    assert took_s < 1.0
    assert all(isinstance(end, httpx.TransportError) for end in ends)
    assert server_threads() == []
    assert [seen.status for seen in server.requests] == [0] * 64
    assert server.in_flight == 0


def test_a_client_that_gives_up_is_noticed():
    async def run():
        with ChatServer(["x"], faults=Sometimes(Hang(), first=1)) as server:
            async with client() as made:
                with pytest.raises(TimeoutError):
                    await asyncio.wait_for(ask(made, server), 0.2)
                while server.in_flight:
                    await asyncio.sleep(0.01)
                assert (await ask(made, server))[0] == 200
        return server.requests

    assert [seen.status for seen in asyncio.run(run())] == [0, 200]


def test_it_can_be_started_again_at_the_same_address():
    server = ChatServer(["one", "two"])
    with pytest.raises(ConfigError, match="no address"):
        _ = server.base_url
    with server:
        assert said(post(server)[2]) == "one"
        where = server.base_url
    server.close()
    with pytest.raises(OSError):  # noqa: PT011  # refused, in the words of the system
        post(server)
    with server:
        assert server.base_url == where
        assert said(post(server)[2]) == "two"
    assert len(server.requests) == 2
    assert server_threads() == []


def test_it_serves_beside_a_running_loop():
    async def run():
        async with client() as made:
            with ChatServer(["x"]) as server:
                return await ask(made, server)

    assert asyncio.run(run())[0] == 200


@pytest.mark.parametrize(
    "options",
    [
        {"latency_s": -1},
        {"jitter_s": -1},
        {"supports": "xml"},
        {"requests_per_minute": 0},
        {"tokens_per_minute": 0},
        {"requests_per_minute": 3, "window_s": 0},
    ],
)
def test_impossible_servers_are_refused(options):
    with pytest.raises(ConfigError):
        ChatServer(["x"], **options)


@pytest.mark.parametrize("answers", [[], "text"])
def test_a_server_needs_answers(answers):
    with pytest.raises(ConfigError, match="answers"):
        ChatServer(answers)
