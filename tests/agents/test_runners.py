"""Inline, in the background, in recorded time: what is asked, what waits, and that nothing stays behind."""

import asyncio
import logging
import threading
import time

import numpy as np
import pytest
from a_view import CONFIRM, Scripted, landmark, trio, view

from seo_slam.agents.background import MOST_ANSWERS, BackgroundRunner
from seo_slam.agents.loop_thread import THREAD_NAME, LoopThread
from seo_slam.agents.runner import InlineRunner, VirtualTimeRunner
from seo_slam.config import RunnerSettings
from seo_slam.errors import AgentError, BudgetExceeded, ChatRequestError
from seo_slam.interfaces import Agent
from seo_slam.records import Confirm, Merge, Relabel, Remove

SOON_S = 5.0


class Slow(Scripted):
    """Answers after a while, or never; counts how many are asked at once."""

    def __init__(self, role="verification", most=1, seconds=0.0):
        super().__init__(role, most)
        self.seconds, self.now, self.most_at_once, self.cancelled = seconds, 0, 0, 0

    async def propose(self, seen):
        self.asked.append((seen.keyframe_id, seen.asked))
        self.now += 1
        self.most_at_once = max(self.most_at_once, self.now)
        try:
            await asyncio.sleep(self.seconds)
        except asyncio.CancelledError:
            self.cancelled += 1
            raise
        finally:
            self.now -= 1
        return self.edits(seen)


def settings(**changed):
    return RunnerSettings(view_period_s=0.0, **changed)


def ids_of(answers):
    return [edit.landmark_id for answer in answers for edit in answer.edits]


def ours():
    return [thread for thread in threading.enumerate() if thread.name == THREAD_NAME]


def test_inline_runs_the_chain_to_its_end_without_a_thread():
    runner = InlineRunner(trio(), settings())
    runner.show(view([landmark(0), landmark(1, x_m=0.1)]))
    assert [answer.query.agent.role for answer in runner.poll(0.0)] == ["verification", "description", "description", "merging"]
    assert runner.poll(0.0) == []
    assert ours() == []
    assert runner.close()


def test_inline_awaits_asynchronous_agents_also_inside_a_running_loop():
    async def inside():
        runner = InlineRunner([Slow()], settings())
        runner.show(view([landmark(0)]))
        found = ids_of(runner.poll(0.0))
        assert runner.close()
        return found

    assert asyncio.run(inside()) == [0]
    assert ours() == []


def test_views_are_wanted_at_the_pace_set():
    runner = InlineRunner(trio(), RunnerSettings(view_period_s=0.5))
    assert runner.wants_view(0.0)
    runner.show(view([landmark(0)], 0, stamp_s=0.0))
    assert not runner.wants_view(0.4)
    assert runner.wants_view(0.5)
    assert runner.wants_view(-3.0)  # the clock began anew
    assert not InlineRunner([], RunnerSettings()).wants_view(0.0)


def test_the_background_waits_for_nobody_and_keeps_to_its_number():
    agent = Slow(seconds=0.02)
    runner = BackgroundRunner([agent], settings(in_flight=3))
    try:
        runner.show(view([landmark(i) for i in range(10)]))
        early = ids_of(runner.poll(0.0))
        assert len(early) < 10  # returns at once, whatever is there
        assert sorted(early + ids_of(runner.drain(SOON_S))) == list(range(10))
        assert agent.most_at_once == 3
    finally:
        assert runner.close()
    assert ours() == []


def test_drain_brings_every_answer():
    runner = BackgroundRunner(trio(), settings())
    runner.show(view([landmark(i) for i in range(5)]))
    answers = runner.drain(SOON_S)
    assert sorted({landmark_id for answer in answers for landmark_id in answer.query.view.asked}) == [0, 1, 2, 3, 4]
    assert runner.counts()["landmarks_done"] == 5
    assert runner.close()


def test_what_an_answer_calls_for_is_thought_ahead_in_the_agents_thread():
    threads = []

    def think(answer):
        threads.append(threading.current_thread().name)
        raise ValueError("no such model")

    runner = BackgroundRunner([Slow()], settings(), think)
    try:
        runner.show(view([landmark(0), landmark(1)]))
        assert sorted(ids_of(runner.drain(SOON_S))) == [0, 1]  # an answer is not lost by it
    finally:
        assert runner.close()
    assert threads == [THREAD_NAME] * 2


