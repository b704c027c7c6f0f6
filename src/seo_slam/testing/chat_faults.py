"""What a chat server can do instead of a proper reply.

Each fault is data: hand it to ``ChatServer(faults=…)``, or put it among its answers. A fault alone strikes every request;
``Sometimes`` makes it rarer. Your own fault is a subclass of ``Fault`` with one method.
"""

import random
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from email.utils import formatdate
from typing import Literal

from seo_slam.errors import ConfigError
from seo_slam.interfaces import ChatRequest
from seo_slam.simulation.chat_question import role_of
from seo_slam.testing.chat_reply import WireReply
from seo_slam.testing.wrong_json import WrongKind, wrong_json

MakeReply = Callable[[], WireReply]
"""Asks for the proper reply; a fault that does not call it uses up no scripted answer."""


class Fault(ABC):
    """Something that goes wrong with a reply."""

    def strikes(self, request: ChatRequest, number: int, seed: int) -> bool:  # noqa: ARG002
        """Return whether it strikes the ``number``-th request (from 1)."""
        return True

    @abstractmethod
    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:
        """Return what is sent instead of ``proper()``."""


@dataclass(frozen=True, slots=True)
class Sometimes(Fault):
    """A fault that strikes some requests only: those that meet every condition given.

    Attributes:
        fault: what happens.
        every: each ``every``-th request.
        share: this share of them, drawn by the server's seed and the number of the request.
        first: only the first so many requests.
        role: only questions of this agent: "verification", "description", "merging" or "other".

    Raises:
        ConfigError: ``every`` below 1 or ``share`` outside 0..1.
    """

    fault: Fault
    every: int = 1
    share: float = 1.0
    first: int | None = None
    role: str | None = None

    def __post_init__(self) -> None:
        if self.every < 1 or not 0.0 <= self.share <= 1.0:
            raise ConfigError(f"fault: got every={self.every}, share={self.share}, wanted every >= 1 and share within 0..1")

    def strikes(self, request: ChatRequest, number: int, seed: int) -> bool:
        """Return whether all conditions hold."""
        if number % self.every or (self.first is not None and number > self.first):
            return False
        if self.role is not None and role_of(request) != self.role:
            return False
        drawn = random.Random(f"{seed}|{type(self.fault).__name__}|{number}").random()
        return drawn < self.share and self.fault.strikes(request, number, seed)

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:
        """Let the fault happen."""
        return self.fault.spoil(request, proper)


@dataclass(frozen=True, slots=True)
class RateLimited(Fault):
    """429: too many requests.

    Attributes:
        retry_after_s: what the header ``Retry-After`` says, seconds; None: there is no such header.
        as_date: the header is a date instead of a number.
    """

    retry_after_s: float | None = 1.0
    as_date: bool = False

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Refuse."""
        headers = {}
        if self.retry_after_s is not None:
            date = formatdate(time.time() + self.retry_after_s, usegmt=True)
            headers["Retry-After"] = date if self.as_date else f"{self.retry_after_s:g}"
        return WireReply(status=429, error="too many requests", headers=headers)


@dataclass(frozen=True, slots=True)
class BadStatus(Fault):
    """Any other status: 400 by default, a request that the server does not take."""

    status: int = 400
    error: str = "the request is not understood"

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Refuse."""
        return WireReply(status=self.status, error=self.error)


def ServerError(status: Literal[500, 502, 503] = 500) -> BadStatus:  # reads as the other faults do
    """Return the fault of a server that is broken (500), behind a broken gateway (502), or overloaded (503)."""
    return BadStatus(status, "the server had an error")


def RefusedKey() -> BadStatus:
    """Return the fault of a key that the server does not know: 401."""
    return BadStatus(401, "the API key is not valid")


@dataclass(frozen=True, slots=True)
class Hang(Fault):
    """The request is read and never answered, until the server closes."""

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Wait for ever."""
        return WireReply(hangs=True)


@dataclass(frozen=True, slots=True)
class Dies(Fault):
    """The server answers ``after`` requests and then stops for good: all its connections break, new ones are refused."""

    after: int = 0

    def strikes(self, request: ChatRequest, number: int, seed: int) -> bool:  # noqa: ARG002
        """Return whether it is time."""
        return number > self.after

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Stop."""
        return WireReply(server_dies=True)


@dataclass(frozen=True, slots=True)
class Cut(Fault):
    """The reply stops in the middle.

    Attributes:
        share: of the reply that comes.
        connection: False: a complete HTTP reply whose text is cut, with ``finish_reason`` "length", as at ``max_tokens``. True: the
            connection is closed in the middle of the body.
    """

    share: float = 0.5
    connection: bool = False

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Cut the proper reply."""
        reply = proper()
        if self.connection:
            return replace(reply, sent_share=self.share)
        text = reply.text or ""
        return replace(reply, text=text[: int(self.share * len(text))], finish_reason="length")


@dataclass(frozen=True, slots=True)
class NotJson(Fault):
    """Prose instead of JSON."""

    text: str = "I see a room with a table. I am not certain what is in the boxes."

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Chat."""
        return replace(proper(), text=self.text)


@dataclass(frozen=True, slots=True)
class Fenced(Fault):
    """The right JSON, in a code fence with words around it, as models write it that nothing holds to a schema."""

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Wrap the proper reply."""
        reply = proper()
        return replace(reply, text=f"Here is what I found:\n\n```json\n{reply.text or ''}\n```\n\nLet me know if you need more.")


@dataclass(frozen=True, slots=True)
class WrongJson(Fault):
    """JSON, but not what was asked for. See ``WrongKind`` for the kinds."""

    kind: WrongKind = "shape"

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Change the proper reply."""
        reply = proper()
        return replace(reply, text=wrong_json(reply.text or "", self.kind))


@dataclass(frozen=True, slots=True)
class Refusal(Fault):
    """The model refuses: ``message.refusal`` has text, ``message.content`` is null."""

    text: str = "I'm sorry, but I can't help with that."

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Refuse in words."""
        return replace(proper(), text=None, message={"refusal": self.text})


@dataclass(frozen=True, slots=True)
class Empty(Fault):
    """Nothing is said.

    Attributes:
        kind: "null": the content is null; "text": it is ""; "reasoning": it is "" and all words went into ``reasoning_content``.
    """

    kind: Literal["null", "text", "reasoning"] = "null"

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Say nothing."""
        reply = proper()
        message = {"reasoning_content": "Let me look at the boxes one by one."} if self.kind == "reasoning" else {}
        return replace(reply, text=None if self.kind == "null" else "", message=message)


@dataclass(frozen=True, slots=True)
class Huge(Fault):
    """Far too much text.

    Attributes:
        characters: how much: 10 MB by default.
        inside: False: that much prose; True: the proper JSON with every text in it that long all together.
    """

    characters: int = 10_000_000
    inside: bool = False

    def spoil(self, request: ChatRequest, proper: MakeReply) -> WireReply:  # noqa: ARG002
        """Talk and talk."""
        reply = proper()
        if self.inside:
            return replace(reply, text=wrong_json(reply.text or "", "long", self.characters))
        return replace(reply, text="blah " * (self.characters // 5))
