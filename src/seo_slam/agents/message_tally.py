"""How often each message came, in bounded memory: a server that fails for hours tells other numbers each time."""

import re
from collections.abc import Iterable

_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")

ALIKE = 3
"""So many messages that differ in their numbers only are told apart; more of them are counted together."""

MOST_MESSAGES = 100
OTHERS = "other messages, too many to be told apart"


class MessageTally:
    """Counts messages. What is too much to be told apart is counted together, so that nothing is lost and nothing grows."""

    def __init__(self) -> None:
        """Start with none."""
        self._counts: dict[str, int] = {}
        self._alike: dict[str, list[str]] = {}  # message without its numbers -> the first such messages

    def add(self, messages: Iterable[str]) -> None:
        """Count each message once more."""
        for message in messages:
            told = self._told(message)
            self._counts[told] = self._counts.get(told, 0) + 1

    def as_dict(self) -> dict[str, int]:
        """Return message -> how often, in the order of their first time."""
        return dict(self._counts)

    def _told(self, message: str) -> str:
        if message in self._counts:
            return message
        kind = _NUMBER.sub("#", message)
        if len(self._alike) >= MOST_MESSAGES and kind not in self._alike:
            return OTHERS
        alike = self._alike.setdefault(kind, [])
        if len(alike) >= ALIKE:
            return f"{alike[0]} (and the like)"
        alike.append(message)
        return message
