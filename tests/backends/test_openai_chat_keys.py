"""A key comes from the environment and is found nowhere else."""

import asyncio
import copy
import logging
import pickle
import traceback

import httpx
import pytest
from fake_chat_http import QUESTION, WITH_SCHEMA, Server, refused, said

from seo_slam import registry
from seo_slam.backends.openai_chat import OpenAIChat
from seo_slam.config import Component
from seo_slam.errors import ChatReplyError, ChatRequestError, ConfigError

KEY = "sk-proj-0123456789-very-secret"
OPENAI = "https://api.openai.com/v1"


@pytest.fixture(autouse=True)
def environment(monkeypatch):
    for name in ("OPENAI_API_KEY", "AZURE_OPENAI_API_KEY", "GROQ_API_KEY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("MY_KEY", KEY)


@pytest.mark.parametrize(
    ("url", "variable"),
    [
        (OPENAI, "OPENAI_API_KEY"),
        ("https://eu.api.openai.com/v1/", "OPENAI_API_KEY"),
        ("https://mine.openai.azure.com/openai/v1", "AZURE_OPENAI_API_KEY"),
        ("https://api.groq.com/openai/v1", "GROQ_API_KEY"),
        ("http://127.0.0.1:8000/v1", None),
        ("http://localhost:11434/v1", None),
        ("http://[::1]:8080/v1", None),
        ("http://gpu-box:8000/v1", None),
        ("https://api.openai.com.evil.example/v1", None),
        ("https://notapi.openai.com/v1", None),
    ],
)
def test_a_missing_key_is_said_at_once(url, variable, monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY" if variable is None else "UNRELATED", KEY)
    if variable is None:
        assert "key=None" in repr(OpenAIChat("m", url))  # and another server never gets the key of OpenAI
        return
    with pytest.raises(ConfigError, match=f"is missing: set the environment variable {variable}"):
        OpenAIChat("m", url)
    monkeypatch.setenv(variable, KEY)
    assert f"key=<key from {variable}>" in repr(OpenAIChat("m", url))


@pytest.mark.parametrize("value", ["", "   "])
def test_an_empty_key_is_a_missing_one(value, monkeypatch):
    monkeypatch.setenv("MY_KEY", value)
    with pytest.raises(ConfigError, match="set the environment variable MY_KEY"):
        OpenAIChat("m", "http://127.0.0.1/v1", api_key_env="MY_KEY")


@pytest.mark.parametrize("value", ["sk-one two", "sk-é-secret", "sk-a\nb"])
def test_a_key_that_cannot_be_one_is_not_shown(value, monkeypatch):
    monkeypatch.setenv("MY_KEY", value)
    with pytest.raises(ConfigError, match="MY_KEY holds no key") as caught:
        OpenAIChat("m", api_key_env="MY_KEY")
    assert value not in str(caught.value)


@pytest.mark.parametrize("key", [KEY, "gsk_0123456789abcdef"])
def test_a_key_in_place_of_its_variables_name_is_not_shown(key):
    with pytest.raises(ConfigError, match="not the key itself") as caught:
        registry.create("chat_model", Component(name="openai", options={"model": "m", "api_key_env": key}))
    assert key not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "header", "value"),
    [
        ({"api_key_env": "MY_KEY"}, "authorization", f"Bearer {KEY}"),
        ({"api_key_env": "MY_KEY", "base_url": "https://mine.openai.azure.com/openai/v1"}, "api-key", KEY),
        ({"api_key_env": "MY_KEY", "api_key_header": "X-Api-Key"}, "x-api-key", KEY),
        ({}, "authorization", None),
    ],
)
def test_the_key_goes_into_its_header(options, header, value):
    server = Server()
    server.ask(**options)
    assert server.requests[0].headers.get(header) == value
    assert KEY.encode() not in server.requests[0].content


def everything_shown(error):
    """All texts of an error and of those behind it, with the local variables that crash reporters collect."""
    parts = []
    while error is not None:
        shown = traceback.TracebackException.from_exception(error)
        parts += [repr(error), *shown.format()]
        error = error.__cause__ or error.__context__
    return "\n".join(parts)


def echoes(request):
    """A proxy that shows the request it got."""
    return httpx.Response(400, text=f"<pre>{request.headers!s} {dict(request.headers.items())}\x00</pre>")


@pytest.mark.parametrize(
    "answer",
    [
        refused(401, f"Incorrect API key provided: {KEY}."),
        refused(401, f"x{chr(0)} " + f"{KEY[:10]}{chr(0)}{KEY[10:]}"),  # put together again by what strips control characters
        refused(400, "y" * 190 + KEY),  # cut by the excerpt
        refused(500, KEY, headers={"x-should-retry": "false"}),
        refused(429, KEY, headers={"retry-after": "999"}),
        httpx.Response(403, text=f"<html>{KEY}</html>"),
        httpx.Response(200, text=f"{KEY} is not a key"),
        httpx.Response(200, json={"error": {"message": KEY}}),
        said(None, refusal=f"I will not use {KEY}"),
        httpx.ConnectError(f"cannot connect with {KEY}"),
        httpx.LocalProtocolError(f"Illegal header value {KEY!r}"),
    ],
)
def test_a_key_that_comes_back_is_hidden(answer, caplog):
    caplog.set_level(logging.DEBUG)
    with pytest.raises((ChatRequestError, ChatReplyError)) as caught:
        Server(answer).ask(api_key_env="MY_KEY", deadline_s=0.2)
    for shown in (everything_shown(caught.value), caplog.text):
        assert KEY not in shown
        assert KEY[:12] not in shown.replace("proj-0123456789-very-se…", "")
    assert caught.value.__cause__ is None


def test_a_key_is_in_nothing_that_is_kept_or_shown(tmp_path, caplog):
    caplog.set_level(logging.DEBUG)
    server = Server(said(f'{{"word": "{KEY}"}}'))
    options = {"api_key_env": "MY_KEY", "cache": str(tmp_path / "cache.db"), "reply_format": "json_schema"}
    chat = server.chat(**options)
    reply = server.time.run(chat.complete(WITH_SCHEMA))
    assert reply.text == '{"word": "[MY_KEY]"}'
    shown = [repr(chat), str(vars(chat)), str(chat.usage()), caplog.text, str(vars(chat._client)), repr(chat._access), repr(reply)]
    for text in shown:
        assert KEY not in text
    server.time.run(chat.aclose())
    for file in tmp_path.iterdir():
        assert KEY.encode() not in file.read_bytes()
    for copied in (pickle.dumps, copy.deepcopy):
        with pytest.raises(TypeError, match="not written into files"):
            copied(chat._access)


def test_the_whole_answer_of_a_proxy_hides_it():
    client = httpx.AsyncClient(transport=httpx.MockTransport(echoes))
    with pytest.raises(ChatRequestError) as caught:
        asyncio.run(Server().chat(api_key_env="MY_KEY", client=client).complete(QUESTION))
    assert KEY not in everything_shown(caught.value)


def test_a_placeholder_is_not_hidden(monkeypatch):
    monkeypatch.setenv("MY_KEY", "EMPTY")
    assert Server(said("EMPTY shelf")).ask(api_key_env="MY_KEY").text == "EMPTY shelf"
