"""A chat server for tests: OpenAI-compatible chat completions on a loopback socket.

It is answered by a script, by a function, or by the simulated vision-language model. One thread runs everything; ``answers`` is called
in it, for one question at a time, and must not wait (``latency_s`` does the waiting).
"""

import asyncio
import hmac
import json
import logging
import random
import socket
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Self

from seo_slam.errors import ConfigError
from seo_slam.simulation.chat_question import role_of
from seo_slam.testing.chat_desk import Answers, Decision, ReplyDesk, Support
from seo_slam.testing.chat_faults import Fault
from seo_slam.testing.chat_http import BadHttp, HttpRequest, error_body, read_request, reply_bytes
from seo_slam.testing.chat_limits import Seen, SlidingLimit
from seo_slam.testing.chat_reply import WireReply
from seo_slam.testing.chat_wire import parse_request

logger = logging.getLogger(__name__)

_LOOK_EVERY_S = 0.1  # how often a waiting request looks whether its client is still there
_CLOSE_WITHIN_S = 5.0


class ChatServer:
    """A chat server, running between ``with ChatServer(…) as server:`` and the end of the block."""

    def __init__(
        self,
        answers: Answers,
        *,
        latency_s: float = 0.0,
        jitter_s: float = 0.0,
        requests_per_minute: int | None = None,
        tokens_per_minute: int | None = None,
        window_s: float = 60.0,
        retry_after: bool = True,
        faults: Fault | Sequence[Fault] = (),
        supports: Support = "json_schema",
        fails_open: bool = False,
        api_key: str | None = None,
        model: str | Sequence[str] | None = None,
        most_bytes: int = 20_000_000,
        port: int = 0,
        seed: int = 0,
    ) -> None:
        """Describe a server; ``start`` or ``with`` starts it.

        Args:
            answers: a function from question to reply, for example a ``SimulatedChat``; or replies in their order, the last one for
                all questions beyond. A reply is a text or a fault.
            latency_s: from question to answer; errors come at once.
            jitter_s: up to so much longer, drawn by the seed and the number of the request.
            requests_per_minute: more than so many in any ``window_s`` get a 429.
            tokens_per_minute: likewise. A request is let in if its prompt and its ``max_tokens`` fit; then what was said counts.
            window_s: length of the "minute", so that a test need not take one.
            retry_after: whether a 429 of these limits has the header ``Retry-After`` (whole seconds, rounded up).
            faults: what goes wrong; of several, the first one that strikes.
            supports: the most that it can do with ``response_format``: hold to a schema, to JSON, or to neither.
            fails_open: what it cannot do it ignores, and answers in a code fence with words around it; else it answers 400.
            api_key: the key that requests must bear; None: any or none.
            model: name or names that it serves, others get a 404; None: any.
            most_bytes: longer requests get a 413.
            port: of 127.0.0.1; 0: any free one.
            seed: of jitter and of faults that strike by share.

        Raises:
            ConfigError: a negative latency, a limit below 1, no answers, an unknown ``supports``.
        """
        if latency_s < 0 or jitter_s < 0:
            raise ConfigError(f"chat server: got latency_s={latency_s}, jitter_s={jitter_s}, wanted 0 or more")
        self._desk = ReplyDesk(
            answers,
            faults=(faults,) if isinstance(faults, Fault) else tuple(faults),
            supports=supports,
            fails_open=fails_open,
            models=(model,) if isinstance(model, str) else None if model is None else tuple(model),
            requests=SlidingLimit("requests", requests_per_minute, window_s),
            tokens=SlidingLimit("tokens", tokens_per_minute, window_s),
            retry_after=retry_after,
            seed=seed,
        )
        self._latency_s, self._jitter_s, self._seed = latency_s, jitter_s, seed
        self._api_key, self._most_bytes, self._port = api_key, most_bytes, port
        self._log = _Log()
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop = asyncio.Event()
        self._connections: set[asyncio.Task[None]] = set()

    @property
    def base_url(self) -> str:
        """Where it is, for a client: ``http://127.0.0.1:PORT/v1``.

        Raises:
            ConfigError: it was never started.
        """
        if not self._port:
            raise ConfigError("chat server: it has no address before it is started; use `with ChatServer(…) as server:`")
        return f"http://127.0.0.1:{self._port}/v1"

    @property
    def requests(self) -> tuple[Seen, ...]:
        """Every chat completion that was asked for and is done with, in the order they came."""
        return self._log.entries()

    @property
    def in_flight(self) -> int:
        """How many requests wait for their answer now."""
        return self._log.in_flight

    @property
    def most_in_flight(self) -> int:
        """How many requests ever waited at once."""
        return self._log.most_in_flight

    def start(self) -> Self:
        """Listen, and answer from a thread of its own. After ``close`` it starts again at the same address; the log goes on."""
        if self._thread is None or not self._thread.is_alive():
            listening = socket.create_server(("127.0.0.1", self._port), backlog=256)
            self._port = int(listening.getsockname()[1])
            ready = threading.Event()
            self._thread = threading.Thread(target=asyncio.run, args=(self._serve(listening, ready),), name="seo_slam chat server")
            self._thread.daemon = True
            self._thread.start()
            ready.wait(_CLOSE_WITHIN_S)
        return self

    def close(self) -> None:
        """Break all connections and end the thread, whatever is waiting. May be called twice."""
        thread, self._thread = self._thread, None
        if thread is None or self._loop is None:
            return
        try:
            self._loop.call_soon_threadsafe(self._stop.set)
        except RuntimeError:  # its loop is closed: it died
            logger.debug("the chat server had stopped already")
        thread.join(_CLOSE_WITHIN_S)

    def __enter__(self) -> Self:
        """Start."""
        return self.start()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close."""
        self.close()

    async def _serve(self, listening: socket.socket, ready: threading.Event) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        server = await asyncio.start_server(self._serve_connection, sock=listening, backlog=256)
        ready.set()
        await self._stop.wait()
        server.close()
        while self._connections:
            waiting = tuple(self._connections)
            for task in waiting:
                task.cancel()
            await asyncio.wait(waiting)
        await asyncio.sleep(0)  # lets the transports close their sockets

    async def _serve_connection(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        if task is None or self._stop.is_set():
            writer.transport.abort()
            return
        self._connections.add(task)
        try:
            while await self._serve_request(reader, writer):
                pass
            await writer.drain()
            writer.close()
        except (ConnectionError, asyncio.CancelledError):
            writer.transport.abort()
        finally:
            self._connections.discard(task)

    async def _serve_request(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Answer one request of a connection; False where the connection is to be closed."""
        try:
            http = await read_request(reader, self._most_bytes)
            if http is None:
                return False
            if http.method == "POST" and http.path.endswith("/chat/completions"):
                return await self._complete(http, reader, writer)
            if http.method != "GET" or not http.path.endswith("/models"):
                raise BadHttp(404, f"nothing is at {http.method} {http.path}")
            self._require_key(http)
        except BadHttp as bad:
            writer.write(reply_bytes(bad.status, error_body(bad.status, str(bad)), {}, keep_alive=False))
            return False
        models = [{"id": name, "object": "model", "created": 0, "owned_by": "seo_slam"} for name in self._desk.models or ()]
        writer.write(reply_bytes(200, json.dumps({"object": "list", "data": models}).encode(), {}, http.keep_alive))
        return http.keep_alive

    def _require_key(self, http: HttpRequest) -> None:
        if self._api_key is None:
            return
        borne = http.headers.get("authorization", "").removeprefix("Bearer ") or http.headers.get("api-key", "")
        if not hmac.compare_digest(borne.encode(), self._api_key.encode()):
            raise BadHttp(401, "the API key is missing or not valid")

    async def _complete(self, http: HttpRequest, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        """Answer a chat completion, and write it into the log whatever becomes of it."""
        number, came_s = self._log.came()
        model, role, status, decision = "", "other", 0, Decision(WireReply())
        try:
            try:
                self._require_key(http)
                asked = parse_request(http.body)
                model, role = asked.model, role_of(asked.chat)
                decision = self._desk.decide(asked, number, came_s)
            except BadHttp as bad:
                decision = Decision(WireReply(status=bad.status, error=str(bad)))
            reply = decision.reply
            if reply.server_dies:
                self._stop.set()
            if not await self._wait(reply, number, came_s, reader):
                return False
            body = reply.body(number, model, decision.prompt_tokens, decision.completion_tokens)
            whole = reply_bytes(reply.status, body, reply.headers, http.keep_alive)
            cut = int(reply.sent_share * len(body)) - len(body)
            writer.write(whole[: len(whole) + cut])
            await writer.drain()
            status = reply.status
            return http.keep_alive and not cut
        finally:
            seen = Seen(number, came_s, model, role, decision.prompt_tokens, decision.completion_tokens, status, 0.0)
            self._log.done(seen)

    async def _wait(self, reply: WireReply, number: int, came_s: float, reader: asyncio.StreamReader) -> bool:
        """Wait until a reply is due; False if the client has gone away meanwhile."""
        due_s = came_s
        if reply.hangs or reply.server_dies:
            due_s = float("inf")
        elif reply.status == 200:
            due_s += self._latency_s
            if self._jitter_s:
                due_s += self._jitter_s * random.Random(f"{self._seed}|jitter|{number}").random()
        while (left_s := due_s - self._log.now_s()) > 0:
            await asyncio.sleep(min(left_s, _LOOK_EVERY_S))
            if reader.at_eof():
                return False
        return True


class _Log:
    """Requests as they come and go; asked from other threads too."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._started_s = time.monotonic()
        self._seen: list[Seen] = []
        self._count = 0
        self.in_flight = 0
        self.most_in_flight = 0

    def now_s(self) -> float:
        return time.monotonic() - self._started_s

    def came(self) -> tuple[int, float]:
        with self._lock:
            self._count += 1
            self.in_flight += 1
            self.most_in_flight = max(self.most_in_flight, self.in_flight)
            return self._count, self.now_s()

    def done(self, seen: Seen) -> None:
        with self._lock:
            self.in_flight -= 1
            self._seen.append(replace(seen, seconds=self.now_s() - seen.time_s))

    def entries(self) -> tuple[Seen, ...]:
        with self._lock:
            return tuple(sorted(self._seen, key=lambda seen: seen.number))
