"""Who asks the agents when: at once, in the background, or in recorded time. One interface, so that the pipeline need not know."""

import logging
import math
import threading
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from seo_slam.agents.answers import AgentCounts, Answer, ask_and_wait
from seo_slam.agents.chain import Chain, Query
from seo_slam.agents.loop_thread import LoopThread
from seo_slam.config import RunnerSettings
from seo_slam.interfaces import Agent, AgentView

logger = logging.getLogger(__name__)


class AgentRunner(Protocol):
    """Asks agents about views and hands out what they answer."""

    def wants_view(self, now_s: float) -> bool:
        """Whether a view of this stamp would be looked at: making one costs something."""
        ...

    def show(self, view: AgentView) -> None:
        """Take a view to ask about; the newest wins."""
        ...

    def poll(self, now_s: float) -> list[Answer]:
        """Return what was answered until this stamp, in the order of asking or arrival. Waits for nothing in the background."""
        ...

    def drain(self, timeout_s: float, stop: threading.Event | None = None) -> list[Answer]:
        """Wait for the answers still out, at most so long, and return them. Nothing new is asked but what follows from them.

        Args:
            timeout_s: seconds; recorded ones where time is virtual.
            stop: ends the waiting when it is set.
        """
        ...

    @property
    def out(self) -> int:
        """How many questions have no answer yet."""
        ...

    def close(self) -> bool:
        """Cancel what is out, end the thread; True if it has ended."""
        ...

    def counts(self) -> dict[str, Any]:
        """Return how often each agent was asked, and with what result."""
        ...


class Asking:
    """What all runners share: the chain, the pace of views, the counts."""

    def __init__(self, agents: Sequence[Agent], settings: RunnerSettings) -> None:
        self.settings = settings
        self.chain = Chain(agents, settings.queue)
        self.thread = LoopThread()
        self._agents = list(agents)
        self._counts = [AgentCounts() for _ in agents]
        self._last_view_s = float("-inf")

    def wants_view(self, now_s: float) -> bool:
        """See ``AgentRunner``."""
        return bool(self._agents) and not 0 <= now_s - self._last_view_s < self.settings.view_period_s - 1e-6

    def take(self, view: AgentView) -> None:
        """Show a view to the chain."""
        self._last_view_s = float(view.frame.timestamp_s)
        self.chain.show(view)

    def next(self) -> Query | None:
        """Return the next question, counted as asked."""
        query = self.chain.next()
        if query is not None:
            self._count_of(query).asked += 1
        return query

    def finish(self, answer: Answer) -> None:
        """Let the chain know an answer."""
        self._count_of(answer.query).count(answer)
        self.chain.answered(answer.query, answer.edits)
        if answer.ends_agent:
            self.chain.stop_asking(answer.query.agent)

    @property
    def out(self) -> int:
        """See ``AgentRunner``."""
        return sum(counts.asked - counts.answered - counts.failed for counts in self._counts)

    def counts(self) -> dict[str, Any]:
        """See ``AgentRunner``."""
        chain = self.chain.counts
        return {
            "mode": self.settings.mode,
            "agents": [
                {"name": agent.name, "model": agent.model, "role": agent.role, **counts.as_dict(), **_usage_of(agent)}
                for agent, counts in zip(self._agents, self._counts, strict=True)
            ],
            "landmarks_done": chain.landmarks_done,
            "dropped": chain.dropped,
            "superseded": chain.superseded,
        }

    def _count_of(self, query: Query) -> AgentCounts:
        return self._counts[next(k for k, agent in enumerate(self._agents) if agent is query.agent)]


class InlineRunner(Asking):
    """Every view is asked about to the end before the pipeline goes on: deterministic, for tests, data sets and local agents."""

    def __init__(self, agents: Sequence[Agent], settings: RunnerSettings) -> None:
        """Take the agents; no thread starts unless one of them is asynchronous."""
        super().__init__(agents, settings)
        self._answers: list[Answer] = []

    def show(self, view: AgentView) -> None:
        """See ``AgentRunner``."""
        self.take(view)
        while (query := self.next()) is not None:
            answer = ask_and_wait(query, self.thread)
            self.finish(answer)
            self._answers.append(answer)

    def poll(self, now_s: float) -> list[Answer]:  # noqa: ARG002
        """See ``AgentRunner``."""
        out, self._answers = self._answers, []
        return out

    def drain(self, timeout_s: float, stop: threading.Event | None = None) -> list[Answer]:  # noqa: ARG002
        """See ``AgentRunner``."""
        return self.poll(float("inf"))

    def close(self) -> bool:
        """See ``AgentRunner``."""
        return self.thread.stop(self.settings.shutdown_s)


class VirtualTimeRunner(Asking):
    """Answers count ``latency_s`` recorded seconds after the question, ``in_flight`` at once: what a slow model would do to a robot,
    whatever the machine's load. Questions are really asked, each when its turn comes.
    """

    def __init__(self, agents: Sequence[Agent], settings: RunnerSettings) -> None:
        """Take the agents."""
        super().__init__(agents, settings)
        self._out: list[tuple[float, int, Query]] = []  # due, number, question
        self._ready: list[Answer] = []

    def show(self, view: AgentView) -> None:
        """See ``AgentRunner``."""
        self.take(view)
        self._fill(float(view.frame.timestamp_s))

    def poll(self, now_s: float) -> list[Answer]:
        """See ``AgentRunner``."""
        self._advance(now_s)
        out, self._ready = self._ready, []
        return out

    def drain(self, timeout_s: float, stop: threading.Event | None = None) -> list[Answer]:  # noqa: ARG002
        """See ``AgentRunner``; the timeout is in recorded seconds after the last answer that has come."""
        start_s = self._out[0][0] if self._out else 0.0
        return self.poll(start_s + timeout_s)

    def close(self) -> bool:
        """See ``AgentRunner``."""
        return self.thread.stop(self.settings.shutdown_s)

    def _advance(self, now_s: float) -> None:
        while self._out and self._out[0][0] <= now_s:
            due_s, _, query = self._out.pop(0)
            answer = ask_and_wait(query, self.thread)
            self.finish(answer)
            self._ready.append(answer)
            self._fill(due_s)

    def _fill(self, now_s: float) -> None:
        while len(self._out) < self.settings.in_flight and (query := self.next()) is not None:
            self._out.append((now_s + self.settings.latency_s, query.number, query))
            self._out.sort(key=lambda item: item[:2])


def _usage_of(agent: Agent) -> dict[str, Any]:
    """What an agent says that it used, as far as run.json can hold it: a result is worth more than what it cost."""
    try:
        usage = getattr(agent, "usage", None)
        told = usage() if callable(usage) else usage
        known = {str(key): value for key, value in told.items() if _is_plain(value)} if isinstance(told, Mapping) else {}
    except Exception as error:  # noqa: BLE001  # an agent may raise anything
        logger.debug("agent %s: what it used is not known: %r", agent.name, error)
        return {}
    return {"usage": known} if known else {}


def _is_plain(value: object) -> bool:
    return isinstance(value, str | int) or (isinstance(value, float) and math.isfinite(value))
