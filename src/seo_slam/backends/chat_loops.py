"""Things that belong to one event loop: an HTTP client, a lock. Each loop gets its own, made when it is first needed there."""

import asyncio
import threading
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import Generic, TypeVar

Thing = TypeVar("Thing")


class PerLoop(Generic[Thing]):
    """One thing for each running event loop; those of closed loops are forgotten."""

    def __init__(self, make: Callable[[], Thing]) -> None:
        """Make nothing yet."""
        self._make = make
        self._made: dict[asyncio.AbstractEventLoop, Thing] = {}
        self._lock = threading.Lock()

    def here(self) -> Thing:
        """The thing of the running loop."""
        loop = asyncio.get_running_loop()
        with self._lock:
            self._made = {known: thing for known, thing in self._made.items() if not known.is_closed()}
            if loop not in self._made:
                self._made[loop] = self._make()
            return self._made[loop]

    def forget(self) -> Thing | None:
        """Take the thing of the running loop out and return it; None if there is none."""
        with self._lock:
            return self._made.pop(asyncio.get_running_loop(), None)


class ClosedWithLoop(Generic[Thing]):
    """Holds a thing that must be closed before its loop is, and closes it when the loop shuts down, if nobody did before.

    ``asyncio.run`` and our background thread finish all asynchronous generators before they close a loop; one of them holds the thing.
    """

    def __init__(self, thing: Thing, close: Callable[[Thing], Awaitable[None]]) -> None:
        """Take the thing. ``armed`` must be awaited once in its loop."""
        self.thing = thing
        self._close = close
        self._holder: AsyncGenerator[None, None] | None = None

    async def armed(self) -> Thing:
        """Return the thing, and see to it that it is closed."""
        if self._holder is None:
            self._holder = self._hold()
            await anext(self._holder)
        return self.thing

    async def aclose(self) -> None:
        """Close it now."""
        if self._holder is not None:
            await self._holder.aclose()

    async def _hold(self) -> AsyncGenerator[None, None]:
        try:
            yield
        finally:
            await self._close(self.thing)
