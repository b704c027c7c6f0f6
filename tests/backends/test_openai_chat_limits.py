"""Rate limits are used up and never passed, budgets hold, and answers are kept."""

import asyncio
import json
import random
import sqlite3
from dataclasses import replace

import pytest
from fake_chat_http import QUESTION, Server, VirtualTime, refused, said
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.backends.chat_cache import FileCache, MemoryCache, content_key
from seo_slam.backends.chat_rates import Pacer, Quota
from seo_slam.errors import BudgetExceeded, ChatReplyError, ConfigError


def busiest(sent, window_s):
    """Most within any window, wherever it begins: ``sent`` is (time, amount)."""
    return max(sum(amount for t, amount in sent if start <= t < start + window_s) for start, _ in sent)


def ask_for(server, seconds, askers, text=lambda n: f"{n}", **options):
    """Ask from many sides until so much virtual time is over; the server's log of (time, tokens)."""
    chat = server.chat(**options)
    numbers = iter(range(10**6))

    async def asker():
        while server.time.now_s < seconds:
            await chat.complete(replace(QUESTION, text=text(next(numbers))))

    async def main():
        await asyncio.gather(*(asker() for _ in range(askers)))

    server.time.run(main())
    return chat


@pytest.mark.parametrize(("limit", "window_s", "latency_s"), [(60, 60.0, 1.0), (30, 6.0, 1.0), (8, 6.0, 0.3)])
def test_requests_are_spread_and_use_what_is_allowed(limit, window_s, latency_s):
    server = Server(latency_s=latency_s)
    chat = ask_for(server, 4 * window_s, 8, requests_per_minute=limit, window_s=window_s)
    sent = [(t, 1) for t in server.times_s if t < 4 * window_s]
    assert busiest(sent, window_s) <= limit
    assert len(sent) >= 0.95 * 4 * limit
    assert busiest(sent, window_s / 6) <= 0.3 * limit  # no burst: a sixth of the window has not much more than a sixth
    assert chat.usage().waited_s > window_s


@pytest.mark.parametrize(("limit", "window_s"), [(12_000, 60.0), (8_000, 6.0)])
def test_tokens_are_kept_under_the_limit_and_used_up(limit, window_s):
    draws = random.Random(3)

    def answer(body):
        prompt, completion = draws.randint(180, 220), draws.randint(40, 60)
        log.append((server.times_s[-1], prompt + completion))
        return said("ok", tokens=(prompt, completion))

    log = []
    server = Server(answer)
    ask_for(server, 5 * window_s, 8, tokens_per_minute=limit, window_s=window_s, text=lambda n: "x" * 600)
    assert busiest(log, window_s) <= limit
    assert sum(amount for t, amount in log if t < 5 * window_s) >= 0.95 * 5 * limit


def test_requests_that_were_refused_give_their_tokens_back():
    answers = [refused(503)] * 3 + [said(tokens=(10, 10))]
    server = Server(*answers)
    server.ask(tokens_per_minute=1000, deadline_s=50.0)
    assert server.times_s[-1] < 8.0


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 12),
    st.lists(st.tuples(st.floats(0, 3), st.integers(1, 400), st.floats(0, 1.2)), max_size=60),
    st.sampled_from([400.0, 1000.0]),
)
def test_no_window_ever_holds_more_than_the_limit(requests, questions, tokens):
    """Whatever comes when, and however wrong the estimates were on the high side."""
    requests_quota, tokens_quota = Quota(requests, 6.0), Quota(tokens, 6.0)
    now_s, log = 0.0, []
    for pause_s, amount, share in questions:
        now_s += pause_s
        while (wait_s := max(requests_quota.wait_s(1, now_s), tokens_quota.wait_s(amount, now_s))) > 1e-6:
            now_s += wait_s
        requests_quota.take(1, now_s)
        sent = tokens_quota.take(amount, now_s)
        used = amount * min(share, 1.0)
        tokens_quota.correct(sent, used)
        log.append((now_s, used))
    if log:
        assert busiest([(t, 1) for t, _ in log], 6.0) <= requests
        assert busiest(log, 6.0) <= tokens + 1e-6


