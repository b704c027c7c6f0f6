"""How often each message came, in bounded memory: a server that fails for hours tells other numbers each time."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")

MOST_MESSAGES = 100
OTHERS = "other messages, too many to be told apart"


@dataclass(slots=True)
class _Kind:
    """Messages that differ in their numbers only."""

    example: str
    differ: bool = False
    count: int = 0


class MessageTally:
    """Counts messages. Those that differ in their numbers only are one: the one of the largest numbers, the first number first.

    What is too much to be told apart is counted together, so that nothing is lost and nothing grows.
    """

    def __init__(self) -> None:
        """Start with none."""
        self._kinds: dict[str, _Kind] = {}  # by the message without its numbers

    def add(self, messages: Iterable[str]) -> None:
        """Count each message once more."""
        for message in messages:
            told, without = message, _NUMBER.sub("#", message)
            if len(self._kinds) >= MOST_MESSAGES and without not in self._kinds:
                told = without = OTHERS
            kind = self._kinds.setdefault(without, _Kind(told))
            kind.count += 1
            kind.differ |= told != kind.example
            kind.example = max(kind.example, told, key=_numbers)

    def as_dict(self) -> dict[str, int]:
        """Return message -> how often, in the order of their first time; "(and the like)" ends a message that stands for several."""
        return {f"{kind.example} (and the like)" if kind.differ else kind.example: kind.count for kind in self._kinds.values()}


def _numbers(message: str) -> tuple[list[float], str]:
    return [float(number) for number in _NUMBER.findall(message)], message
