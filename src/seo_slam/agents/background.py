"""Agents in one background thread: the robot's loop submits views and collects answers, and never waits."""

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial

from seo_slam.agents.answers import Answer, ask, failure_of
from seo_slam.agents.chain import Query
from seo_slam.agents.runner import Asking
from seo_slam.config import RunnerSettings
from seo_slam.interfaces import Agent, AgentView

logger = logging.getLogger(__name__)

MOST_ANSWERS = 256
"""Answers kept until they are collected; then the oldest go, and it is said: a robot that stands still for long asks the same again."""


class BackgroundRunner(Asking):
    """Up to ``in_flight`` questions at once in one thread with an event loop of its own.

    Images are composed in that thread, too. An agent whose ``propose`` is no ``async def`` holds up the others while it thinks.
    """

    def __init__(self, agents: Sequence[Agent], settings: RunnerSettings, think_ahead: Callable[[Answer], None] | None = None) -> None:
        """Take the agents; the thread starts with the first view.

        Args:
            agents: to be asked.
            settings: of the runner.
            think_ahead: called with each answer in this thread, for what the robot's loop would else have to compute.
        """
        super().__init__(agents, settings)
        self._think_ahead = think_ahead
        self._newest: AgentView | None = None
        self._lock = threading.Lock()
        self._answers: deque[Answer] = deque(maxlen=MOST_ANSWERS)
        self._lost = 0
        self._tasks: set[asyncio.Task[None]] = set()
        self._unanswered: dict[int, Query] = {}
        self._closed = False
        self._idle = threading.Event()
        self._idle.set()

    def show(self, view: AgentView) -> None:
        """See ``AgentRunner``."""
        if self._closed:
            return
        self._last_view_s = float(view.frame.timestamp_s)
        with self._lock:
            waits, self._newest = self._newest is not None, view
            self._idle.clear()
        if not waits:  # else the thread has been told already, and will find this view instead of the older one
            self.thread.submit(self._look())

    def poll(self, now_s: float) -> list[Answer]:  # noqa: ARG002
        """See ``AgentRunner``."""
        with self._lock:
            out, lost = list(self._answers), self._lost
            self._answers.clear()
            self._lost = 0
        if lost:
            told = f"agents: {lost} answers are lost, since more than {MOST_ANSWERS} waited to be collected; poll more often"
            out.insert(0, Answer(out[0].query, problem=told))
        return out

    def drain(self, timeout_s: float, stop: threading.Event | None = None) -> list[Answer]:
        """See ``AgentRunner``."""
        deadline = time.monotonic() + timeout_s
        while not self._idle.wait(max(min(0.05, deadline - time.monotonic()), 0.0)):
            if time.monotonic() >= deadline or (stop is not None and stop.is_set()):
                break
        return self.poll(0.0)

    def close(self) -> bool:
        """See ``AgentRunner``; who keeps the thread is told in a warning."""
        self._closed = True
        ended = self.thread.stop(self.settings.shutdown_s)
        self._idle.set()  # nothing more will come
        if not ended:
            names = ", ".join(sorted({query.agent.name for query in list(self._unanswered.values())})) or "an agent"
            logger.warning("the agents' thread has not ended within %g s, still thinking: %s", self.settings.shutdown_s, names)
        return ended

    async def _look(self) -> None:
        with self._lock:
            view, self._newest = self._newest, None
        if view is not None:
            self.chain.show(view)
        self._fill()

    def _fill(self) -> None:
        while len(self._tasks) < self.settings.in_flight and (query := self.next()) is not None:
            self._unanswered[query.number] = query
            task = asyncio.ensure_future(self._ask(query))
            self._tasks.add(task)
            task.add_done_callback(partial(self._ended, query))
        with self._lock:
            if not self._tasks and self._newest is None:
                self._idle.set()

    async def _ask(self, query: Query) -> None:
        answer = await ask(query)
        if self._think_ahead is not None:
            try:
                self._think_ahead(answer)
            except Exception as error:  # noqa: BLE001  # whoever judges the answer meets it again, and says so
                logger.debug("thinking ahead about an answer of %s failed: %s", query.agent.name, error)
        self._settle(answer)

    def _settle(self, answer: Answer) -> None:
        """Let chain and robot know an answer, the first one to each question."""
        if self._unanswered.pop(answer.query.number, None) is None:
            return
        self.finish(answer)
        with self._lock:
            self._lost += int(len(self._answers) == MOST_ANSWERS)
            self._answers.append(answer)

    def _ended(self, query: Query, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        error = asyncio.CancelledError("the agent cancelled its question") if task.cancelled() else task.exception()
        if self._closed:
            self._unanswered.pop(query.number, None)
            return
        if error is not None:
            self._settle(failure_of(query, error))
        self._fill()
