"""Keeps requests and tokens under the limits of a server, evenly spread.

Two rules at once. *Spread*: the next request may go when the one before has been "worked off" at the limit's own rate; a twentieth of the
window may be made up for after a lull. *Never over*: a log of what was sent, so that no window of that length holds more than the limit,
wherever it begins. Both leave a little room, since a request reaches the server some time after it was sent, and not always the same time.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from seo_slam.backends.chat_loops import PerLoop

_SPREAD_ROOM = 1.025
_WINDOW_ROOM = 1.01
_MADE_UP = 0.05
_SOON_S = 1e-6


@dataclass(slots=True)
class _Sent:
    time_s: float
    amount: float


class Quota:
    """At most ``limit`` in any window of ``window_s`` seconds. Not for several threads."""

    def __init__(self, limit: float, window_s: float) -> None:
        """Start with nothing sent."""
        self.limit = float(limit)
        self._spread_s = window_s * _SPREAD_ROOM / self.limit
        self._kept_s = window_s * _WINDOW_ROOM
        self._made_up_s = window_s * _MADE_UP
        self._free_s = -float("inf")
        self._log: deque[_Sent] = deque()
        self._total = 0.0

    def wait_s(self, amount: float, now_s: float) -> float:
        """Return how long ``amount`` must wait; 0: it may go now. More than the limit at once counts as the limit."""
        while self._log and self._log[0].time_s <= now_s - self._kept_s:
            self._total -= self._log.popleft().amount
        wait_s = self._free_s - now_s
        over = self._total + min(amount, self.limit) - self.limit
        for sent in self._log:
            if over <= 1e-9:
                break
            over -= sent.amount
            wait_s = max(wait_s, sent.time_s + self._kept_s - now_s)
        return max(wait_s, 0.0)

    def take(self, amount: float, now_s: float) -> _Sent:
        """Count ``amount`` as sent now."""
        sent = _Sent(now_s, min(amount, self.limit))
        self._free_s = max(self._free_s, now_s - self._made_up_s) + sent.amount * self._spread_s
        self._log.append(sent)
        self._total += sent.amount
        return sent

    def correct(self, sent: _Sent, amount: float) -> None:
        """Say how much it really was; 0: it was not sent."""
        more = amount - sent.amount
        self._free_s += more * self._spread_s
        if any(entry is sent for entry in self._log):
            self._total += more
        sent.amount = amount


class Place:
    """The right to send one request."""

    def __init__(self, pacer: "Pacer", sent: tuple[_Sent, ...], waited_s: float) -> None:
        """Made by ``Pacer.enter``."""
        self.waited_s = waited_s
        self._pacer = pacer
        self._sent = sent

    def leave(self) -> None:
        """Nothing was sent."""
        self._pacer.correct(self._sent, (0.0, 0.0))

    def settle(self, tokens: float) -> None:
        """A request was sent, and came to so many tokens."""
        self._pacer.correct(self._sent, (1.0, tokens))


class Pacer:
    """Lets requests through one by one, first come first served, as the limits allow. Any thread, any event loop.

    Args:
        requests, tokens: most in a window; None: no limit.
        window_s: length of the window, seconds.
        clock, sleep: replaceable, for tests.
    """

    def __init__(
        self,
        requests: float | None,
        tokens: float | None,
        window_s: float,
        clock: Callable[[], float],
        sleep: Callable[[float], Awaitable[object]],
    ) -> None:
        self._quotas = (Quota(requests, window_s) if requests else None, Quota(tokens, window_s) if tokens else None)
        self._nap_s = window_s / 200.0
        self._clock = clock
        self._sleep = sleep
        self._lock = threading.Lock()
        self._turn: PerLoop[asyncio.Lock] = PerLoop(asyncio.Lock)

    async def enter(self, tokens: float, most_tokens: float = 0.0) -> Place:
        """Wait until a request of about ``tokens`` may be sent.

        ``most_tokens`` is what it could come to: a server lets it in only if that fits, too, and counts afterwards what it was.
        """
        if self._quotas == (None, None):
            return Place(self, (), 0.0)
        began_s = self._clock()
        async with self._turn.here():
            while True:
                wait_s, sent = self._try((1.0, tokens), (1.0, max(tokens, most_tokens)))
                if sent is not None:
                    return Place(self, sent, self._clock() - began_s)
                await self._sleep(min(wait_s, self._nap_s))  # a nap: tokens given back meanwhile make the wait shorter

    def correct(self, sent: tuple[_Sent, ...], amounts: tuple[float, float]) -> None:
        """Put the true amounts in place of the expected ones."""
        with self._lock:
            given = [(quota, amount) for quota, amount in zip(self._quotas, amounts, strict=True) if quota is not None]
            for (quota, amount), entry in zip(given, sent, strict=False):
                quota.correct(entry, amount)

    def _try(self, amounts: tuple[float, float], most: tuple[float, float]) -> tuple[float, tuple[_Sent, ...] | None]:
        with self._lock:
            now_s = self._clock()
            given = list(zip(self._quotas, amounts, most, strict=True))
            wait_s = max(quota.wait_s(at_most, now_s) for quota, _, at_most in given if quota is not None)
            if wait_s > _SOON_S:
                return wait_s, None
            return 0.0, tuple(quota.take(amount, now_s) for quota, amount, _ in given if quota is not None)
