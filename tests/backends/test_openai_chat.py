"""The chat model asks as servers want to be asked, and makes an error with a clear text of every answer that is no reply."""

import asyncio
import base64
import gzip
import json
from dataclasses import replace

import httpx
import pytest
from fake_chat_http import LOCAL, QUESTION, SCHEMA, WITH_SCHEMA, Server, refused, said

from seo_slam import registry
from seo_slam.backends.chat_capabilities import PROBE
from seo_slam.backends.openai_chat import OpenAIChat
from seo_slam.config import Component
from seo_slam.errors import ChatReplyError, ChatRequestError, ConfigError
from seo_slam.interfaces import ChatReply, ChatRequest

JPEG = b"\xff\xd8\xff\xe0 not really"
PNG = b"\x89PNG\r\n\x1a\n not really"


def probe_answer(body):
    """A server that holds replies to a schema."""
    asked = body.get("response_format", {}).get("json_schema", {}).get("name")
    return said(json.dumps({"seo_slam_probe": False, "sentence": ""} if asked == PROBE.schema_name else {"word": "cup"}))


def test_a_question_and_its_reply():
    server = Server(said("a cup"))
    assert server.ask(ChatRequest("You look.", "What?", (JPEG, PNG), turns=(("a dog", "No."),), max_tokens=9)) == ChatReply(
        "a cup", "m-1", 100, 20
    )
    assert server.bodies == [
        {
            "model": "m",
            "messages": [
                {"role": "system", "content": "You look."},
                {
                    "role": "user",
                    "content": [
                        {"type": "text", "text": "What?"},
                        {"type": "image_url", "image_url": {"url": "data:image/jpeg;base64," + base64.b64encode(JPEG).decode()}},
                        {"type": "image_url", "image_url": {"url": "data:image/png;base64," + base64.b64encode(PNG).decode()}},
                    ],
                },
                {"role": "assistant", "content": "a dog"},
                {"role": "user", "content": "No."},
            ],
            "max_tokens": 9,
            "temperature": 0.7,
        }
    ]
    assert str(server.requests[0].url) == "http://127.0.0.1:8000/v1/chat/completions"


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (said(""), "the reply is empty"),
        (said(None), "the reply is empty"),
        (said(" \n"), "the reply is empty"),
        (said("", reasoning_content="hmm"), "thought and said nothing"),
        (said(None, reasoning="hmm"), "thought and said nothing"),
        (said(None, refusal="I will\x1b[31m not"), r"refused: I will\[31m not"),
        (said('{"word": "cu', finish_reason="length"), "cut off at max_tokens"),
        (said("", finish_reason="content_filter"), "content filter"),
        (httpx.Response(200, text="<html>login</html>"), "no JSON: '<html>"),
        (httpx.Response(200, text="[" * 100_000), "no JSON"),
        (httpx.Response(200, json=[1]), "no JSON object"),
        (httpx.Response(200, json={"choices": []}), "no choices"),
        (httpx.Response(200, json={"choices": ["x"], "usage": 3}), "the reply is empty"),
        (httpx.Response(200, json={"choices": [{"message": {"content": 7}}]}), "the reply is empty"),
        (said("x" * 10_000_000), "longer than 256 kB"),
    ],
)
def test_what_is_no_reply_says_so(answer, words):
    with pytest.raises(ChatReplyError, match=words):
        Server(answer).ask()


def test_content_in_parts_is_joined():
    assert Server(said([{"type": "text", "text": "a "}, {"type": "text", "text": "cup"}, 3])).ask().text == "a cup"


