"""Each fault of the chat server, as a client sees it."""

import json
import urllib.error
from email.utils import parsedate_to_datetime

import httpx
import pytest
from chat_asking import DESCRIBED, MERGED, MERGING, RIGHT, VERIFICATION, ask_many, body, post, said

from seo_slam.errors import ConfigError
from seo_slam.testing import (
    BadStatus,
    ChatServer,
    Cut,
    Dies,
    Empty,
    Fault,
    Fenced,
    Huge,
    NotJson,
    RateLimited,
    Refusal,
    RefusedKey,
    ServerError,
    Sometimes,
    WrongJson,
)
from seo_slam.testing.chat_reply import WireReply


def struck(fault, reply=RIGHT):
    with ChatServer([reply], faults=fault) as server:
        return post(server)


@pytest.mark.parametrize(
    ("fault", "status"),
    [
        (RateLimited(), 429),
        (ServerError(), 500),
        (ServerError(502), 502),
        (ServerError(503), 503),
        (RefusedKey(), 401),
        (BadStatus(), 400),
        (BadStatus(418), 418),
    ],
)
def test_statuses(fault, status):
    got, _, reply = struck(fault)
    assert got == status
    assert reply["error"]["code"] == status
    assert reply["error"]["message"]


def test_retry_after_is_a_number_a_date_or_missing():
    assert struck(RateLimited(2.5))[1]["Retry-After"] == "2.5"
    assert struck(RateLimited(None))[1]["Retry-After"] is None
    _, headers, _ = struck(RateLimited(90.0, as_date=True))
    ahead = parsedate_to_datetime(headers["Retry-After"]) - parsedate_to_datetime(headers["Retry-After"]).now().astimezone()
    assert 60 < ahead.total_seconds() <= 90


