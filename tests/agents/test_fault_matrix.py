"""Everything that can go wrong with a chat server, for each agent, over the whole system: the run ends, and the map is right or as it was.

A real pipeline asks real agents, they ask a real server over a socket; the fault strikes the questions of one agent only.
"""

import re
from dataclasses import dataclass
from functools import cache

import pytest
import trusting_room as room

from seo_slam.map import Map
from seo_slam.testing import (
    BadStatus,
    Cut,
    Dies,
    Empty,
    Fenced,
    Hang,
    Huge,
    NotJson,
    RateLimited,
    Refusal,
    RefusedKey,
    ServerError,
    Sometimes,
    WrongJson,
)


@dataclass(frozen=True)
class Case:
    """What is to come of a fault.

    Attributes:
        said: what the warning is to say; "" where the question is answered all the same.
        harmless: the agent does its work in spite of it.
    """

    fault: object
    said: str = ""
    harmless: bool = False


USELESS = "asked twice, and got no reply of any use"
CASES = {
    "429 with Retry-After": Case(RateLimited(30.0), "HTTP 429: too many requests|takes no questions for another"),
    "429 with a date": Case(RateLimited(30.0, as_date=True), "HTTP 429|takes no questions for another"),
    "429 without": Case(RateLimited(None), "HTTP 429: too many requests|takes no questions for another"),
    "500": Case(ServerError(500), "HTTP 500: the server had an error"),
    "502": Case(ServerError(502), "HTTP 502"),
    "503": Case(ServerError(503), "HTTP 503"),
    "hangs": Case(Hang(), r"no complete answer within 0\.\d+ s"),
    "cut text": Case(Cut(0.5), USELESS),
    "cut connection": Case(Cut(0.5, connection=True), "closed connection|incomplete"),
    "not JSON": Case(NotJson(), f"{USELESS}: it holds no JSON object"),
    "shape": Case(WrongJson("shape"), USELESS),
    "a list": Case(WrongJson("list"), ""),
    "missing": Case(WrongJson("missing"), ""),
    "unknown boxes": Case(WrongJson("unknown_boxes"), ""),
    "coordinates": Case(WrongJson("coordinates"), ""),
    "ids as text": Case(WrongJson("ids_as_text"), ""),
    "out of range": Case(WrongJson("out_of_range"), ""),
    "refuses": Case(Refusal(), f"{USELESS}.*refuse"),
    "null": Case(Empty("null"), f"{USELESS}.*empty"),
    "empty": Case(Empty("text"), f"{USELESS}.*empty"),
    "reasoning only": Case(Empty("reasoning"), f"{USELESS}.*thought and said nothing"),
    "10 MB": Case(Huge(), f"{USELESS}.*longer than"),
    "10 MB inside": Case(Huge(inside=True), ""),
    "refused key": Case(RefusedKey(), "HTTP 401.*refuses the key"),
    "no right": Case(BadStatus(403, "not for you"), "HTTP 403"),
    "no such model": Case(BadStatus(404, "no such model"), "HTTP 404.*model's name"),
    "400": Case(BadStatus(400), "HTTP 400: the request is not understood"),
    "fenced": Case(Fenced(), harmless=True),
    "one in two": Case(Sometimes(NotJson(), every=2), harmless=True),
}


@cache
def undisturbed():
    """The room as it is mapped without agents, and with agents that nothing disturbs."""
    return room.plain_run().map, room.run_with(room.RIGHT_ANSWERS).result.map


def things(of_map):
    return {row.id: (row.label, row.category) for row in (*of_map.landmarks, *of_map.tentative)}


def require_unchanged_or_right(result):
    """Every thing is as without agents, or as it should be."""
    without, right = (things(each) for each in undisturbed())
    found = things(result.map)
    assert found.keys() <= without.keys()
    assert {i for i in without if i not in found} <= {room.CARTON}
    for landmark_id, words in found.items():
        assert words in (without[landmark_id], right.get(landmark_id, without[landmark_id]))


def require_valid(result, folder):
    result.map.save(folder)
    assert things(Map.load(folder)) == things(result.map)


def require_counts(result):
    for agent in result.agents["agents"]:
        assert agent["asked"] == agent["answered"] + agent["failed"]
        assert sum(agent["problems"].values()) == agent["failed"]
        assert set(agent["problems"]) <= set(result.warnings)
    judged = sum(row["number"] for row in result.agents["edits"])
    assert judged == sum(agent["proposed"] for agent in result.agents["agents"])


