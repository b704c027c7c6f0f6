"""Decides what the chat server replies: limits, what it supports, faults, and the answers it was given."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from seo_slam.errors import ChatRequestError, ConfigError
from seo_slam.interfaces import ChatRequest
from seo_slam.simulation.chat_tokens import tokens_of_question, tokens_of_text
from seo_slam.testing.chat_faults import BadStatus, Fault, Fenced
from seo_slam.testing.chat_limits import SlidingLimit
from seo_slam.testing.chat_reply import WireReply
from seo_slam.testing.chat_wire import WireRequest

logger = logging.getLogger(__name__)

Answer = str | Fault
Answers = Callable[[ChatRequest], Answer] | Sequence[Answer]
Support = Literal["json_schema", "json_object", "prompt"]

_FORMATS: dict[str, tuple[str, ...]] = {
    "json_schema": ("text", "json_object", "json_schema"),
    "json_object": ("text", "json_object"),
    "prompt": ("text",),
}


@dataclass(frozen=True, slots=True)
class Decision:
    """What is sent, and the tokens it counts."""

    reply: WireReply
    prompt_tokens: int = 0
    completion_tokens: int = 0


@dataclass(slots=True, eq=False)
class ReplyDesk:
    """Makes replies, one question at a time.

    Attributes:
        answers, faults, supports, fails_open, models, retry_after, seed: as ``ChatServer`` takes them.
        requests, tokens: the limits.

    Raises:
        ConfigError: no answers, or an unknown ``supports``.
    """

    answers: Answers
    faults: tuple[Fault, ...]
    supports: Support
    fails_open: bool
    models: tuple[str, ...] | None
    requests: SlidingLimit
    tokens: SlidingLimit
    retry_after: bool
    seed: int
    _replies_used: int = 0

    def __post_init__(self) -> None:
        if self.supports not in _FORMATS:
            raise ConfigError(f"chat server: got supports={self.supports!r}, wanted one of {', '.join(_FORMATS)}")
        if not callable(self.answers) and (isinstance(self.answers, str) or not len(self.answers)):
            raise ConfigError("chat server: wanted answers: a function, or a list with at least one reply")

    def decide(self, asked: WireRequest, number: int, now_s: float) -> Decision:
        """Return the reply to the ``number``-th request (from 1), which came at ``now_s`` seconds."""
        if self.models is not None and asked.model not in self.models:
            return Decision(WireReply(status=404, error=f"the model {asked.model!r} does not exist"))
        prompt_tokens = tokens_of_question(asked.chat)
        refused = self._over_a_limit(now_s, prompt_tokens + asked.chat.max_tokens)
        if refused is not None:
            return Decision(refused)
        self.requests.use(now_s, 1)
        reply = self._reply(asked, number)
        said = (reply.text or "", *(str(value) for value in reply.message.values()))
        completion_tokens = sum(map(tokens_of_text, said)) if reply.status == 200 else 0
        self.tokens.use(now_s, prompt_tokens + completion_tokens)
        headers = {**self.requests.headers(now_s), **self.tokens.headers(now_s), **reply.headers}
        return Decision(replace(reply, headers=headers), prompt_tokens, completion_tokens)

    def _over_a_limit(self, now_s: float, tokens: int) -> WireReply | None:
        waits = {self.requests: self.requests.wait_s(now_s, 1), self.tokens: self.tokens.wait_s(now_s, tokens)}
        limit, wait_s = max(waits.items(), key=lambda item: item[1])
        if not wait_s:
            return None
        headers = {**self.requests.headers(now_s), **self.tokens.headers(now_s)}
        if self.retry_after and math.isfinite(wait_s):
            headers["Retry-After"] = str(math.ceil(wait_s))
        return WireReply(status=429, error=f"rate limit: {limit.most} {limit.name} in {limit.window_s:g} s", headers=headers)

    def _reply(self, asked: WireRequest, number: int) -> WireReply:
        chat, opened = asked.chat, False
        if asked.format not in _FORMATS[self.supports]:
            if not self.fails_open:
                return WireReply(status=400, error=f"response_format {asked.format!r} is not supported")
            chat, opened = replace(chat, schema=None), True

        def proper() -> WireReply:
            reply = self._answer(chat, number)
            return Fenced().spoil(chat, lambda: reply) if opened and reply.text is not None else reply

        striking = next((fault for fault in self.faults if fault.strikes(chat, number, self.seed)), None)
        return proper() if striking is None else striking.spoil(chat, proper)

    def _answer(self, chat: ChatRequest, number: int) -> WireReply:
        try:
            answer = self._next_answer(chat)
            if isinstance(answer, Fault):
                return answer.spoil(chat, lambda: WireReply("{}")) if answer.strikes(chat, number, self.seed) else WireReply("{}")
        except ChatRequestError as error:
            return WireReply(status=400, error=str(error))
        except Exception as error:  # somebody else's function: a server has no caller that it could raise to
            logger.exception("chat server: answering request %d failed", number)
            return BadStatus(500, f"{type(error).__name__}: {error}").spoil(chat, WireReply)
        return WireReply(answer)

    def _next_answer(self, chat: ChatRequest) -> Answer:
        if callable(self.answers):
            return self.answers(chat)
        answer = self.answers[min(self._replies_used, len(self.answers) - 1)]
        self._replies_used += 1
        return answer
