"""What came back from agents, on its way to the map."""

import inspect
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from seo_slam.agents.chain import Query
from seo_slam.agents.loop_thread import LoopThread
from seo_slam.agents.message_tally import MessageTally
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
        source = (agent.name, agent.model, agent.prompt_hash, view.keyframe_id, stamp_s, (x, y, z), agent.role)
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
    except Exception as error:  # noqa: BLE001  # an agent may raise anything, and no robot stops for it
        return failure_of(query, error)


async def ask(query: Query) -> Answer:
    """Ask in the running loop."""
    try:
        reply: Any = query.agent.propose(query.view)
        return answer_of(query, await reply if inspect.isawaitable(reply) else reply)
    except Exception as error:  # noqa: BLE001  # as above
        return failure_of(query, error)


def answer_of(query: Query, reply: object) -> Answer:
    """Keep those edits that name only what was shown."""
    if not isinstance(reply, Sequence) or isinstance(reply, str | bytes):
        return Answer(query, problem=f"agent {query.agent.name}: answered with a {type(reply).__name__}, wanted a sequence of edits")
    shown = set(query.view.asked) if query.view.asked else {int(i) for i in query.view.landmarks.ids}
    good = tuple(edit for edit in reply if _names_only(edit, shown))
    problem = "" if len(good) == len(reply) else f"agent {query.agent.name}: proposed edits of what it was not shown"
    return Answer(query, good, problem)


def failure_of(query: Query, error: Exception) -> Answer:
    """Return what a failed question comes to."""
    ends = isinstance(error, BudgetExceeded) or (isinstance(error, ChatRequestError) and error.permanent)
    told = str(error) if isinstance(error, AgentError) else f"{type(error).__name__}: {error}"
    return Answer(query, problem=f"agent {query.agent.name}: {told[:300]}", ends_agent=ends)


def _names_only(edit: object, shown: set[int]) -> bool:
    match edit:
        case Merge(keep_id=keep, drop_id=drop):
            return keep in shown and drop in shown
        case Confirm() | Doubt() | Relabel() | Remove():
            return edit.landmark_id in shown
        case _:
            return False
