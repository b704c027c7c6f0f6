"""When a chat server is asked again: what it says itself, what we say, and until when."""

import math
import random
import re
import time
from collections.abc import Callable, Mapping
from email.utils import parsedate_to_datetime

RETRIED = frozenset({408, 409, 429})
_FIRST_S, _LONGEST_S = 0.5, 8.0
_DURATION = re.compile(r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m(?!s))?(?:(\d+(?:\.\d+)?)s)?(?:(\d+(?:\.\d+)?)ms)?")
_UNITS_S = (3600.0, 60.0, 1.0, 0.001)


def may_be_retried(status: int) -> bool:
    """Return whether a status can go away by itself."""
    return status in RETRIED or 500 <= status <= 599


def wait_said(headers: Mapping[str, str], now_s: float | None = None) -> float | None:
    """Return the seconds after which a server says that it can be asked again; None if it says nothing, or nonsense.

    Args:
        headers: of the response, names in lower case: ``retry-after-ms``, ``retry-after`` (seconds or a date),
            ``x-ratelimit-reset-requests`` and ``-tokens`` (of what has nothing remaining).
        now_s: seconds since 1970 for a date; None: the response's own ``date``, else this machine's clock.
    """
    said = _number(headers.get("retry-after-ms"))
    if said is not None:
        return said / 1000.0
    said = _number(headers.get("retry-after"))
    if said is None:
        said = _until(headers.get("retry-after"), now_s if now_s is not None else _seconds_of_date(headers.get("date")))
    if said is not None:
        return said
    resets = [
        reset
        for what in ("requests", "tokens")
        if (reset := duration_s(headers.get(f"x-ratelimit-reset-{what}"))) and not _number(headers.get(f"x-ratelimit-remaining-{what}"))
    ]
    return max(resets, default=None)


def duration_s(text: str | None) -> float | None:
    """Return the seconds of a duration such as ``6m0s``, ``120ms``, ``1h2m3.5s`` or ``2.5``; None if it is none."""
    if text is None:
        return None
    bare = _number(text)
    if bare is not None:
        return bare
    match = _DURATION.fullmatch(text.strip()[:40])
    if match is None or not any(match.groups()):
        return None
    return sum(float(digits) * unit for digits, unit in zip(match.groups(), _UNITS_S, strict=True) if digits)


def own_wait_s(attempt: int, draws: random.Random) -> float:
    """Return how long to wait after the ``attempt``-th failure (from 1) if the server says nothing: doubling, with jitter."""
    return float(min(_LONGEST_S, _FIRST_S * 2.0 ** min(attempt - 1, 10)) * draws.uniform(0.5, 1.0))


def jittered_s(said_s: float, draws: random.Random) -> float:
    """Return a wait not under what the server said, and not the same for everybody."""
    return said_s + draws.uniform(0.0, 0.05 + 0.1 * min(said_s, 10.0))


class Deadline:
    """How much time is left. What our own rate limits take is not counted: the user asked for it."""

    def __init__(self, seconds: float, clock: Callable[[], float]) -> None:
        """Start now."""
        self.seconds = seconds
        self._clock = clock
        self._end_s = clock() + seconds

    def left_s(self) -> float:
        """Seconds until it is over; below 0 after it."""
        return self._end_s - self._clock()

    def extend(self, seconds: float) -> None:
        """Put it off."""
        self._end_s += seconds


class Pause:
    """Until when nothing is sent to an endpoint: after a 429 everybody waits, not only who got it."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Start without a pause."""
        self._clock = clock
        self._until_s = -math.inf

    def left_s(self) -> float:
        """Seconds that it lasts; 0: there is none."""
        return max(self._until_s - self._clock(), 0.0)

    def hold(self, seconds: float) -> None:
        """Pause for so long from now on; a longer pause stays."""
        self._until_s = max(self._until_s, self._clock() + seconds)


def _number(text: str | None) -> float | None:
    """A finite number, not below 0."""
    try:
        value = float(text) if text is not None and len(text) <= 40 else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) and value >= 0.0 else None


def _seconds_of_date(text: str | None) -> float | None:
    try:
        return parsedate_to_datetime(text[:60]).timestamp() if text else None
    except (ValueError, OverflowError, TypeError):
        return None


def _until(text: str | None, now_s: float | None) -> float | None:
    then_s = _seconds_of_date(text)
    return None if then_s is None else max(then_s - (time.time() if now_s is None else now_s), 0.0)