def test_the_newest_view_wins_while_all_are_busy():
    agent = Slow(seconds=0.05)
    runner = BackgroundRunner([agent], settings(in_flight=1))
    for keyframe in range(20):
        runner.show(view([landmark(0)], keyframe))
    runner.drain(SOON_S)
    runner.close()
    assert agent.asked[-1] == (19, (0,))
    assert len(agent.asked) <= 3


@pytest.mark.parametrize("mode", [InlineRunner, BackgroundRunner, VirtualTimeRunner])
def test_an_agent_that_fails_is_a_problem_of_its_answer(mode):
    class Broken(Agent):
        role = "verification"

        def propose(self, seen):
            raise {0: AgentError("no reply"), 1: KeyError("box 7")}[seen.keyframe_id]

    runner = mode([Broken(), Scripted("any")], settings(latency_s=0.0))
    problems = []
    for keyframe in range(2):
        runner.show(view([landmark(0)], keyframe))
        problems += [answer.problem for answer in runner.drain(SOON_S) if answer.problem]
    runner.close()
    assert problems == ["agent Broken: no reply", "agent Broken: KeyError: 'box 7'"]
    assert runner.counts()["agents"][0]["failed"] == 2
    assert runner.counts()["agents"][1]["answered"] == 2


@pytest.mark.parametrize("error", [BudgetExceeded("1000 of 1000 tokens are spent"), ChatRequestError("the key is refused", permanent=True)])
def test_an_agent_whose_asking_is_of_no_use_is_asked_no_more(error):
    class Spent(Scripted):
        def propose(self, seen):
            self.asked.append(seen)
            raise error

    agent, other = Spent("verification", 4), Scripted("any")
    runner = InlineRunner([agent, other], settings())
    for keyframe in range(3):
        runner.show(view([landmark(0)], keyframe))
    assert len(agent.asked) == 1
    assert len(other.asked) == 3
    assert str(error) in runner.counts()["agents"][0]["stopped"]


def test_edits_of_what_was_not_shown_are_taken_out():
    def meddle(seen, i):
        return Remove(i + 100, 0)

    runner = InlineRunner([Scripted("verification", 4, meddle)], settings())
    runner.show(view([landmark(0)]))
    (answer,) = runner.poll(0.0)
    assert answer.edits == ()
    assert "not shown" in answer.problem


@pytest.mark.parametrize("reply", [None, "remove 0", 3, [Confirm(0, 0), "remove all"]])
def test_an_answer_that_is_no_list_of_edits_changes_nothing(reply):
    class Odd(Agent):
        def propose(self, seen):
            return reply

    runner = InlineRunner([Odd()], settings())
    runner.show(view([landmark(0)]))
    (answer,) = runner.poll(0.0)
    assert answer.problem
    assert all(isinstance(edit, Confirm) for edit in answer.edits)


UNSOUND = {
    "no version": Confirm(0, None),
    "a version in words": Relabel(0, "1", "cup"),
    "a version between": Confirm(0, 0.0),
    "a truth for a version": Confirm(0, False),
    "an id in words": Remove("0", 0),
    "an id that has no hash": Remove([0], 0),
    "half a pair": Merge(0, 0, None, 0),
    "no label": Relabel(0, 0, None),
    "a list of categories": Relabel(0, 0, "cup", category=["cup"]),
    "a source that is no text": Confirm(0, 0, source=object()),
}


@pytest.mark.parametrize("edit", UNSOUND.values(), ids=UNSOUND)
def test_an_edit_with_something_else_in_place_of_numbers_or_texts_is_taken_out_and_the_others_stay(edit):
    class Odd(Agent):
        def propose(self, seen):
            return [edit, Confirm(0, 0)]

    runner = InlineRunner([Odd()], settings())
    runner.show(view([landmark(0)]))
    (answer,) = runner.poll(0.0)
    assert answer.edits == (Confirm(0, 0),)
    assert answer.problem.startswith("agent Odd: proposed what is no edit, wanted")


