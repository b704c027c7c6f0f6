"""Rate limits of the chat server, and how its log proves that they were kept."""

import asyncio

import pytest
from chat_asking import ask, body, client, post
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.testing import ChatServer, Seen, most_requests, most_tokens
from seo_slam.testing.chat_limits import SlidingLimit


def test_more_requests_than_the_limit_are_refused_and_say_when_to_come_back():
    with ChatServer(["x"], requests_per_minute=3, window_s=60.0) as server:
        replies = [post(server) for _ in range(5)]
    assert [status for status, _, _ in replies] == [200, 200, 200, 429, 429]
    assert [headers["x-ratelimit-remaining-requests"] for _, headers, _ in replies] == ["2", "1", "0", "0", "0"]
    assert replies[0][1]["Retry-After"] is None
    assert 30 < int(replies[3][1]["Retry-After"]) <= 60
    assert "3 requests in 60 s" in replies[3][2]["error"]["message"]
    assert most_requests(server.requests) == 3


def test_retry_after_can_be_left_out():
    with ChatServer(["x"], requests_per_minute=1, retry_after=False) as server:
        replies = [post(server) for _ in range(2)]
    assert replies[1][0] == 429
    assert "Retry-After" not in replies[1][1]


def test_tokens_are_let_in_by_prompt_and_max_tokens_and_counted_by_what_was_said():
    with ChatServer(["abcd" * 20], tokens_per_minute=200) as server:
        replies = [post(server, body(max_tokens=100)) for _ in range(4)]
        asked_and_said = replies[0][2]["usage"]["total_tokens"]
        assert asked_and_said < 40
        # a third one has room for its prompt and 100 tokens of reply; a fourth has not
        assert [status for status, _, _ in replies] == [200, 200, 200, 429]
        status, headers, _ = post(server, body(max_tokens=5000))
    assert status == 429
    assert "Retry-After" not in headers  # waiting is of no use
    assert most_tokens(server.requests) == 3 * asked_and_said <= 200


def test_the_window_slides():
    async def run():
        with ChatServer(["x"], requests_per_minute=5, window_s=1.0) as server:
            async with client() as made:
                while sum(seen.status == 200 for seen in server.requests) < 8:
                    await ask(made, server)
                    await asyncio.sleep(0.005)
        return server.requests

    seen = asyncio.run(run())
    assert {entry.status for entry in seen} == {200, 429}
    assert most_requests(seen, 1.0) == 5


times = st.lists(st.floats(0, 20), min_size=1, max_size=40).map(sorted)


@given(times, st.integers(1, 5))
def test_a_limit_never_lets_more_through_in_any_window(times_s, most):
    limit = SlidingLimit("requests", most, 3.0)
    let_in = []
    for now_s in times_s:
        wait_s = limit.wait_s(now_s, 1)
        if not wait_s:
            limit.use(now_s, 1)
            let_in.append(now_s)
        else:
            assert len([before for before in let_in if before > now_s - 3.0]) == most  # it was full
            later = SlidingLimit("requests", most, 3.0)
            for before in let_in:
                later.use(before, 1)
            assert later.wait_s(now_s + wait_s + 1e-6, 1) == 0.0  # and is not, when it says
    busiest = max(sum(start <= at < start + 3.0 for at in let_in) for start in let_in)
    seen = [Seen(k, at, "", "", 2, 3, 200, 0.0) for k, at in enumerate(let_in)]
    assert most_requests(seen, 3.0) == busiest <= most
    assert most_tokens(seen, 3.0) == 5 * busiest


def test_refused_requests_do_not_count():
    seen = [Seen(k, 0.1 * k, "", "", 0, 0, status, 0.0) for k, status in enumerate([200, 429, 429, 500, 0])]
    assert most_requests(seen) == 3
    assert most_requests([]) == most_tokens([]) == 0


@pytest.mark.parametrize("most", [None, 2])
def test_no_limit_is_no_limit(most):
    with ChatServer(["x"], requests_per_minute=most) as server:
        statuses = [post(server)[0] for _ in range(4)]
    assert statuses.count(429) == (0 if most is None else 2)