def test_the_right_answers_mend_the_room():
    without, right = (things(each) for each in undisturbed())
    assert without == {0: ("cup", ""), 1: ("vase", ""), 2: ("book", ""), 3: ("carton", "")}
    assert right == {0: ("cup", ""), 1: ("green jug", "jug"), 2: ("book", "")}


@pytest.mark.parametrize("role", room.ROLES)
@pytest.mark.parametrize("name", CASES)
def test_each_fault_for_each_agent(name, role, tmp_path):
    require_all_is_well(name, role, "inline", tmp_path)


@pytest.mark.parametrize("role", room.ROLES)
@pytest.mark.parametrize("name", ["hangs", "429 with Retry-After", "not JSON", "refused key", "cut connection"])
def test_the_same_in_the_background(name, role, tmp_path):
    require_all_is_well(name, role, "background", tmp_path)


def require_all_is_well(name, role, mode, folder):
    case = CASES[name]
    fault = case.fault if case.harmless and isinstance(case.fault, Sometimes) else Sometimes(case.fault, role=role)
    ran = room.run_with(room.RIGHT_ANSWERS, fault, mode=mode, hasty=role if name == "hangs" else None)
    result = ran.result
    assert result.frames == room.FRAMES
    require_unchanged_or_right(result)
    require_valid(result, folder)
    require_counts(result)
    struck = next(agent for agent in result.agents["agents"] if agent["role"] == role)
    assert struck["asked"] > 0 or role == "merging"
    assert len(result.warnings) <= 5
    if case.said and struck["asked"]:
        assert struck["failed"] == struck["asked"]
        assert struck["proposed"] == 0
        for message in result.warnings:
            assert message.startswith(f"agent {role}: ")
            assert re.search(case.said, message), message
    if case.harmless:
        assert things(result.map) == things(undisturbed()[1])


@pytest.mark.parametrize("mode", ["inline", "background"])
@pytest.mark.parametrize("after", [0, 2, 4])
def test_a_server_that_dies_ends_no_run(after, mode, tmp_path):
    result = room.run_with(room.RIGHT_ANSWERS, Dies(after), mode=mode).result
    assert result.frames == room.FRAMES
    require_unchanged_or_right(result)
    require_valid(result, tmp_path)
    require_counts(result)
    assert sum(agent["answered"] for agent in result.agents["agents"]) <= after
    assert any("connect" in message.lower() for message in result.warnings)
    assert len(result.warnings) <= 12


@pytest.mark.parametrize("fails_open", [False, True])
@pytest.mark.parametrize("supports", ["json_schema", "json_object", "prompt"])
def test_what_a_server_cannot_do_is_found_out_and_done_without(supports, fails_open):
    found = room.run_with(room.RIGHT_ANSWERS, supports=supports, fails_open=fails_open, options={"reply_format": "auto"}).result
    assert things(found.map) == things(undisturbed()[1])
    assert found.warnings == {}


def test_a_server_that_ignores_the_schema_it_was_said_to_hold_to_is_understood_all_the_same():
    found = room.run_with(room.RIGHT_ANSWERS, supports="prompt", fails_open=True).result  # "json_schema" by our own word
    assert things(found.map) == things(undisturbed()[1])


@pytest.mark.parametrize("mode", ["inline", "background"])
def test_when_the_budget_is_spent_agents_stop_once_and_slam_goes_on(mode):
    ran = room.run_with(room.RIGHT_ANSWERS, mode=mode, options={"max_tokens_total": 3000})
    result = ran.result
    assert result.frames == room.FRAMES
    assert result.keyframes == room.FRAMES // 2
    require_unchanged_or_right(result)
    require_counts(result)
    stopped = [agent for agent in result.agents["agents"] if agent["stopped"]]
    assert any(agent["answered"] for agent in result.agents["agents"])
    assert any("spent" in agent["stopped"] or "budget" in agent["stopped"] for agent in stopped)
    for agent in stopped:
        assert result.warnings[agent["stopped"]] == agent["failed"] == 1


def test_a_refused_key_is_told_once_an_agent():
    result = room.run_with(room.RIGHT_ANSWERS, RefusedKey()).result
    require_unchanged_or_right(result)
    assert [(agent["asked"], agent["failed"]) for agent in result.agents["agents"]] == [(1, 1), (1, 1), (0, 0)]
    assert list(result.warnings.values()) == [1, 1]