def test_more_than_the_limit_at_once_goes_alone():
    time = VirtualTime()
    pacer = Pacer(None, 100, 6.0, time.clock, time.sleep)

    async def main():
        (await pacer.enter(10_000)).settle(90)
        await pacer.enter(100)
        return time.now_s

    assert 5.0 <= time.run(main()) <= 6.2


def test_a_place_that_is_left_is_free_again():
    time = VirtualTime()
    pacer = Pacer(1, None, 60.0, time.clock, time.sleep)

    async def main():
        (await pacer.enter(0)).leave()
        await pacer.enter(0)
        return time.now_s

    assert time.run(main()) < 1.0


def test_objects_of_one_process_keep_a_limit_together():
    server = Server()
    chats = [server.chat(requests_per_minute=6) for _ in range(3)]

    async def main():
        await asyncio.gather(*(chat.complete(QUESTION) for chat in chats * 4))

    server.time.run(main())
    assert busiest([(t, 1) for t in server.times_s], 60.0) <= 6
    assert server.times_s[-1] > 60.0


def test_waiting_for_own_limits_does_not_count_to_the_deadline():
    server = Server(said("1"), said("2"), refused(503), said("3"))  # the last one still has time for another try
    chat = server.chat(requests_per_minute=1, deadline_s=5.0)

    async def main():
        await asyncio.gather(*(chat.complete(QUESTION) for _ in range(3)))

    server.time.run(main())
    assert len(server.bodies) == 4
    assert server.times_s[-1] > 170.0


@pytest.mark.parametrize(
    ("options", "answered"),
    [
        ({"max_tokens_total": 1500}, (9, 12)),
        ({"max_cost": 0.003, "price_per_million": [10, 20]}, (1, 2)),
        ({"max_cost": 0.01, "price_per_million": [2.5, 10], "currency": "EUR"}, (15, 23)),
    ],
)
def test_a_budget_is_never_passed(options, answered):
    server = Server(said(tokens=(100, 20)))
    chat = server.chat(**options)

    async def main():
        for n in range(50):
            await chat.complete(replace(QUESTION, text=f"{n}", max_tokens=30))

    with pytest.raises(BudgetExceeded, match="chat budget") as caught:
        server.time.run(main())
    used = chat.usage()
    assert answered[0] <= used.requests <= answered[1]
    assert used.prompt_tokens + used.completion_tokens <= options.get("max_tokens_total", 1e9)
    assert used.cost <= options.get("max_cost", 0.0)
    assert options.get("currency", "") in str(caught.value)


def test_many_at_once_do_not_pass_the_budget_together():
    server = Server(said(tokens=(100, 30)), latency_s=1.0)
    chat = server.chat(max_tokens_total=1000)

    async def main():
        questions = (chat.complete(replace(QUESTION, text="x" * 400, max_tokens=30)) for _ in range(30))
        return await asyncio.gather(*questions, return_exceptions=True)

    outcomes = server.time.run(main())
    assert {type(outcome).__name__ for outcome in outcomes} == {"ChatReply", "BudgetExceeded"}
    assert chat.usage().prompt_tokens + chat.usage().completion_tokens <= 1000


def test_what_a_useless_reply_cost_counts():
    server = Server(said("", tokens=(70, 7)))
    chat = server.chat(price_per_million=[1000, 1000])
    with pytest.raises(ChatReplyError):
        server.time.run(chat.complete(QUESTION))
    used = chat.usage()
    assert (used.prompt_tokens, used.completion_tokens) == (70, 7)
    assert used.cost == pytest.approx(0.077)


@pytest.mark.parametrize("usage", [None, (-5, 10**9), ("7", 1.5), (True, None)])
def test_tokens_are_estimated_where_the_server_says_nothing_sensible(usage):
    reply = Server(said("x" * 400, tokens=usage)).ask(replace(QUESTION, text="x" * 4000))
    assert 1000 <= reply.prompt_tokens <= 2000
    assert 100 <= reply.completion_tokens <= 102