def test_numbers_of_numpy_become_plain_ones_and_texts_such_that_files_can_hold_them():
    class Odd(Agent):
        name = "half \ud800 a pair"

        def propose(self, seen):
            ids, versions = seen.landmarks.ids, seen.landmarks.versions
            return [Relabel(ids[0], versions[0], np.str_("cup"), source="\ud800"), Merge(ids[0], versions[0], ids[1], versions[1])]

    runner = InlineRunner([Odd()], settings())
    runner.show(view([landmark(0), landmark(1)]))
    (answer,) = runner.poll(0.0)
    assert answer.edits == (Relabel(0, 0, "cup", source="\\ud800"), Merge(0, 0, 1, 0))
    assert {type(value) for edit in answer.edits for value in (getattr(edit, name) for name in edit.__slots__)} == {int, str}
    assert answer.proposals[0].agent == "half \\ud800 a pair"
    assert answer.problem == ""


def test_in_virtual_time_an_answer_counts_so_many_seconds_later():
    agent = Scripted("verification", 1, CONFIRM)
    runner = VirtualTimeRunner([agent], settings(latency_s=1.5, in_flight=2))
    runner.show(view([landmark(i) for i in range(3)], 0, stamp_s=10.0))
    assert runner.poll(11.4) == []
    assert ids_of(runner.poll(11.5)) == [0, 1]
    assert runner.poll(12.9) == []
    assert ids_of(runner.poll(13.0)) == [2]  # two at once: the third is asked when the first is answered
    assert runner.close()


def test_virtual_time_gives_the_same_whenever_it_is_polled():
    def answers(stamps):
        runner = VirtualTimeRunner(trio(), settings(latency_s=0.4, in_flight=2))
        found = []
        for keyframe, stamp_s in enumerate((0.0, 0.5, 1.0)):
            found += runner.poll(stamp_s)
            runner.show(view([landmark(i) for i in range(4)], keyframe, stamp_s=stamp_s))
            for more_s in stamps:
                found += runner.poll(stamp_s + more_s)
        return [(a.query.number, a.query.agent.role, a.query.view.asked) for a in (*found, *runner.drain(60.0))]

    assert answers(()) == answers((0.1, 0.2, 0.45))


def test_closing_ends_the_thread_in_time_with_many_questions_hanging():
    agent = Slow(seconds=3600.0)
    runner = BackgroundRunner([agent], settings(in_flight=64))
    runner.show(view([landmark(i) for i in range(64)]))
    deadline = time.monotonic() + SOON_S
    while agent.now < 64 and time.monotonic() < deadline:
        time.sleep(0.005)
    assert agent.now == 64
    assert runner.close()  # True: within shutdown_s
    assert agent.cancelled == 64
    assert ours() == []
    runner.show(view([landmark(0)], 1))  # a closed runner takes no more, and starts no thread
    assert ours() == []


def test_a_background_runner_works_inside_a_running_loop():
    async def inside():
        runner = BackgroundRunner([Slow()], settings())
        runner.show(view([landmark(0)]))
        found = ids_of(await asyncio.to_thread(runner.drain, SOON_S))
        assert runner.close()
        return found

    assert asyncio.run(inside()) == [0]


def test_what_cancelled_work_starts_is_cancelled_too():
    began, started = threading.Event(), []

    async def work():
        began.set()
        try:
            await asyncio.sleep(60.0)
        finally:
            started.append(asyncio.ensure_future(asyncio.sleep(60.0)))

    thread = LoopThread()
    thread.submit(work())
    assert began.wait(SOON_S)
    assert thread.stop(SOON_S)
    assert started[0].cancelled()


def test_a_loop_thread_may_be_stopped_twice_and_used_again():
    thread = LoopThread()
    assert thread.stop()
    assert thread.wait_for(asyncio.sleep(0, "done")) == "done"
    assert thread.stop()
    assert thread.stop()
    assert ours() == []


class UnspeakableError(Exception):
    def __str__(self):
        raise ValueError("no words")


class Breaks(Agent):
    """Raises what is no exception, first at once, then where it waits."""

    role = "verification"

    def __init__(self, error):
        self.error = error

    def propose(self, seen):
        async def later():
            await asyncio.sleep(0)
            raise self.error

        async def through_a_task_of_its_own():
            await asyncio.ensure_future(later())

        if seen.keyframe_id == 0:
            raise self.error
        return later() if seen.keyframe_id == 1 else through_a_task_of_its_own()


