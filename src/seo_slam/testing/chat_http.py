"""As much of HTTP/1.1 as a chat server on the loopback needs: requests with a length, replies with a length, connections that stay."""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from http import HTTPStatus

_MOST_HEADERS = 100


class BadHttp(Exception):  # noqa: N818
    """A request that cannot be read. Its text is what the client is told."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True, slots=True)
class HttpRequest:
    """A request. Names of headers are in small letters."""

    method: str
    path: str
    headers: Mapping[str, str]
    body: bytes
    keep_alive: bool


async def read_request(reader: asyncio.StreamReader, most_bytes: int) -> HttpRequest | None:
    """Read the next request of a connection; None where the client closed it.

    Raises:
        BadHttp: it cannot be read.
        ConnectionError: the connection broke.
    """
    first = await _line(reader)
    if not first:
        return None
    words = first.split()
    if len(words) != 3:
        raise BadHttp(400, "not an HTTP request")
    headers: dict[str, str] = {}
    while line := await _line(reader):
        name, _, value = line.partition(":")
        headers[name.strip().casefold()] = value.strip()
        if len(headers) > _MOST_HEADERS:
            raise BadHttp(431, "too many headers")
    body = await _body(reader, headers, most_bytes)
    keep_alive = words[2] == "HTTP/1.1" and headers.get("connection", "").casefold() != "close"
    return HttpRequest(words[0], words[1].partition("?")[0], headers, body, keep_alive)


async def _line(reader: asyncio.StreamReader) -> str:
    try:
        return (await reader.readline()).decode("latin-1").strip("\r\n")
    except ValueError as error:  # longer than the reader's limit
        raise BadHttp(431, "a header is too long") from error


async def _body(reader: asyncio.StreamReader, headers: Mapping[str, str], most_bytes: int) -> bytes:
    if "transfer-encoding" in headers:
        raise BadHttp(411, "chunked bodies are not taken; send Content-Length")
    length = headers.get("content-length", "0")
    if not (length.isascii() and length.isdigit()):
        raise BadHttp(400, "Content-Length is not a number")
    if int(length) > most_bytes:
        raise BadHttp(413, f"the request has {length} bytes, the most is {most_bytes}")
    try:
        return await reader.readexactly(int(length))
    except asyncio.IncompleteReadError as error:
        raise ConnectionResetError("closed in the middle of a request") from error


def reply_bytes(status: int, body: bytes, headers: Mapping[str, str], keep_alive: bool) -> bytes:
    """Return a reply with JSON in it, ready to be sent."""
    reason = HTTPStatus(status).phrase if status in HTTPStatus._value2member_map_ else "Unknown"
    lines = [f"HTTP/1.1 {status} {reason}", "Content-Type: application/json", f"Content-Length: {len(body)}"]
    lines += [f"{name}: {value}" for name, value in headers.items()]
    lines.append(f"Connection: {'keep-alive' if keep_alive else 'close'}")
    return "\r\n".join([*lines, "", ""]).encode("latin-1") + body


def error_body(status: int, message: str) -> bytes:
    """Return the JSON of an error."""
    return json.dumps({"error": {"message": message, "type": "invalid_request_error", "code": status}}).encode()
