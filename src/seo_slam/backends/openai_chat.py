"""A chat model behind an OpenAI-compatible server: OpenAI, Azure, Groq, vLLM, Ollama, llama.cpp and others."""

import asyncio
import logging
import math
import random
import time
import weakref
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from seo_slam.agents.reply_json import json_objects_in
from seo_slam.agents.reply_text import excerpt
from seo_slam.backends import chat_retries as retries
from seo_slam.backends import chat_wire as wire
from seo_slam.backends.chat_access import access_to
from seo_slam.backends.chat_budget import Budget, ChatUsage, TokenEstimates, tokens_of_text
from seo_slam.backends.chat_cache import content_key, make_cache
from seo_slam.backends.chat_capabilities import PROBE, Capabilities, FormatOption, passes, refuses_format
from seo_slam.backends.chat_client import ChatClient, Received
from seo_slam.backends.chat_loops import PerLoop
from seo_slam.backends.chat_rates import Pacer, Place
from seo_slam.errors import ChatReplyError, ChatRequestError, ConfigError
from seo_slam.interfaces import ChatReply, ChatRequest

logger = logging.getLogger(__name__)

_OF_NO_USE = frozenset({301, 302, 307, 308, 401, 402, 403, 404, 405, 410})
_SOON_S = 1e-6

# What all objects of this process that ask the same model of the same server share: a 429 is meant for all of them, and so is a limit.
_PAUSES: "weakref.WeakValueDictionary[tuple[object, ...], retries.Pause]" = weakref.WeakValueDictionary()
_PACERS: "weakref.WeakValueDictionary[tuple[object, ...], Pacer]" = weakref.WeakValueDictionary()


