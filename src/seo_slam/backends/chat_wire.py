"""Questions and answers as they go over the wire: OpenAI-compatible chat completions."""

import base64
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from seo_slam.agents.reply_schema import strict_schema
from seo_slam.agents.reply_text import excerpt
from seo_slam.errors import ChatRequestError, ConfigError
from seo_slam.interfaces import ChatRequest

ReplyFormat = Literal["json_schema", "json_object", "prompt"]

MOST_REPLY_BYTES = 256_000
"""A longer reply is not read to its end."""
MOST_ERROR_BYTES = 16_000
_MOST_TOKENS = 10_000_000  # a server that counts more is wrong


@dataclass(frozen=True, slots=True)
class Answer:
    """What a server answered with status 200.

    Attributes:
        text: of the reply.
        model: that gave it, as the server says; "" if it does not.
        prompt_tokens, completion_tokens: None where the server says nothing sensible.
        fault: why it is no reply; "" if it is one.
        error_status: the server reported an error, with this status, inside a 200; 0: it did not.
    """

    text: str = ""
    model: str = ""
    prompt_tokens: int | None = None
    completion_tokens: int | None = None
    fault: str = ""
    error_status: int = 0


def body_of(
    model: str, request: ChatRequest, reply_format: ReplyFormat | None, token_field: str = "max_tokens", with_temperature: bool = True
) -> bytes:
    """Return the body of a request.

    Args:
        model: which is asked.
        request: the question.
        reply_format: how the schema is said; None: not at all. A schema that strict servers refuse is said in words.
        token_field: what the server calls the most tokens of a reply.
        with_temperature: whether the model lets its temperature be set.

    Raises:
        ChatRequestError: an image is neither PNG nor JPEG.
    """
    system, asked_format = request.system, None
    if request.schema is not None and reply_format is not None:
        strict = _strict_or_none(request) if reply_format == "json_schema" else None
        if strict is not None:
            asked_format = {"type": "json_schema", "json_schema": {"name": _name(request.schema_name), "schema": strict, "strict": True}}
        else:
            asked_format = None if reply_format == "prompt" else {"type": "json_object"}
            system = f"{system}\n\n{_in_words(request)}".strip()
    messages: list[dict[str, Any]] = [{"role": "system", "content": system}] if system else []
    messages.append({"role": "user", "content": _content(request)})
    for reply, complaint in request.turns:
        messages += [{"role": "assistant", "content": reply}, {"role": "user", "content": complaint}]
    body: dict[str, Any] = {"model": model, "messages": messages, token_field: request.max_tokens}
    if with_temperature:
        body["temperature"] = request.temperature
    if asked_format is not None:
        body["response_format"] = asked_format
    return json.dumps(body).encode()


def answer_in(body: bytes) -> Answer:
    """Return what stands in the body of a response with status 200, whatever it is."""
    try:
        said = json.loads(body)
    except (ValueError, RecursionError):
        return Answer(fault=f"the server's answer is no JSON: {excerpt(body[:400].decode(errors='replace'), 100)!r}")
    if not isinstance(said, dict):
        return Answer(fault="the server's answer is no JSON object")
    choices = said.get("choices")
    if not isinstance(choices, list) or not choices:
        if said.get("error"):
            return Answer(fault=error_text(body), error_status=_status_in(said["error"]))
        return Answer(fault="the server's answer has no choices")
    usage, choice = _object(said.get("usage")), _object(choices[0])
    message = _object(choice.get("message"))
    text = _text_of(message.get("content"))
    return Answer(
        text=text,
        model=excerpt(said["model"], 100) if isinstance(said.get("model"), str) else "",
        prompt_tokens=_count(usage.get("prompt_tokens")),
        completion_tokens=_count(usage.get("completion_tokens")),
        fault=_fault(text, message, choice.get("finish_reason")),
    )


def error_text(body: bytes) -> str:
    """Return what a server says is wrong: the message in its JSON, else what it sent."""
    raw = body.decode(errors="replace")
    try:
        said = json.loads(raw)
    except (ValueError, RecursionError):
        return raw
    for key in ("error", "message", "detail"):
        if isinstance(said, dict) and said.get(key):
            said = said[key]
    return said if isinstance(said, str) else raw


def is_quota_spent(body: bytes) -> bool:
    """Return whether a 429 means that the account has no money left, which waiting does not change."""
    return b"insufficient_quota" in body[:MOST_ERROR_BYTES]


def unpacked(body: bytes, encoding: str, most: int) -> bytes | None:
    """Return at most ``most`` + 1 bytes of a body that came compressed though nobody asked for it; None if it cannot be read."""
    if encoding.strip().lower() not in ("gzip", "x-gzip", "deflate"):
        return None
    try:
        return zlib.decompressobj(wbits=47).decompress(body, most + 1)
    except zlib.error:
        return None


def _content(request: ChatRequest) -> list[dict[str, Any]]:
    parts: list[dict[str, Any]] = [{"type": "text", "text": request.text}]
    for number, image in enumerate(request.images, start=1):
        data = base64.b64encode(image).decode()
        parts.append({"type": "image_url", "image_url": {"url": f"data:image/{_kind(image, number)};base64,{data}"}})
    return parts


def _kind(image: bytes, number: int) -> str:
    if image[:3] == b"\xff\xd8\xff":
        return "jpeg"
    if image[:8] == b"\x89PNG\r\n\x1a\n":
        return "png"
    raise ChatRequestError(f"image {number} of a question begins with {image[:8]!r}; wanted a JPEG or PNG file")


def _strict_or_none(request: ChatRequest) -> dict[str, Any] | None:
    try:
        return strict_schema(request.schema or {}, request.schema_name)
    except ConfigError:
        return None


def _in_words(request: ChatRequest) -> str:
    schema = json.dumps(_strict_or_none(request) or request.schema, default=dict)
    return f"Reply with one JSON object and nothing else: no words around it, no code fence. It must fit this JSON schema:\n{schema}"


def _name(name: str) -> str:
    allowed = "".join(c if c.isascii() and (c.isalnum() or c in "_-") else "_" for c in name)
    return allowed[:64] or "reply"


def _text_of(content: Any) -> str:
    """Content is text, or with some servers a list of parts."""
    if isinstance(content, list):
        parts = [part.get("text") for part in content if isinstance(part, dict)]
        return "".join(part for part in parts if isinstance(part, str))
    return content if isinstance(content, str) else ""


def _fault(text: str, message: Mapping[str, Any], finish_reason: Any) -> str:
    refusal = message.get("refusal")
    if refusal:
        return f"the model refused: {excerpt(str(refusal))}"
    if finish_reason == "content_filter":
        return "the server's content filter held the reply back"
    if finish_reason == "length":
        return "the reply was cut off at max_tokens"
    if text.strip():
        return ""
    if message.get("reasoning") or message.get("reasoning_content"):
        return "the model thought and said nothing; a model that reasons needs more max_tokens"
    return "the reply is empty"


def _object(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _status_in(error: Any) -> int:
    code = error.get("code", error.get("status")) if isinstance(error, dict) else None
    return code if isinstance(code, int) and not isinstance(code, bool) and 400 <= code <= 599 else 400


def _count(value: Any) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _MOST_TOKENS else None
