"""Agents in one background thread: the robot's loop submits views and collects answers, and never waits."""

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from seo_slam.agents.answers import Answer, ask
from seo_slam.agents.chain import Query
from seo_slam.agents.runner import Asking
from seo_slam.config import RunnerSettings
from seo_slam.interfaces import Agent, AgentView

logger = logging.getLogger(__name__)

MOST_ANSWERS = 256
"""Answers kept until they are collected; then the oldest go: a robot that stands still for long asks about the same things again."""


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
        self._tasks: set[asyncio.Task[None]] = set()
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
        out = []
        while self._answers:
            out.append(self._answers.popleft())
        return out

    def drain(self, timeout_s: float, stop: threading.Event | None = None) -> list[Answer]:
        """See ``AgentRunner``."""
        deadline = time.monotonic() + timeout_s
        while not self._idle.wait(max(min(0.05, deadline - time.monotonic()), 0.0)):
            if time.monotonic() >= deadline or (stop is not None and stop.is_set()):
                break
        return self.poll(0.0)

    def close(self) -> bool:
        """See ``AgentRunner``."""
        self._closed = True
        return self.thread.stop(self.settings.shutdown_s)

    async def _look(self) -> None:
        with self._lock:
            view, self._newest = self._newest, None
        if view is not None:
            self.chain.show(view)
        self._fill()

    def _fill(self) -> None:
        while len(self._tasks) < self.settings.in_flight and (query := self.next()) is not None:
            task = asyncio.ensure_future(self._ask(query))
            self._tasks.add(task)
            task.add_done_callback(self._ended)
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
        self.finish(answer)
        self._answers.append(answer)

    def _ended(self, task: "asyncio.Task[None]") -> None:
        self._tasks.discard(task)
        if not task.cancelled() and not self._closed:
            task.exception()  # ``ask`` lets nothing through but cancellation
            self._fill()
