"""Failures that pass are waited for, as the server says, until a deadline; a 429 stops everybody for a while."""

import asyncio
import random
import time

import httpx
import pytest
from fake_chat_http import QUESTION, Server, VirtualTime, refused, said
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.backends.chat_retries import duration_s, jittered_s, own_wait_s, wait_said
from seo_slam.errors import ChatRequestError

GONE = httpx.ConnectError("connection refused")


@pytest.mark.parametrize(
    ("headers", "seconds"),
    [
        ({}, None),
        ({"retry-after": "7"}, 7.0),
        ({"retry-after": "0.5"}, 0.5),
        ({"retry-after-ms": "250", "retry-after": "7"}, 0.25),
        ({"retry-after": "Wed, 21 Oct 2026 07:28:10 GMT", "date": "Wed, 21 Oct 2026 07:28:00 GMT"}, 10.0),
        ({"retry-after": "Wed, 21 Oct 2026 07:27:10 GMT", "date": "Wed, 21 Oct 2026 07:28:00 GMT"}, 0.0),
        ({"retry-after": "soon"}, None),
        ({"retry-after": "-3"}, None),
        ({"retry-after": "nan"}, None),
        ({"retry-after": "1e999"}, None),
        ({"retry-after": "9" * 5000}, None),
        ({"retry-after": "Wed, 99 Oct 2026 07:28:10 GMT"}, None),
        ({"x-ratelimit-reset-requests": "6m0s"}, 360.0),
        ({"x-ratelimit-reset-requests": "12ms", "x-ratelimit-reset-tokens": "1.5s"}, 1.5),
        (
            {
                "x-ratelimit-reset-requests": "6m0s",
                "x-ratelimit-remaining-requests": "59",
                "x-ratelimit-reset-tokens": "2s",
                "x-ratelimit-remaining-tokens": "0",
            },
            2.0,
        ),
        ({"x-ratelimit-reset-tokens": "0", "x-ratelimit-remaining-tokens": "-1"}, None),
        ({"x-ratelimit-reset-tokens": "-1"}, None),
    ],
)
def test_what_servers_say(headers, seconds):
    assert wait_said(headers) == (None if seconds is None else pytest.approx(seconds))


def test_a_date_without_the_servers_own_is_taken_against_the_clock():
    assert wait_said({"retry-after": "Wed, 21 Oct 2026 07:28:10 GMT"}, 1792567680.0) == pytest.approx(10.0)
    assert 5.0 < wait_said({"retry-after": time.strftime("%a, %d %b %Y %H:%M:%S GMT", time.gmtime(time.time() + 60))}) <= 60.0


@pytest.mark.parametrize(
    ("text", "seconds"), [("1h2m3.5s", 3723.5), ("120ms", 0.12), ("2m", 120.0), ("2.5", 2.5), ("", None), ("s", None), ("6x", None)]
)
def test_durations(text, seconds):
    assert duration_s(text) == (None if seconds is None else pytest.approx(seconds))


@given(st.text(max_size=60), st.text(max_size=60))
def test_any_header_is_a_wait_or_nothing(first, second):
    said_s = wait_said({"retry-after": first, "date": second, "x-ratelimit-reset-tokens": first, "x-ratelimit-remaining-tokens": second})
    assert said_s is None or said_s >= 0.0


@given(st.integers(1, 10_000), st.integers(), st.floats(0, 1e6))
def test_waits_have_jitter_and_an_end(attempt, seed, said_s):
    assert 0.25 <= own_wait_s(attempt, random.Random(seed)) <= 8.0
    assert said_s <= jittered_s(said_s, random.Random(seed)) <= said_s + 1.1


@pytest.mark.parametrize(
    "failure", [refused(408), refused(409), refused(500), refused(503), GONE, httpx.ReadTimeout("slow"), httpx.DecodingError("x")]
)
def test_what_can_pass_is_tried_again(failure):
    server = Server(failure, failure, said("a cup"))
    chat = server.chat()
    assert server.time.run(chat.complete(QUESTION)).text == "a cup"
    assert (chat.usage().requests, chat.usage().retries) == (3, 2)
    first, second, third = server.times_s
    assert 0.25 <= second - first <= 0.5
    assert 0.5 <= third - second <= 1.0