def test_the_same_question_is_asked_once():
    server = Server(said("a cup"), said("a dog"))
    chat = server.chat(cache=True, max_tokens_total=400)
    first, second = (server.time.run(chat.complete(QUESTION)) for _ in range(2))
    assert (second.text, second.cached, second.prompt_tokens, second.completion_tokens) == ("a cup", True, 0, 0)
    assert second.model == first.model == "m-1"
    assert (chat.usage().requests, chat.usage().cached) == (1, 1)
    server.time.run(chat.complete(QUESTION))  # a cached answer costs no budget


def test_whatever_the_answer_depends_on_is_in_the_key():
    image = b"\xff\xd8\xff1"
    question = replace(QUESTION, images=(image,), schema={"type": "object"}, turns=(("a", "b"),))
    changes = {
        "system": "x",
        "text": "x",
        "images": (image, image),
        "schema": None,
        "turns": (("a", "c"),),
        "temperature": 0.1,
        "max_tokens": 9,
    }
    keys = {content_key("m", replace(question, **{name: value})) for name, value in changes.items()}
    keys |= {content_key("m", question), content_key("n", question), content_key("m", replace(question, images=(b"\xff\xd8\xff2",)))}
    assert len(keys) == len(changes) + 3
    assert content_key("m", replace(question)) in keys


def test_a_file_of_answers_survives(tmp_path):
    path = tmp_path / "deep" / "answers.db"
    server = Server(said("a cup"), said("a dog"))
    first = server.chat(cache=str(path))
    server.time.run(first.complete(QUESTION))
    server.time.run(first.aclose())
    assert server.chat(cache=str(path)).name == "m"
    assert server.ask(cache=str(path)).cached
    assert server.time.run(first.complete(QUESTION)).cached  # opened again
    first._cache.close()


def test_bad_replies_are_not_kept():
    server = Server(said("", tokens=(1, 1)), said("prose"), said('{"word": "cup"}'))
    chat = server.chat(cache=True, reply_format="prompt")
    question = replace(QUESTION, schema={"type": "object"})
    with pytest.raises(ChatReplyError):
        server.time.run(chat.complete(question))
    texts = [server.time.run(chat.complete(question)).text for _ in range(3)]
    assert texts == ["prose", '{"word": "cup"}', '{"word": "cup"}']


def test_caches_are_bounded(tmp_path):
    memory = MemoryCache(most=2)
    for key in "abc":
        memory.put(key, key, "m")
        memory.get("a")
    assert [memory.get(key) is not None for key in "abc"] == [True, False, True]
    file = FileCache(tmp_path / "c.db", most=2)
    for key in "abc":
        file.put(key, key, "m")
    file.close()
    again = FileCache(tmp_path / "c.db", most=2)
    assert [again.get(key) for key in "abc"] == [None, ("b", "m"), ("c", "m")]
    again.close()


def test_a_file_that_is_no_cache_is_refused_and_one_that_breaks_is_left(tmp_path, caplog):
    (tmp_path / "notes.txt").write_text("this is no database, but long enough to look at" * 100)
    with pytest.raises(ConfigError, match=r"cache .*notes.txt: cannot be used"):
        FileCache(tmp_path / "notes.txt")
    with pytest.raises(ConfigError, match="cannot be used"):
        FileCache(tmp_path)
    cache = FileCache(tmp_path / "c.db")
    with sqlite3.connect(tmp_path / "c.db") as db:
        db.execute("DROP TABLE reply")
    db.close()
    cache.put("a", "b", "c")
    assert cache.get("a") is None
    assert len([record for record in caplog.records if "cannot be used any more" in record.message]) == 1
    cache.close()


def test_options_are_plain_json():
    options = {
        "model": "m",
        "base_url": "http://127.0.0.1:1/v1",
        "price_per_million": [1, 2],
        "max_cost": 3,
        "requests_per_minute": 4,
        "cache": False,
    }
    from seo_slam import registry
    from seo_slam.config import Component

    assert registry.create("chat_model", Component(name="openai", options=json.loads(json.dumps(options)))).name == "m"
