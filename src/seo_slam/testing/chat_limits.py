"""Rate limits of the chat server, kept over a sliding window, and how much of them a log of requests used."""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from seo_slam.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Seen:
    """A request as the server saw it.

    Attributes:
        number: 1, 2, … in the order they came.
        time_s: when it came, seconds since the server was made.
        model: that was asked for.
        role: which agent asked: "verification", "description", "merging", or "other".
        prompt_tokens, completion_tokens: as counted; 0 for what was refused or never answered.
        status: of HTTP; 0: no answer was sent, since the client gave up or the server closed.
        seconds: from its coming to the end of the answer.
    """

    number: int
    time_s: float
    model: str
    role: str
    prompt_tokens: int
    completion_tokens: int
    status: int
    seconds: float

    @property
    def tokens(self) -> int:
        """Of prompt and reply."""
        return self.prompt_tokens + self.completion_tokens


def most_requests(seen: Iterable[Seen], window_s: float = 60.0) -> int:
    """Return how many requests came within the busiest ``window_s`` seconds; those refused with 429 do not count."""
    return _most(((request.time_s, 1) for request in seen if request.status != 429), window_s)


def most_tokens(seen: Iterable[Seen], window_s: float = 60.0) -> int:
    """Return how many tokens the requests of the busiest ``window_s`` seconds had."""
    return _most(((request.time_s, request.tokens) for request in seen), window_s)


def _most(amounts: Iterable[tuple[float, int]], window_s: float) -> int:
    window: deque[tuple[float, int]] = deque()
    total = most = 0
    for time_s, amount in sorted(amounts):
        while window and window[0][0] <= time_s - window_s:
            total -= window.popleft()[1]
        window.append((time_s, amount))
        total += amount
        most = max(most, total)
    return most


class SlidingLimit:
    """At most so much in any window of time."""

    def __init__(self, name: str, most: int | None, window_s: float) -> None:
        """Start with nothing used.

        Args:
            name: "requests" or "tokens".
            most: how much; None: no limit.
            window_s: length of the window, seconds.

        Raises:
            ConfigError: a limit below 1 or a window that is not above 0.
        """
        if (most is not None and most < 1) or not window_s > 0:
            raise ConfigError(f"{name} per window: got {most} in {window_s} s, wanted at least 1 in more than 0 s")
        self.name = name
        self.most = most
        self.window_s = window_s
        self._used: deque[tuple[float, int]] = deque()
        self._total = 0

    def wait_s(self, now_s: float, amount: int) -> float:
        """Return how long it takes until ``amount`` more is allowed; 0: now; infinity: never, it is more than the limit."""
        if self.most is None:
            return 0.0
        self._forget(now_s)
        if amount > self.most:
            return math.inf
        over = self._total + amount - self.most
        for time_s, used in self._used:
            if over <= 0:
                break
            over -= used
            if over <= 0:
                return max(time_s + self.window_s - now_s, 1e-3)
        return 0.0

    def use(self, now_s: float, amount: int) -> None:
        """Count ``amount`` as used."""
        if self.most is not None:
            self._used.append((now_s, amount))
            self._total += amount

    def headers(self, now_s: float) -> dict[str, str]:
        """Return the ``x-ratelimit`` headers that hosted servers send."""
        if self.most is None:
            return {}
        self._forget(now_s)
        reset_s = self._used[-1][0] + self.window_s - now_s if self._used else 0.0
        return {
            f"x-ratelimit-limit-{self.name}": str(self.most),
            f"x-ratelimit-remaining-{self.name}": str(max(self.most - self._total, 0)),
            f"x-ratelimit-reset-{self.name}": f"{reset_s:.3f}s",
        }

    def _forget(self, now_s: float) -> None:
        while self._used and self._used[0][0] <= now_s - self.window_s:
            self._total -= self._used.popleft()[1]