@pytest.mark.parametrize(
    ("answer", "permanent", "words"),
    [
        (refused(401, "bad key"), True, "127.0.0.1:8000: HTTP 401: bad key .*api_key_env"),
        (refused(403), True, "HTTP 403"),
        (refused(404, "no model m"), True, "no model m .*model's name right"),
        (httpx.Response(302, headers={"location": "https://elsewhere"}), True, "HTTP 302"),
        (refused(400, "bad\x00 image"), False, "HTTP 400: bad image"),
        (refused(413), False, "images are too large"),
        (refused(429, "pay", code="insufficient_quota"), True, "HTTP 429: pay"),
        (httpx.Response(400, text="plain"), False, "plain"),
        (httpx.Response(422, json={"detail": "field"}), False, "HTTP 422: field"),
        (httpx.Response(400, text=""), False, "no reason given"),
        (httpx.Response(200, json={"error": {"message": "gone", "code": 404}}), True, "HTTP 404: gone"),
        (refused(500, headers={"x-should-retry": "false"}), False, "HTTP 500"),
    ],
)
def test_errors_that_waiting_does_not_change(answer, permanent, words):
    server = Server(answer)
    with pytest.raises(ChatRequestError, match=words) as caught:
        server.ask()
    assert caught.value.permanent is permanent
    assert len(server.bodies) == 1


class Endless(httpx.AsyncByteStream):
    """A body that counts what is read of it."""

    read = 0

    def __init__(self, chunk):
        self.chunk = chunk

    async def __aiter__(self):
        while self.read < 10_000_000:
            self.read += len(self.chunk)
            yield self.chunk


@pytest.mark.parametrize("headers", [{}, {"content-encoding": "gzip"}])
def test_a_huge_reply_is_not_read_to_its_end(headers):
    body = Endless(b"x" * 10_000)
    client = httpx.AsyncClient(transport=httpx.MockTransport(lambda request: httpx.Response(200, headers=headers, stream=body)))
    with pytest.raises((ChatReplyError, ChatRequestError)):
        asyncio.run(Server().chat(client=client, deadline_s=0.01).complete(QUESTION))
    assert body.read <= 280_000


class Packed(Endless):
    async def __aiter__(self):
        yield self.chunk


@pytest.mark.parametrize(("text", "fits"), [("a cup", True), ("x" * 5_000_000, False)])
def test_a_compressed_reply_is_unpacked_only_so_far(text, fits):
    packed = gzip.compress(said(text).content)
    assert len(packed) < 10_000
    answer = lambda request: httpx.Response(200, headers={"content-encoding": "gzip"}, stream=Packed(packed))  # noqa: E731
    question = Server().chat(client=httpx.AsyncClient(transport=httpx.MockTransport(answer))).complete(QUESTION)
    if fits:
        assert asyncio.run(question).text == text
    else:
        with pytest.raises(ChatReplyError, match="longer than 256 kB"):
            asyncio.run(question)


def test_an_image_must_be_one_and_fit():
    with pytest.raises(ChatRequestError, match="image 2 of a question begins with b'GIF89a"):
        Server().ask(replace(QUESTION, images=(JPEG, b"GIF89a")))
    server = Server()
    with pytest.raises(ChatRequestError, match=r"takes 4 MB a request; this question has 4.* base64 included"):
        server.ask(replace(QUESTION, images=(JPEG + bytes(3_000_000),)), max_request_bytes=4_000_000)
    assert server.bodies == []


def test_a_server_that_keeps_to_schemas_is_found_once():
    server = Server(probe_answer, latency_s=1.0)
    chat = server.chat()

    async def many():
        return await asyncio.gather(*(chat.complete(WITH_SCHEMA) for _ in range(5)))

    assert [reply.text for reply in server.time.run(many())] == ['{"word": "cup"}'] * 5
    names = [body["response_format"]["json_schema"]["name"] for body in server.bodies]
    assert names == ["seo_slam_probe"] + ["one_word"] * 5
    assert server.bodies[1]["response_format"]["json_schema"] == {"name": "one_word", "schema": SCHEMA, "strict": True}
    assert chat.usage().requests == 6


def test_without_a_schema_nothing_is_probed():
    server = Server()
    server.ask()
    assert ["response_format" in body for body in server.bodies] == [False]