@pytest.mark.parametrize(
    "error", [SystemExit(3), asyncio.CancelledError(), UnspeakableError(), KeyError("half \ud800")], ids=lambda error: type(error).__name__
)
@pytest.mark.parametrize("mode", [InlineRunner, BackgroundRunner, VirtualTimeRunner])
def test_whatever_an_agent_raises_is_a_problem_of_its_answer_and_the_others_go_on(mode, error):
    other = Slow("any")
    runner = mode([Breaks(error), other], settings(latency_s=0.0))
    answers = []
    for keyframe in range(3):
        runner.show(view([landmark(0)], keyframe))
        answers += runner.drain(SOON_S)
    problems = [answer.problem for answer in answers if answer.problem]
    assert len(problems) == 3
    assert all(problem.startswith("agent Breaks: ") and problem.encode() for problem in problems)
    assert runner.out == 0
    assert len(other.asked) == 3
    assert runner.close()
    assert ours() == []


def test_in_the_background_an_interrupt_that_an_agent_raises_is_its_own():
    runner = BackgroundRunner([Breaks(KeyboardInterrupt())], settings())
    for keyframe in range(3):
        runner.show(view([landmark(0)], keyframe))
        (answer,) = runner.drain(SOON_S)
        assert answer.problem == "agent Breaks: KeyboardInterrupt"
    assert runner.close()


def test_inline_an_interrupt_is_the_users():
    runner = InlineRunner([Breaks(KeyboardInterrupt())], settings())
    with pytest.raises(KeyboardInterrupt):
        runner.show(view([landmark(0)]))
    assert runner.close()


def test_an_agent_that_cancels_its_own_question_has_failed():
    class GivesUp(Agent):
        async def propose(self, seen):
            asyncio.current_task().cancel()
            await asyncio.sleep(60.0)

    runner = BackgroundRunner([GivesUp()], settings())
    runner.show(view([landmark(0)]))
    (answer,) = runner.drain(SOON_S)
    assert answer.problem == "agent GivesUp: CancelledError: the agent cancelled its question"
    assert runner.out == 0
    assert runner.close()


def test_an_agent_that_cancels_its_question_when_it_is_answered_has_answered_once():
    class TooLate(Agent):
        def propose(self, seen):
            asyncio.current_task().cancel()
            return [Confirm(0, 0)]

    runner = BackgroundRunner([TooLate()], settings())
    runner.show(view([landmark(0)]))
    assert ids_of(runner.drain(SOON_S)) == [0]
    assert runner.out == 0
    assert runner.close()


def test_answers_that_nobody_collects_are_counted():
    agent = Scripted("verification", 1, CONFIRM)
    runner = BackgroundRunner([agent], settings(queue=2 * MOST_ANSWERS))
    runner.show(view([landmark(i) for i in range(MOST_ANSWERS + 10)]))
    told, *kept = runner.drain(60.0)
    assert told.problem.startswith("agents: 10 answers are lost")
    assert told.edits == ()
    assert sorted(ids_of(kept)) == [edit_id for _, (edit_id,) in agent.asked[10:]]
    runner.show(view([landmark(0)], 1))
    assert [answer.problem for answer in runner.drain(SOON_S)] == [""]  # once
    assert runner.close()


def test_closing_names_the_agent_that_keeps_the_thread_and_draining_does_not_wait_for_it(caplog):
    began, release = threading.Event(), threading.Event()

    class Blocks(Agent):
        def propose(self, seen):
            began.set()
            release.wait(SOON_S)
            return []

    runner = BackgroundRunner([Blocks()], settings(shutdown_s=0.05))
    runner.show(view([landmark(0)]))
    assert began.wait(SOON_S)
    (thread,) = ours()
    try:
        with caplog.at_level(logging.WARNING):
            assert not runner.close()
        assert "not ended within 0.05 s, still thinking: Blocks" in caplog.text
        started = time.monotonic()
        assert runner.drain(600.0) == []
        assert time.monotonic() - started < 60.0
    finally:
        release.set()
        thread.join(SOON_S)
    assert ours() == []


class CountsWrongly(Scripted):
    def __init__(self, usage):
        super().__init__("any")
        self.usage = usage


def fails():
    raise ValueError("no counter")


@pytest.mark.parametrize(
    ("usage", "told"),
    [
        (lambda: {"requests": 3, "cost": 0.5}, {"requests": 3, "cost": 0.5}),
        ({"requests": 3, "server": object(), "cost": float("nan")}, {"requests": 3}),
        (lambda: {}, None),
        (fails, None),
        (7, None),
    ],
)
def test_what_an_agent_used_is_told_as_far_as_a_file_can_hold_it(usage, told):
    runner = InlineRunner([CountsWrongly(usage)], settings())
    assert runner.counts()["agents"][0].get("usage") == told