def test_a_cut_reply_says_so_and_a_cut_connection_does_not_come_whole():
    _, _, reply = struck(Cut(0.5))
    assert reply["choices"][0]["finish_reason"] == "length"
    assert said(reply) == RIGHT[: len(RIGHT) // 2]
    with ChatServer([RIGHT], faults=Cut(connection=True)) as server:
        (broken,) = ask_many(server, 1)
    assert isinstance(broken, httpx.RemoteProtocolError)
    assert "incomplete" in str(broken) or "without sending complete" in str(broken)


def test_prose_and_fences():
    with pytest.raises(ValueError, match="Expecting value"):
        json.loads(said(struck(NotJson())[2]))
    fenced = said(struck(Fenced())[2])
    assert f"```json\n{RIGHT}\n```" in fenced


def test_refusals_and_silence():
    message = struck(Refusal("no"))[2]["choices"][0]["message"]
    assert (message["content"], message["refusal"]) == (None, "no")
    assert said(struck(Empty())[2]) is None
    assert said(struck(Empty("text"))[2]) == ""
    message = struck(Empty("reasoning"))[2]["choices"][0]["message"]
    assert message["content"] == ""
    assert message["reasoning_content"]


def test_far_too_much_text():
    assert len(said(struck(Huge())[2])) == 10_000_000
    inside = json.loads(said(struck(Huge(100_000, inside=True))[2]))
    assert [verdict["box"] for verdict in inside["verdicts"]] == [1, 2]
    assert sum(len(verdict["object"]) for verdict in inside["verdicts"]) == 100_000


WRONG = {
    "list": [json.loads(RIGHT)] * 2,
    "missing": {"verdicts": [{"box": 1, "object": "cup"}, {"box": 2, "object": "N/A"}]},
    "unknown_boxes": {"verdicts": [{"box": 97, "object": "cup", "score": 1.0}, {"box": 98, "object": "N/A", "score": -1.0}]},
    "coordinates": {
        "verdicts": [{"box": [0.25, 1.5, 0.75], "object": "cup", "score": 1.0}, {"box": [0.5, 1.5, 0.75], "object": "N/A", "score": -1.0}]
    },
    "ids_as_text": {
        "verdicts": [{"box": "landmark 1", "object": "cup", "score": 1.0}, {"box": "landmark 2", "object": "N/A", "score": -1.0}]
    },
    "out_of_range": {"verdicts": [{"box": 1e9, "object": "cup", "score": 1e9}, {"box": 1e9, "object": "N/A", "score": 1e9}]},
}


@pytest.mark.parametrize("kind", WRONG)
def test_json_that_was_not_asked_for(kind):
    assert json.loads(said(struck(WrongJson(kind))[2])) == WRONG[kind]


@pytest.mark.parametrize("reply", [RIGHT, MERGED, DESCRIBED, '{"duplicates": []}', "no JSON"])
@pytest.mark.parametrize("kind", ["shape", *WRONG, "long"])
def test_wrong_json_is_json_for_every_agent(kind, reply):
    with ChatServer([reply], faults=WrongJson(kind) if kind != "long" else Huge(1000, inside=True)) as server:
        wrong = said(post(server)[2])
    if reply in (RIGHT, MERGED, DESCRIBED) and not (kind in ("out_of_range", "long") and reply in (DESCRIBED, MERGED)):
        assert json.loads(wrong) != json.loads(reply)
    assert json.loads(wrong) is not None


def test_merged_boxes_are_made_wrong_too():
    assert json.loads(said(struck(WrongJson("unknown_boxes"), MERGED)[2])) == {"duplicates": [{"boxes": [97, 99], "best": 99}]}
    assert json.loads(said(struck(WrongJson("missing"), MERGED)[2])) == {"duplicates": [{"boxes": [1, 3]}]}


def test_a_server_that_dies_stays_dead():
    with ChatServer(["x"], faults=Dies(after=2)) as server:
        assert [post(server)[0] for _ in range(2)] == [200, 200]
        with pytest.raises((urllib.error.URLError, ConnectionError)):
            post(server)
        with pytest.raises((urllib.error.URLError, ConnectionError)):
            post(server)
    assert [seen.status for seen in server.requests] == [200, 200, 0]


def test_faults_strike_every_nth_the_first_few_or_a_share():
    def statuses(fault, count=12, seed=0):
        with ChatServer(["x"], faults=fault, seed=seed) as server:
            return [post(server)[0] for _ in range(count)]

    assert statuses(Sometimes(ServerError(), every=3), 6) == [200, 200, 500, 200, 200, 500]
    assert statuses(Sometimes(ServerError(), first=2), 4) == [500, 500, 200, 200]
    drawn = statuses(Sometimes(ServerError(), share=0.5), 40)
    assert 10 <= drawn.count(500) <= 30
    assert drawn == statuses(Sometimes(ServerError(), share=0.5), 40)
    assert drawn != statuses(Sometimes(ServerError(), share=0.5), 40, seed=1)
    assert statuses(Sometimes(ServerError(), share=0.0), 3) == [200] * 3


def test_faults_can_be_for_one_agent_and_the_first_that_strikes_counts():
    faults = (Sometimes(NotJson("prose"), role="verification"), ServerError(503))
    with ChatServer([RIGHT], faults=faults) as server:
        assert said(post(server, body(VERIFICATION))[2]) == "prose"
        assert post(server, body(MERGING))[0] == 503


def test_faults_among_the_answers_and_unspoilt_answers_after_them():
    with ChatServer([RateLimited(1.0), Refusal(), "fine"]) as server:
        assert [post(server)[0] for _ in range(4)] == [429, 200, 200, 200]
    with ChatServer(["one", "two"], faults=Sometimes(ServerError(), first=1)) as server:
        assert [post(server)[0], said(post(server)[2]), said(post(server)[2])] == [500, "one", "two"]


def test_a_fault_of_ones_own():
    class Shouting(Fault):
        def spoil(self, request, proper):
            return WireReply((proper().text or "").upper())

    assert said(struck(Shouting(), "quiet")[2]) == "QUIET"


@pytest.mark.parametrize("options", [{"every": 0}, {"share": 1.5}, {"share": -0.1}])
def test_impossible_conditions_are_refused(options):
    with pytest.raises(ConfigError):
        Sometimes(ServerError(), **options)