@pytest.mark.parametrize("probed", [said("Good morning!"), refused(400, "unknown"), said('{"other": 1}'), said(""), refused(422)])
def test_a_server_that_fails_open_is_seen(probed):
    def only_json(body):
        return probed if body["response_format"]["type"] == "json_schema" else said('{"word": "cup"}')

    server = Server(only_json)
    server.ask(WITH_SCHEMA)
    assert [body["response_format"]["type"] for body in server.bodies] == ["json_schema", "json_object", "json_object"]
    assert json.dumps(SCHEMA) in server.bodies[-1]["messages"][0]["content"]
    assert server.bodies[-1]["messages"][1]["content"][0]["text"] == WITH_SCHEMA.text  # the question itself stays as it is


def test_a_server_that_can_do_neither_is_asked_in_words():
    server = Server(lambda body: said("Good morning!" if "response_format" in body else '{"word": "cup"}'))
    chat = server.chat()
    assert server.time.run(chat.complete(WITH_SCHEMA)).text == '{"word": "cup"}'
    assert "response_format" not in server.bodies[-1]
    assert json.dumps(SCHEMA) in server.bodies[-1]["messages"][0]["content"]
    server.time.run(chat.complete(WITH_SCHEMA))
    assert len(server.bodies) == 4  # not probed again


def test_the_probe_of_a_dead_server_fails_for_all_who_wait():
    server = Server(refused(401, "bad key"), latency_s=1.0)
    chat = server.chat()

    async def many():
        return await asyncio.gather(*(chat.complete(WITH_SCHEMA) for _ in range(3)), return_exceptions=True)

    errors = server.time.run(many())
    assert [(type(e), e.permanent) for e in errors] == [(ChatRequestError, True)] * 3
    assert len(server.bodies) == 1
    server.answers = [probe_answer]
    assert server.time.run(chat.complete(WITH_SCHEMA)).text  # asked anew


def test_a_probe_that_is_cancelled_is_made_by_the_next():
    server = Server(probe_answer, latency_s=1.0)
    chat = server.chat()

    async def cancel_first():
        first, second = (asyncio.create_task(chat.complete(WITH_SCHEMA)) for _ in range(2))
        await server.time.sleep(0.5)
        first.cancel()
        return await second

    assert server.time.run(cancel_first()).text == '{"word": "cup"}'


def test_a_schema_that_is_not_kept_to_is_said_in_words_from_then_on(caplog):
    def sometimes_open(body):
        asked = body.get("response_format", {})
        return said("A cup.") if asked.get("json_schema", {}).get("name") == "one_word" else probe_answer(body)

    server = Server(sometimes_open)
    chat = server.chat()
    assert server.time.run(chat.complete(WITH_SCHEMA)).text == "A cup."
    server.time.run(chat.complete(WITH_SCHEMA))
    assert server.bodies[-1]["response_format"] == {"type": "json_object"}
    assert "did not hold a reply to the schema" in caplog.text


def test_a_format_refused_later_steps_down_only_when_it_was_found_out():
    answers = [probe_answer, refused(400, "response_format: schema too complex"), said('{"word": "cup"}')]
    server = Server(*answers)
    server.ask(WITH_SCHEMA)
    assert [body["response_format"]["type"] for body in server.bodies] == ["json_schema", "json_schema", "json_object"]
    with pytest.raises(ChatRequestError, match="schema too complex"):
        Server(*answers[1:]).ask(WITH_SCHEMA, reply_format="json_schema")


def test_a_schema_beyond_the_strict_subset_is_said_in_words():
    server = Server(said('{"a": 1}'))
    free = replace(WITH_SCHEMA, schema={"type": "object", "additionalProperties": {"type": "number"}})
    server.ask(free, reply_format="json_schema")
    assert server.bodies[0]["response_format"] == {"type": "json_object"}
    assert '"additionalProperties": {"type": "number"}' in server.bodies[0]["messages"][0]["content"]


def test_newer_models_want_other_parameters():
    server = Server(
        refused(400, "Unsupported parameter: 'max_tokens' is not supported with this model. Use 'max_completion_tokens' instead."),
        refused(400, "Unsupported value: 'temperature' does not support 0.7 with this model."),
        said("a cup"),
    )
    chat = server.chat()
    server.time.run(chat.complete(QUESTION))
    server.time.run(chat.complete(QUESTION))
    assert [("max_tokens" in body, "max_completion_tokens" in body, "temperature" in body) for body in server.bodies] == [
        (True, False, True),
        (False, True, True),
        (False, True, False),
        (False, True, False),
    ]


