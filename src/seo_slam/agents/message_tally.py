"""How often each message came, in bounded memory: a server that fails for hours tells other numbers each time."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")

MOST_MESSAGES = 100
OTHERS = "other messages, too many to be told apart"


@dataclass(slots=True)
class _Kind:
    """Messages that differ in their numbers only: how often each came; only the one of the largest numbers, once they are too many."""

    counts: dict[str, int] = field(default_factory=dict)
    is_together: bool = False

    def add(self, message: str, most: int) -> None:
        self.counts[message] = self.counts.get(message, 0) + 1
        if len(self.counts) > (1 if self.is_together else most):
            largest = max(self.counts, key=_numbers)
            self.counts = {largest: sum(self.counts.values())}
            self.is_together = True


class MessageTally:
    """Counts messages. What is too much to be told apart is counted together, so that nothing is lost and nothing grows."""

    def __init__(self, told_apart: int = 1) -> None:
        """Start with none.

        Args:
            told_apart: so many messages that differ in their numbers only are counted each by itself. Where there are more, all of them
                are one message: that of the largest numbers (the first number counts first), marked as one of many.
        """
        self._told_apart = told_apart
        self._kinds: dict[str, _Kind] = {}  # by the message without its numbers

    def add(self, messages: Iterable[str]) -> None:
        """Count each message once more."""
        for message in messages:
            kind = _NUMBER.sub("#", message)
            if len(self._kinds) >= MOST_MESSAGES and kind not in self._kinds:
                kind = message = OTHERS
            self._kinds.setdefault(kind, _Kind()).add(message, self._told_apart)

    def as_dict(self) -> dict[str, int]:
        """Return message -> how often; kinds in the order of their first time."""
        return {
            f"{message} (and the like)" if kind.is_together else message: count
            for kind in self._kinds.values()
            for message, count in kind.counts.items()
        }


def _numbers(message: str) -> tuple[list[float], str]:
    return [float(number) for number in _NUMBER.findall(message)], message
