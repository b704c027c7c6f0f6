"""Turns the JSON of a chat completion into a ``ChatRequest``."""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any

from seo_slam.interfaces import ChatRequest
from seo_slam.testing.chat_http import BadHttp


@dataclass(frozen=True, slots=True)
class WireRequest:
    """What came over the wire.

    Attributes:
        chat: the question, in the form in which a chat model is asked. Where any JSON object will do, its schema is ``{"type": "object"}``.
        model: that was asked for.
        format: "json_schema", "json_object", or "text".
    """

    chat: ChatRequest
    model: str
    format: str


def parse_request(body: bytes) -> WireRequest:
    """Read the body of a chat completion.

    Raises:
        BadHttp: it is not one; says what is wrong, as a 400.
    """
    try:
        asked = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise BadHttp(400, f"the body is not JSON: {error}") from error
    if not isinstance(asked, dict) or not isinstance(asked.get("model"), str):
        raise BadHttp(400, "'model' is missing")
    if asked.get("stream"):
        raise BadHttp(400, "'stream' is not supported")
    system, questions, replies, images = _messages(asked.get("messages"))
    format_, schema_name, schema = _format(asked.get("response_format"))
    chat = ChatRequest(
        system=system,
        text=questions[0],
        images=tuple(images),
        schema=schema,
        schema_name=schema_name,
        turns=tuple(zip(replies, questions[1:], strict=False)),
        temperature=_number(asked, "temperature", 1.0),
        max_tokens=int(_number(asked, "max_completion_tokens", _number(asked, "max_tokens", 1000))),
    )
    return WireRequest(chat, asked["model"], format_)


def _messages(messages: Any) -> tuple[str, list[str], list[str], list[bytes]]:
    """System text, user texts, assistant texts and images of a conversation."""
    if not isinstance(messages, list) or not messages:
        raise BadHttp(400, "'messages' is missing")
    texts: dict[str, list[str]] = {"system": [], "user": [], "assistant": []}
    images: list[bytes] = []
    for number, message in enumerate(messages):
        role = message.get("role") if isinstance(message, dict) else None
        role = "system" if role == "developer" else role
        if role not in texts:
            raise BadHttp(400, f"messages[{number}].role is {role!r}, wanted system, user or assistant")
        texts[role].append(_content(message.get("content"), number, images))
    if not texts["user"]:
        raise BadHttp(400, "no message of the user")
    return "\n".join(texts["system"]), texts["user"], texts["assistant"], images


def _content(content: Any, number: int, images: list[bytes]) -> str:
    if content is None or isinstance(content, str):
        return content or ""
    if not isinstance(content, list):
        raise BadHttp(400, f"messages[{number}].content is neither text nor a list")
    texts = []
    for part in content:
        kind = part.get("type") if isinstance(part, dict) else None
        if kind == "text" and isinstance(part.get("text"), str):
            texts.append(part["text"])
        elif kind == "image_url" and isinstance(part.get("image_url"), dict):
            images.append(_image(part["image_url"].get("url"), number))
        else:
            raise BadHttp(400, f"messages[{number}] has a part of type {kind!r}, wanted text or image_url")
    return "\n".join(texts)


def _image(url: Any, number: int) -> bytes:
    head, comma, data = url.partition(",") if isinstance(url, str) else ("", "", "")
    if not (comma and head.startswith("data:image/") and head.endswith(";base64")):
        raise BadHttp(400, f"messages[{number}]: an image is no data URL in base64; nothing is fetched from elsewhere")
    try:
        return base64.b64decode(data, validate=True)
    except binascii.Error as error:
        raise BadHttp(400, f"messages[{number}]: an image is not base64") from error


def _format(asked: Any) -> tuple[str, str, dict[str, Any] | None]:
    """Kind of reply, name of the schema, schema."""
    if asked is None:
        return "text", "reply", None
    kind = asked.get("type") if isinstance(asked, dict) else None
    if kind == "text":
        return "text", "reply", None
    if kind == "json_object":
        return "json_object", "reply", {"type": "object"}
    described = asked.get("json_schema") if kind == "json_schema" else None
    if not isinstance(described, dict) or not isinstance(described.get("schema"), dict):
        raise BadHttp(400, "response_format is none of text, json_object, json_schema with a schema")
    return "json_schema", str(described.get("name", "reply")), described["schema"]


def _number(asked: dict[str, Any], key: str, default: float) -> float:
    value = asked.get(key, default)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadHttp(400, f"{key!r} is not a number")
    return float(value)
