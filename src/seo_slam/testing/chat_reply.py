"""What the chat server is about to send, as data that a fault can change."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class WireReply:
    """An HTTP reply of the chat server, not yet sent.

    Attributes:
        text: what the model says; None: ``message.content`` is null.
        finish_reason: "stop", or "length" where it was cut.
        message: further entries of the message, such as "refusal".
        status: of HTTP; where it is not 200, ``error`` is sent and not the text.
        error: in words.
        headers: further headers.
        hangs: it is never sent.
        sent_share: share of its body that is sent before the connection is closed; 1.0: all of it, and the connection stays.
        server_dies: instead of sending it, the server stops for good.
    """

    text: str | None = None
    finish_reason: str = "stop"
    message: Mapping[str, Any] = field(default_factory=dict)
    status: int = 200
    error: str = ""
    headers: Mapping[str, str] = field(default_factory=dict)
    hangs: bool = False
    sent_share: float = 1.0
    server_dies: bool = False

    def body(self, number: int, model: str, prompt_tokens: int, completion_tokens: int) -> bytes:
        """Return the JSON body: a chat completion, or an error."""
        if self.status != 200:
            kind = "invalid_request_error" if self.status < 500 else "server_error"
            return json.dumps({"error": {"message": self.error, "type": kind, "code": self.status}}).encode()
        reply = {
            "id": f"chatcmpl-{number}",
            "object": "chat.completion",
            "created": 0,
            "model": model,
            "choices": [
                {
                    "index": 0,
                    "message": {"role": "assistant", "content": self.text, **self.message},
                    "finish_reason": self.finish_reason,
                    "logprobs": None,
                }
            ],
            "usage": {
                "prompt_tokens": prompt_tokens,
                "completion_tokens": completion_tokens,
                "total_tokens": prompt_tokens + completion_tokens,
            },
        }
        return json.dumps(reply).encode()
