"""What a chat server can do: hold a reply to a JSON schema, to JSON, or neither. Found out by asking, since servers do not say.

Some take ``response_format`` and answer with prose and HTTP 200 all the same (fail open). So the probe asks for small talk: only a server
that holds the reply to the schema answers with JSON of that form.
"""

import json
import logging
from typing import Any, Literal

from seo_slam.backends.chat_wire import Answer, ReplyFormat
from seo_slam.interfaces import ChatRequest

logger = logging.getLogger(__name__)

FormatOption = Literal["auto", "json_schema", "json_object", "prompt"]

PROBE = ChatRequest(
    system="You are friendly. If you are asked for JSON, you reply in JSON.",
    text="Say good morning in one short sentence.",
    schema={
        "type": "object",
        "properties": {"seo_slam_probe": {"type": "boolean"}, "sentence": {"type": "string"}},
        "required": ["seo_slam_probe", "sentence"],
        "additionalProperties": False,
    },
    schema_name="seo_slam_probe",
    temperature=0.0,
)
_ABOUT_FORMAT = ("response_format", "json_schema", "json_object", "schema", "grammar")
_MOST_NAMES = 64


class Capabilities:
    """What is known of a server and model.

    Attributes:
        reply_format: the best that works; None: not known yet.
        token_field: what it calls the most tokens of a reply.
        with_temperature: whether it lets the temperature be set.
    """

    def __init__(self, option: FormatOption) -> None:
        """Take the option: "auto", or what the user says works."""
        self.is_auto = option == "auto"
        self.reply_format: ReplyFormat | None = None if option == "auto" else option
        self.token_field = "max_tokens"
        self.with_temperature = True
        self._failed_open: set[str] = set()

    def format_for(self, request: ChatRequest) -> ReplyFormat | None:
        """How the schema of a request is to be said; None if it has none."""
        if request.schema is None:
            return None
        known = self.reply_format or "prompt"
        return "json_object" if known == "json_schema" and request.schema_name in self._failed_open else known

    def learn_from_refusal(self, status: int, message: str) -> bool:
        """Take a refusal of a parameter; True if the same question should be asked again in the other way."""
        said = message.lower()
        if status not in (400, 422):
            return False
        if "max_completion_tokens" in said and self.token_field == "max_tokens":
            self.token_field = "max_completion_tokens"
            return True
        if "temperature" in said and "support" in said and self.with_temperature:
            self.with_temperature = False
            logger.info("this model does not let its temperature be set; it is left out")
            return True
        return False

    def step_down(self, status: int, message: str) -> bool:
        """Take a refusal of the reply format; True if a simpler one is left and may be chosen."""
        if not self.is_auto or self.reply_format in (None, "prompt") or status not in (400, 422) or not _is_about_format(message):
            return False
        self.reply_format = "json_object" if self.reply_format == "json_schema" else "prompt"
        return True

    def see_reply(self, request: ChatRequest, text: str) -> None:
        """Notice a reply that is no JSON though the server was to hold it to a schema; that schema is said in words from now on."""
        if request.schema is None or self.reply_format != "json_schema" or _loaded(text) is not None:
            return
        if len(self._failed_open) < _MOST_NAMES and request.schema_name not in self._failed_open:
            logger.warning("the server did not hold a reply to the schema %.40r; it is said in words from now on", request.schema_name)
            self._failed_open.add(request.schema_name)


def refuses_format(status: int, message: str) -> bool:
    """Return whether an error, in answer to the probe, means that the format is not known there."""
    return status in (400, 415, 422) or (status == 404 and _is_about_format(message))


def passes(reply_format: ReplyFormat, answer: Answer) -> bool:
    """Return whether an answer to the probe shows that a format works."""
    if not answer.text:
        return False
    said = _loaded(answer.text)
    if said is None:  # cut off, but JSON so far
        return answer.text.lstrip().startswith("{") and "cut off" in answer.fault
    return reply_format == "json_object" or set(said) == {"seo_slam_probe", "sentence"}


def _is_about_format(message: str) -> bool:
    said = message.lower()
    return any(word in said for word in _ABOUT_FORMAT)


def _loaded(text: str) -> dict[str, Any] | None:
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return said if isinstance(said, dict) else None