class OpenAIChat:
    """A ``ChatModel`` behind any server that speaks OpenAI's chat completions.

    The key comes from the environment only, and is in nothing that is shown, logged or kept. Any thread and any event loop may ask.

    Args:
        model: name of the model; with Azure that of the deployment.
        base_url: up to and with ``/v1``.
        api_key_env: environment variable of the key; None: that of the server where it is a known one (``OPENAI_API_KEY``,
            ``AZURE_OPENAI_API_KEY``, ``GROQ_API_KEY``, …), else no key.
        api_key_header: the header that the key goes into; None: ``Authorization`` (as "Bearer"), with Azure ``api-key``.
        reply_format: how replies are held to a schema; "auto" finds out with the first question that has one.
        timeout_s: of one request, seconds.
        deadline_s: of a question with all repetitions, seconds; what our own rate limits take is not counted.
        requests_per_minute, tokens_per_minute: limits, kept in every window of ``window_s``; None: none. All objects of this process
            that name the same server, model and limits keep them together.
        window_s: what a "minute" is, seconds.
        max_tokens_total: budget of tokens, prompt and completion; None: none.
        max_cost: budget of money; None: none. Needs ``price_per_million``.
        price_per_million: what a million tokens of prompt and of completion cost.
        currency: of the prices, for messages.
        cache: answers by content of the question: true, in memory; a path, in a SQLite file; false, none.
        max_request_bytes: a longer request is not sent; None: 4 MB with Groq, else any length.
        seed: of the jitter of waits.
        client: an ``httpx.AsyncClient`` (or of httpx2) to be used; it is not closed here.
        clock, sleep: replaceable, for tests.

    Raises:
        ConfigError: an option is wrong, or the key is missing; the message names the variable.
    """

    def __init__(
        self,
        model: str,
        base_url: str = "https://api.openai.com/v1",
        api_key_env: str | None = None,
        api_key_header: str | None = None,
        reply_format: FormatOption = "auto",
        timeout_s: float = 30.0,
        deadline_s: float = 60.0,
        requests_per_minute: float | None = None,
        tokens_per_minute: float | None = None,
        window_s: float = 60.0,
        max_tokens_total: int | None = None,
        max_cost: float | None = None,
        price_per_million: Sequence[float] | None = None,
        currency: str = "USD",
        cache: str | Path | bool = True,
        max_request_bytes: int | None = None,
        seed: int = 0,
        client: Any = None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], Awaitable[object]] = asyncio.sleep,
    ) -> None:
        if not isinstance(model, str) or not model.strip():
            raise ConfigError(f"model: got {model!r:.60}, wanted the name of a model")
        if reply_format not in get_args(FormatOption):
            raise ConfigError(f"reply_format: got {reply_format!r:.60}, wanted one of {', '.join(get_args(FormatOption))}")
        for name, value in (("timeout_s", timeout_s), ("deadline_s", deadline_s), ("window_s", window_s)):
            _require_positive(name, value)
        limits = {"requests_per_minute": requests_per_minute, "tokens_per_minute": tokens_per_minute, "max_tokens_total": max_tokens_total}
        for name, limit in (limits | {"max_cost": max_cost, "max_request_bytes": max_request_bytes}).items():
            if limit is not None:
                _require_positive(name, limit)
        prices = _checked_prices(price_per_million, max_cost)
        self._model = model
        self._timeout_s, self._deadline_s = float(timeout_s), float(deadline_s)
        self._access = access_to(base_url, api_key_env, api_key_header, max_request_bytes)
        self._cache = make_cache(cache)
        self._budget = Budget(max_tokens_total, max_cost, prices, currency)
        self._estimates = TokenEstimates()
        self._capabilities = Capabilities(reply_format)
        self._client = ChatClient(self._access, client)
        self._draws = random.Random(seed)
        self._clock, self._sleep = clock, sleep
        where = (self._access.url, model, clock, sleep)
        self._pause = _PAUSES.setdefault(where, retries.Pause(clock))
        paced = (*where, requests_per_minute, tokens_per_minute, window_s)
        self._pacer = _PACERS.setdefault(paced, Pacer(requests_per_minute, tokens_per_minute, window_s, clock, sleep))
        self._probing: PerLoop[asyncio.Lock] = PerLoop(asyncio.Lock)
        self._probe_failures: list[ChatRequestError] = []

    def __repr__(self) -> str:
        return f"OpenAIChat({self._model!r}, {self._access.url!r}, key={self._access.key!r})"

    @property
    def name(self) -> str:
        """The model."""
        return self._model

    def usage(self) -> ChatUsage:
        """What was used so far."""
        return self._budget.used

    async def complete(self, request: ChatRequest) -> ChatReply:
        """Return the reply to one question. Many may be asked at once.

        Raises:
            ChatRequestError: no reply could be had; ``permanent`` if asking again is of no use.
            ChatReplyError: the reply is empty, refused, cut off, or far too long.
            BudgetExceeded: tokens or money are spent.
        """
        key = content_key(self._model, request)
        kept = self._cache.get(key)
        if kept is not None:
            self._budget.count(cached=1)
            return ChatReply(kept[0], kept[1], cached=True)
        deadline = retries.Deadline(self._deadline_s, self._clock)
        if request.schema is not None and self._capabilities.reply_format is None:
            await self._find_out_format(deadline)
        answer = await self._answer(request, deadline)
        if answer.fault:
            raise ChatReplyError(f"{self._model}: {answer.fault}")
        self._capabilities.see_reply(request, answer.text)
        model = answer.model or self._model
        if request.schema is None or json_objects_in(answer.text):  # prose instead of JSON is not worth keeping
            self._cache.put(key, answer.text, model)
        return ChatReply(answer.text, model, answer.prompt_tokens or 0, answer.completion_tokens or 0)

    async def aclose(self) -> None:
        """Close connections of the running event loop and the cache's file. The object can still be used: they are opened again."""
        self._cache.close()
        await self._client.aclose()

    async def _find_out_format(self, deadline: retries.Deadline) -> None:
        """Probe once; whoever asks meanwhile waits for it, and fails with it."""
        failures_before = len(self._probe_failures)
        async with self._probing.here():
            if self._capabilities.reply_format is not None:
                return
            if len(self._probe_failures) > failures_before:
                last = self._probe_failures[-1]
                raise ChatRequestError(str(last), last.permanent)
            try:
                self._capabilities.reply_format = await self._probe(deadline)
            except ChatRequestError as error:
                self._probe_failures.append(ChatRequestError(str(error), error.permanent))
                raise
        logger.info("%s at %s: replies as %s", self._model, self._access.host, self._capabilities.reply_format)

    async def _probe(self, deadline: retries.Deadline) -> wire.ReplyFormat:
        for tried in ("json_schema", "json_object"):
            reply_format: wire.ReplyFormat = "json_schema" if tried == "json_schema" else "json_object"
            if passes(reply_format, await self._answer(PROBE, deadline, reply_format)):
                return reply_format
        return "prompt"

    async def _answer(self, request: ChatRequest, deadline: retries.Deadline, reply_format: wire.ReplyFormat | None = None) -> wire.Answer:
        """The server's answer, with its tokens counted."""
        held = (self._estimates.prompt(request), request.max_tokens)
        self._budget.hold(*held)
        try:
            answer = await self._exchange(request, deadline, reply_format)
            if answer.prompt_tokens and answer.completion_tokens is not None:
                self._estimates.learn(request, answer.prompt_tokens, answer.completion_tokens)
            answer = self._counted(request, answer)
            self._budget.spend(answer.prompt_tokens or 0, answer.completion_tokens or 0)
        finally:
            self._budget.release(*held)
        return replace(
            answer, text=self._access.hide(answer.text), fault=self._access.hide(answer.fault), model=self._access.hide(answer.model)
        )

    def _counted(self, request: ChatRequest, answer: wire.Answer) -> wire.Answer:
        """The answer with tokens estimated where the server says nothing."""
        prompt = self._estimates.prompt(request) if answer.prompt_tokens is None else answer.prompt_tokens
        completion = tokens_of_text(answer.text) if answer.completion_tokens is None else answer.completion_tokens
        return replace(answer, prompt_tokens=prompt, completion_tokens=completion)

    async def _exchange(self, request: ChatRequest, deadline: retries.Deadline, reply_format: wire.ReplyFormat | None) -> wire.Answer:
        """Send, and again where it helps, until the server answers."""
        failures, known = 0, self._capabilities
        while True:
            body = wire.body_of(self._model, request, reply_format or known.format_for(request), known.token_field, known.with_temperature)
            self._require_length(body)
            place = await self._admitted(request, deadline)
            self._budget.count(requests=1, retries=int(failures > 0))
            received = await self._client.post(body, max(min(self._timeout_s, deadline.left_s()), 1e-3))
            status, answer = received.status, wire.Answer()
            if status == 200:
                answer = wire.answer_in(received.body) if not received.is_cut else _TOO_LONG
                status = answer.error_status or 200
            if status == 200:
                settled = self._counted(request, answer)
                place.settle((settled.prompt_tokens or 0) + (settled.completion_tokens or 0))
                return answer
            if status:
                place.settle(0)  # refused: it used no tokens; where nothing came back, nobody knows
            message = received.failure or self._said(received)
            if status and (known.learn_from_refusal(status, message) or (reply_format is None and known.step_down(status, message))):
                continue
            if reply_format is not None and refuses_format(status, message):  # a probe: this is its answer
                return wire.Answer(fault=message, prompt_tokens=0, completion_tokens=0)
            failures += 1
            await self._wait_or_raise(received, status, message, failures, deadline)

    async def _admitted(self, request: ChatRequest, deadline: retries.Deadline) -> Place:
        """Wait for the pause after a 429 and for the rate limits."""
        while True:
            pause_s = self._pause.left_s()
            if pause_s <= _SOON_S:
                prompt = self._estimates.prompt(request, cautious=True)
                place = await self._pacer.enter(prompt + self._estimates.completion(request), prompt + request.max_tokens)
                deadline.extend(place.waited_s)
                self._budget.count(waited_s=place.waited_s)
                if self._pause.left_s() <= _SOON_S:
                    return place
                place.leave()  # somebody got a 429 meanwhile
                continue
            if pause_s >= deadline.left_s():
                raise ChatRequestError(f"{self._access.host} takes no questions for another {pause_s:.3g} s; that is past the deadline")
            wait_s = retries.jittered_s(pause_s, self._draws)
            self._budget.count(waited_s=wait_s)
            await self._sleep(wait_s)

    async def _wait_or_raise(self, received: Received, status: int, message: str, failures: int, deadline: retries.Deadline) -> None:
        """Wait before asking again, or say why that is not done.

        Raises:
            ChatRequestError: asking again is of no use, or the deadline is near.
        """
        what = f"{self._access.host}: HTTP {status}: {message}" if status else f"{self._access.host}: {message}"
        is_spent = status == 429 and wire.is_quota_spent(received.body)
        if is_spent or (status and not retries.may_be_retried(status)) or received.headers.get("x-should-retry") == "false":
            hint = _HINTS.get(status, "")
            raise ChatRequestError(what + hint, permanent=is_spent or status in _OF_NO_USE)
        said_s = retries.wait_said(received.headers)
        wait_s = retries.own_wait_s(failures, self._draws) if said_s is None else retries.jittered_s(said_s, self._draws)
        if status == 429:
            self._pause.hold(wait_s)
        if wait_s >= deadline.left_s():
            tries = f"asked {failures} time{'s' * (failures > 1)}"
            raise ChatRequestError(f"{what} ({tries}; another try in {wait_s:.3g} s is past the deadline of {deadline.seconds:g} s)")
        logger.info("%s; asking again in %.3g s", what, wait_s)
        if status != 429:
            await self._sleep(wait_s)

    def _said(self, received: Received) -> str:
        """What the server says is wrong, short, and without the key."""
        said = excerpt(wire.error_text(received.body), 4000)
        return excerpt(self._access.hide(said)) or "no reason given"

    def _require_length(self, body: bytes) -> None:
        most = self._access.most_request_bytes
        if most is not None and len(body) > most:
            raise ChatRequestError(
                f"{self._access.host} takes {most / 1e6:.3g} MB a request; this question has {len(body) / 1e6:.3g} MB, "
                "images in base64 included: show it fewer or smaller images"
            )


_TOO_LONG = wire.Answer(fault=f"the reply is longer than {wire.MOST_REPLY_BYTES // 1000} kB; the rest was not read")
_HINTS = {
    401: " (the server refuses the key, or wants one: see api_key_env)",
    403: " (the key may not do this)",
    404: " (is the model's name right, and does base_url end as the server wants it, mostly in /v1?)",
    413: " (the images are too large for this server)",
}


def _require_positive(name: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not (math.isfinite(value) and value > 0):
        raise ConfigError(f"{name}: got {value!r:.60}, wanted a number above 0")


def _checked_prices(prices: Sequence[float] | None, max_cost: float | None) -> tuple[float, float] | None:
    if prices is None:
        if max_cost is not None:
            raise ConfigError("max_cost needs price_per_million = [prompt, completion]; without prices nothing is known of the cost")
        return None
    numbers = [p for p in prices if isinstance(p, int | float) and math.isfinite(p) and p >= 0] if isinstance(prices, list | tuple) else []
    if len(numbers) != 2 or len(prices) != 2:
        raise ConfigError(f"price_per_million: got {prices!r:.60}, wanted two numbers, of prompt and of completion tokens")
    return float(numbers[0]), float(numbers[1])
