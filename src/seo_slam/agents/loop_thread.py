"""One background thread with an event loop of its own: works beside a running loop (notebooks, async nodes) and without one."""

import asyncio
import threading
from collections.abc import Awaitable, Coroutine
from concurrent.futures import Future
from contextlib import suppress
from typing import Any, TypeVar

Result = TypeVar("Result")

THREAD_NAME = "seo_slam agents"

_CLEANING_UP_S = 0.5


class LoopThread:
    """Runs coroutines in its thread. The thread starts with the first one and ends with ``stop``."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._stopping = threading.Event()
        self._lock = threading.Lock()

    def submit(self, coroutine: Coroutine[Any, Any, Result]) -> "Future[Result]":
        """Start a coroutine and return its future at once."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._running())

    def wait_for(self, awaitable: Awaitable[Result]) -> Result:
        """Run to the end and return what comes out, or raise what it raises."""
        return self.submit(_as_coroutine(awaitable)).result()

    def stop(self, timeout_s: float = 1.0) -> bool:
        """Cancel everything, let it clean up, and end the thread; True if it has ended in time. May be called twice."""
        with self._lock:
            loop, thread, self._loop, self._thread = self._loop, self._thread, None, None
        if loop is None or thread is None:
            return True
        with suppress(RuntimeError):  # it is closed already
            loop.call_soon_threadsafe(_end, loop, self._stopping)
        thread.join(timeout_s)
        return not thread.is_alive()

    def _running(self) -> asyncio.AbstractEventLoop:
        with self._lock:
            if self._loop is None:
                self._loop = asyncio.new_event_loop()
                self._stopping = threading.Event()
                self._thread = threading.Thread(target=_run, args=(self._loop, self._stopping), name=THREAD_NAME, daemon=True)
                self._thread.start()
            return self._loop


def _run(loop: asyncio.AbstractEventLoop, stopping: threading.Event) -> None:
    asyncio.set_event_loop(loop)
    try:
        while not stopping.is_set():
            with suppress(SystemExit, KeyboardInterrupt):  # asyncio lets them through from a task, to which they are given as well
                loop.run_forever()  # until stop
        deadline_s = loop.time() + _CLEANING_UP_S
        while (tasks := asyncio.all_tasks(loop)) and (left_s := deadline_s - loop.time()) > 0:  # what is cancelled may start others
            for task in tasks:
                task.cancel()
            with suppress(SystemExit, KeyboardInterrupt):
                loop.run_until_complete(asyncio.wait(tasks, timeout=left_s))
        loop.run_until_complete(loop.shutdown_asyncgens())
    finally:
        loop.close()


def _end(loop: asyncio.AbstractEventLoop, stopping: threading.Event) -> None:
    """End the loop, also if something else breaks out of it in this same turn."""
    stopping.set()
    loop.stop()


async def _as_coroutine(awaitable: Awaitable[Result]) -> Result:
    return await awaitable
