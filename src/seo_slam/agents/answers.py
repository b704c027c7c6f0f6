"""What came back from agents, on its way to the map."""

import asyncio
import inspect
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from seo_slam.agents.chain import Query
from seo_slam.agents.loop_thread import LoopThread
from seo_slam.agents.message_tally import MessageTally
from seo_slam.agents.reply_text import encodable
from seo_slam.errors import AgentError, BudgetExceeded, ChatRequestError
from seo_slam.records import Confirm, Doubt, Edit, Merge, Proposal, Relabel, Remove


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """The end of a question.

    Attributes:
        query: what was asked.
        edits: what was proposed; empty if the agent abstained or failed.
        problem: what went wrong, for the user; "" if nothing did.
        ends_agent: asking this agent again is of no use.
    """

    query: Query
    edits: tuple[Edit, ...] = ()
    problem: str = ""
    ends_agent: bool = False

    @property
    def proposals(self) -> list[Proposal]:
        """The edits with where they come from."""
        view, agent = self.query.view, self.query.agent
        x, y, z = view.T_world_camera[:3, 3].tolist()
        stamp_s = float(view.frame.timestamp_s)
        name, model = encodable(str(agent.name)), encodable(str(agent.model))
        source = (name, model, agent.prompt_hash, view.keyframe_id, stamp_s, (x, y, z), agent.role)
        return [Proposal(edit, *source) for edit in self.edits]


@dataclass(slots=True)
class AgentCounts:
    """How often an agent was asked, and with what result.

    Attributes:
        asked, answered, failed: questions; an answer may hold no edits.
        proposed: edits.
        stopped: it is asked no more, and why; "" if it still is.
        problems: what went wrong, in words, and how often.
    """

    asked: int = 0
    answered: int = 0
    failed: int = 0
    proposed: int = 0
    stopped: str = ""
    problems: MessageTally = field(default_factory=MessageTally)

    def count(self, answer: Answer) -> None:
        """Note the end of a question."""
        self.answered += int(not answer.problem)
        self.failed += int(bool(answer.problem))
        self.proposed += len(answer.edits)
        if answer.problem:
            self.problems.add([answer.problem])
        if answer.ends_agent:
            self.stopped = answer.problem

    def as_dict(self) -> dict[str, Any]:
        """Return it for run.json."""
        return {
            "asked": self.asked,
            "answered": self.answered,
            "failed": self.failed,
            "proposed": self.proposed,
            "stopped": self.stopped,
            "problems": self.problems.as_dict(),
        }


def ask_and_wait(query: Query, thread: LoopThread) -> Answer:
    """Ask in the caller's thread; what an ``async def`` returns is awaited in ``thread``."""
    try:
        reply: Any = query.agent.propose(query.view)
        return answer_of(query, thread.wait_for(reply) if inspect.isawaitable(reply) else reply)
    except (Exception, SystemExit, asyncio.CancelledError) as error:  # noqa: BLE001  # an agent may raise anything, and no robot stops
        return failure_of(query, error)  # for it; a KeyboardInterrupt is the user's, who waits here


async def ask(query: Query) -> Answer:
    """Ask in the running loop, which is not the main thread's: a KeyboardInterrupt is the agent's own here."""
    try:
        reply: Any = query.agent.propose(query.view)
        return answer_of(query, await reply if inspect.isawaitable(reply) else reply)
    except (Exception, SystemExit, KeyboardInterrupt) as error:  # noqa: BLE001  # as above
        return failure_of(query, error)
    except asyncio.CancelledError as error:
        task = asyncio.current_task()
        if task is not None and task.cancelling():
            raise
        return failure_of(query, error)  # nobody cancelled the question: something that the agent waited for was cancelled


def answer_of(query: Query, reply: object) -> Answer:
    """Keep those edits that are sound and name only what was shown."""
    name = encodable(str(query.agent.name))
    if not isinstance(reply, Sequence) or isinstance(reply, str | bytes):
        return Answer(query, problem=f"agent {name}: answered with a {type(reply).__name__}, wanted a sequence of edits")
    shown = set(query.view.asked) if query.view.asked else {int(i) for i in query.view.landmarks.ids}
    sound = [edit for given in reply if (edit := _sound(given)) is not None]
    good = tuple(edit for edit in sound if _names_only(edit, shown))
    if len(sound) < len(reply):
        wanted = "edits of records.py, with whole numbers as ids and versions, and text as label, category and source"
        return Answer(query, good, f"agent {name}: proposed what is no edit, wanted {wanted}")
    return Answer(query, good, "" if len(good) == len(sound) else f"agent {name}: proposed edits of what it was not shown")


def failure_of(query: Query, error: BaseException) -> Answer:
    """Return what a failed question comes to."""
    ends = isinstance(error, BudgetExceeded) or (isinstance(error, ChatRequestError) and error.permanent)
    said = encodable(_said_by(error)[:300])
    told = said if isinstance(error, AgentError) else f"{type(error).__name__}: {said}" if said else type(error).__name__
    return Answer(query, problem=f"agent {encodable(str(query.agent.name))}: {told}", ends_agent=ends)


def _said_by(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # noqa: BLE001  # its own text may fail, too
        return ""


def _names_only(edit: Edit, shown: set[int]) -> bool:
    if isinstance(edit, Merge):
        return edit.keep_id in shown and edit.drop_id in shown
    return edit.landmark_id in shown


def _sound(edit: object) -> Edit | None:
    """The edit with plain numbers, and texts that any file can hold; None if it is no edit, or something else stands in their place."""
    try:
        match edit:
            case Merge():
                numbers = ("keep_id", "keep_version", "drop_id", "drop_version")
                return replace(edit, **{name: _whole(getattr(edit, name)) for name in numbers}, source=_text(edit.source))
            case Relabel():
                texts = {name: _text(getattr(edit, name)) for name in ("label", "category", "source")}
                return replace(edit, landmark_id=_whole(edit.landmark_id), version=_whole(edit.version), **texts)
            case Confirm() | Doubt() | Remove():
                return replace(edit, landmark_id=_whole(edit.landmark_id), version=_whole(edit.version), source=_text(edit.source))
            case _:
                return None
    except TypeError:
        return None


def _whole(number: object) -> int:
    if not isinstance(number, int | np.integer) or isinstance(number, bool):
        raise TypeError(f"got {type(number).__name__}, wanted a whole number")
    return int(number)


def _text(text: object) -> str:
    if not isinstance(text, str):
        raise TypeError(f"got {type(text).__name__}, wanted text")
    return encodable(str(text))