def test_an_error_within_a_200_counts_as_one():
    server = Server(httpx.Response(200, json={"error": {"message": "overloaded", "code": 503}}), said("a cup"))
    assert server.ask().text == "a cup"


@pytest.mark.parametrize(
    ("status", "headers", "least_s"), [(429, {"Retry-After": "5"}, 5.0), (503, {"retry-after-ms": "3000"}, 3.0), (429, {}, 0.25)]
)
def test_the_wait_is_the_servers(status, headers, least_s):
    server = Server(refused(status, headers=headers), said("a cup"))
    server.ask()
    assert least_s <= server.times_s[1] <= least_s + 1.7


def test_the_deadline_ends_it():
    server = Server(refused(503, "overloaded"))
    with pytest.raises(ChatRequestError, match=r"HTTP 503: overloaded \(asked \d+ times; .* past the deadline of 20 s") as caught:
        server.ask(deadline_s=20.0)
    assert not caught.value.permanent
    assert 10.0 < server.times_s[-1] < 20.0
    assert 4 < len(server.bodies) < 12


def test_a_wait_past_the_deadline_is_not_begun():
    server = Server(refused(429, "slow down", {"retry-after": "3600"}))
    chat = server.chat()
    with pytest.raises(ChatRequestError, match=r"slow down .asked 1 time; another try in 3.6"):
        server.time.run(chat.complete(QUESTION))
    with pytest.raises(ChatRequestError, match=r"takes no questions for another 3.6"):  # nor is anything sent during the pause
        server.time.run(chat.complete(QUESTION))
    assert len(server.bodies) == 1
    assert server.time.now_s == 0.0


def test_a_429_stops_all_who_ask_the_same_model():
    time_ = VirtualTime()
    busy = Server(refused(429, headers={"retry-after": "10"}), said("a cup"), time=time_)
    other = Server(time=time_)
    chat, same_model = busy.chat(), other.chat()
    another_model = other.chat(model="n")

    async def main():
        first = asyncio.create_task(chat.complete(QUESTION))
        await time_.sleep(1.0)
        await another_model.complete(QUESTION)
        await asyncio.gather(first, same_model.complete(QUESTION), chat.complete(QUESTION))

    time_.run(main())
    assert other.times_s[0] == 1.0
    assert all(second >= 10.0 for second in [*other.times_s[1:], *busy.times_s[1:]])
    assert same_model.usage().waited_s >= 9.0


def test_a_server_that_hangs_is_left():
    async def hang(request):
        await asyncio.Event().wait()

    client = httpx.AsyncClient(transport=httpx.MockTransport(hang))
    with pytest.raises(ChatRequestError, match=r"no complete answer within 0.01 s"):
        asyncio.run(Server().chat(client=client, timeout_s=0.01, deadline_s=0.015).complete(QUESTION))


def test_a_server_that_drips_is_left():
    class Drip(httpx.AsyncByteStream):
        async def __aiter__(self):
            while True:
                yield b" "
                await asyncio.sleep(0.001)

    client = httpx.AsyncClient(transport=httpx.MockTransport(lambda request: httpx.Response(200, stream=Drip())))
    with pytest.raises(ChatRequestError, match="no complete answer"):
        asyncio.run(Server().chat(client=client, timeout_s=0.02, deadline_s=0.025).complete(QUESTION))


@pytest.mark.parametrize("state", ["sent", "backoff", "paused", "queued"])
def test_cancelling_is_prompt(state):
    async def hang(request):
        if state in ("sent", "queued"):
            await asyncio.Event().wait()
        return refused(429 if state == "paused" else 503, headers={"retry-after": "30"})

    async def main():
        client = httpx.AsyncClient(transport=httpx.MockTransport(hang))
        # real sleep: what is waited for would take half a minute
        chat = Server().chat(client=client, requests_per_minute=1 if state == "queued" else None)
        chat._sleep = chat._pacer._sleep = asyncio.sleep
        tasks = [asyncio.create_task(chat.complete(QUESTION)) for _ in range(3)]
        await asyncio.sleep(0.01)
        for task in tasks:
            task.cancel()
        done, pending = await asyncio.wait(tasks, timeout=5.0)
        assert not pending
        assert all(task.cancelled() for task in done)
        return chat

    chat = asyncio.run(main())
    assert chat._budget._held_tokens == 0
