"""Sends one HTTP request and reads a bounded part of the response. The only file that knows httpx."""

import asyncio
import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import httpx

from seo_slam.agents.reply_text import excerpt
from seo_slam.backends.chat_access import Access
from seo_slam.backends.chat_loops import ClosedWithLoop, PerLoop
from seo_slam.backends.chat_wire import MOST_ERROR_BYTES, MOST_REPLY_BYTES, unpacked


@dataclass(frozen=True, slots=True)
class Received:
    """What came back.

    Attributes:
        status: of HTTP; 0: nothing came.
        headers: names in lower case.
        body: as far as it was read.
        is_cut: there was more than is read.
        failure: why nothing came.
    """

    status: int = 0
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""
    is_cut: bool = False
    failure: str = ""


class ChatClient:
    """Posts to one server, from any event loop: a client of httpx belongs to the loop it is used in, so each loop has its own.

    Args:
        access: the way to the server.
        client: an ``httpx.AsyncClient``, or one of httpx2, to be used instead of own ones; it is not closed here.
    """

    def __init__(self, access: Access, client: Any = None) -> None:
        self._access = access
        self._injected = client
        self._clients: PerLoop[ClosedWithLoop[httpx.AsyncClient]] = PerLoop(self._make)
        self._failures = _failures_of(client)

    async def post(self, body: bytes, timeout_s: float) -> Received:
        """Send a body and return the response; a failure of the network is one, too. Nothing takes longer than ``timeout_s``."""
        client = self._injected if self._injected is not None else await self._clients.here().armed()
        try:
            async with asyncio.timeout(timeout_s):
                return await self._exchange(client, body, timeout_s)
        except TimeoutError:
            failure = f"no complete answer within {timeout_s:.3g} s"
        except self._failures as error:
            failure = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        return Received(failure=excerpt(self._access.hide(failure)))

    async def aclose(self) -> None:
        """Close the client of the running loop; those of other loops close with their loops. May be called twice."""
        mine = self._clients.forget()
        if mine is not None:
            await mine.aclose()

    async def _exchange(self, client: Any, body: bytes, timeout_s: float) -> Received:
        request = client.stream("POST", self._access.url, content=body, headers=self._access.headers(), timeout=timeout_s)
        async with request as response:
            headers = {name.lower(): value for name, value in response.headers.items()}
            most = MOST_REPLY_BYTES if response.status_code == 200 else MOST_ERROR_BYTES
            encoding = headers.get("content-encoding", "identity")
            is_packed = encoding.lower() not in ("", "identity")
            read = bytearray()
            async for chunk in response.aiter_raw() if is_packed else response.aiter_bytes():
                read += chunk
                if len(read) > most:
                    break
        raw = bytes(read[: most + 1])
        if is_packed:
            plain = unpacked(raw, encoding, most)
            if plain is None:
                return Received(failure=f"the answer came in the encoding {excerpt(encoding, 20)!r}, which was not asked for")
            raw = plain
        return Received(response.status_code, headers, raw[:most], len(raw) > most)

    def _make(self) -> ClosedWithLoop[httpx.AsyncClient]:
        # A proxy of the environment has no business between us and our own machine. Plain http needs no certificates, which take
        # a good part of a second to load.
        made = httpx.AsyncClient(trust_env=not self._access.is_loopback, verify=not self._access.url.startswith("http://"))
        return ClosedWithLoop(made, httpx.AsyncClient.aclose)


def _failures_of(client: Any) -> tuple[type[Exception], ...]:
    """What a client raises when the network fails; one of httpx2 has exceptions of its own."""
    kinds: list[type[Exception]] = [httpx.RequestError, httpx.StreamError, OSError]
    for parent in type(client).__mro__:
        package = importlib.import_module(parent.__module__.partition(".")[0])
        for name in ("RequestError", "StreamError"):
            kind = getattr(package, name, None)
            if isinstance(kind, type) and issubclass(kind, Exception):
                kinds.append(kind)
    return tuple(kinds)