def test_clients_belong_to_their_loops(monkeypatch):
    made = []

    class Client(httpx.AsyncClient):
        def __init__(self, **options):
            assert options.pop("trust_env") is False  # no proxy on the way to this machine
            assert options.pop("verify") is False  # and no certificates to load
            super().__init__(transport=httpx.MockTransport(lambda request: said("a cup")), **options)
            made.append(self)

    monkeypatch.setattr(httpx, "AsyncClient", Client)
    chat = registry.create("chat_model", Component(name="openai", options={"model": "m", "base_url": LOCAL, "cache": False}))

    async def twice():
        await chat.complete(QUESTION)
        await chat.complete(QUESTION)

    asyncio.run(twice())
    assert [client.is_closed for client in made] == [True]  # closed with its loop, though nobody called aclose

    async def closing():
        await chat.complete(QUESTION)
        await chat.aclose()
        await chat.aclose()
        assert made[1].is_closed

    asyncio.run(closing())
    assert len(made) == 2


def test_certificates_and_proxies_count_on_the_way_to_another_machine(monkeypatch):
    made = []

    class Client(httpx.AsyncClient):
        def __init__(self, **options):
            made.append(options)
            super().__init__(transport=httpx.MockTransport(lambda request: said("a cup")))

    monkeypatch.setattr(httpx, "AsyncClient", Client)
    asyncio.run(OpenAIChat("m", "https://gpu-box/v1").complete(QUESTION))
    assert made == [{"trust_env": True, "verify": True}]


def test_an_injected_client_of_another_package_may_have_its_own_errors(monkeypatch):
    import sys
    from types import ModuleType

    other = ModuleType("other_http")
    other.RequestError = type("RequestError", (Exception,), {})
    monkeypatch.setitem(sys.modules, "other_http", other)

    def stream(self, *args, **options):
        raise other.RequestError("connection lost")

    client = type("AsyncClient", (), {"stream": stream, "__module__": "other_http"})()
    with pytest.raises(ChatRequestError, match="RequestError: connection lost"):
        Server().ask(client=client)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"model": ""}, "model: got ''"),
        ({"base_url": "127.0.0.1:8000"}, "base_url: got"),
        ({"base_url": "ftp://x"}, "base_url: got"),
        ({"base_url": 3}, "base_url: got a int"),
        ({"base_url": "http://[::1"}, "base_url: is no URL"),
        ({"base_url": "http://me:hunter2@127.0.0.1/v1"}, "base_url: holds a user name"),
        ({"base_url": "http://127.0.0.1/v1?key=hunter2"}, "base_url: holds a user name"),
        ({"reply_format": "xml"}, "reply_format: got 'xml', wanted one of auto"),
        ({"timeout_s": 0}, "timeout_s: got 0"),
        ({"deadline_s": "60"}, "deadline_s: got '60'"),
        ({"requests_per_minute": -1}, "requests_per_minute: got -1"),
        ({"tokens_per_minute": True}, "tokens_per_minute: got True"),
        ({"window_s": float("nan")}, "window_s: got nan"),
        ({"max_cost": 1.0}, "max_cost needs price_per_million"),
        ({"price_per_million": [1.0]}, "price_per_million: got"),
        ({"price_per_million": "12"}, "price_per_million: got"),
        ({"price_per_million": [1, -1]}, "price_per_million: got"),
        ({"cache": 3}, "cache: got 3"),
        ({"api_key_header": "bad header"}, "api_key_header: got"),
        ({"temprature": 0.5}, "no option 'temprature'"),
    ],
)
def test_bad_options_are_named(options, words):
    with pytest.raises(ConfigError, match=words) as caught:
        registry.create("chat_model", Component(name="openai", options={"model": "m", "base_url": LOCAL} | options))
    assert "hunter2" not in str(caught.value)
