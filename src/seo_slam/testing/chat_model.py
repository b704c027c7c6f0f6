"""Contract of a ``ChatModel``."""

import asyncio
import base64
import inspect
import threading
from collections.abc import Coroutine
from typing import Any

from seo_slam.errors import AgentError
from seo_slam.interfaces import ChatModel, ChatReply, ChatRequest
from seo_slam.testing.clauses import require

# A red PNG of 8x8 pixels.
_IMAGE = base64.b64decode("iVBORw0KGgoAAAANSUhEUgAAAAgAAAAICAIAAABLbSncAAAAEklEQVR4nGP4z8CAFWEXHbQSACj/P8Fu7N9hAAAAAElFTkSuQmCC")
_SCHEMA = {"type": "object", "properties": {"word": {"type": "string"}}, "required": ["word"], "additionalProperties": False}
_PLAIN = ChatRequest("You are brief.", "Say a word.")
_REQUESTS = (
    _PLAIN,
    ChatRequest("You are brief.", 'Which colour is this? Reply in JSON.\n{"landmarks": []}', (_IMAGE,), _SCHEMA, "colour"),
    ChatRequest("", "Name a fruit, as JSON.", schema=_SCHEMA, turns=(("Which one?", "That was no JSON."),), temperature=0.0, max_tokens=50),
)
_PATIENCE_S = 5.0


def check_chat_model(model: ChatModel) -> None:
    """Check that a chat model answers with text or an ``AgentError``, many at once, in any event loop, and can be cancelled.

    It is asked about ten short questions, some with an image. It may be called within a running event loop.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(model, ChatModel), model, "lacks name or complete(request)")
    require(isinstance(model.name, str) and bool(model.name), model, f"name is {model.name!r}, wanted text")
    answered = _run(_ask_all(model))
    require(answered > 0, model, "answered none of the questions: every one ended with an AgentError")
    _run(_ask_all(model))  # another event loop
    _run(_cancel(model))


async def _ask_all(model: ChatModel) -> int:
    """How many of the questions, asked at once, were answered."""
    outcomes = await asyncio.gather(*(_asked(model, request) for request in _REQUESTS))
    for reply in outcomes:
        if isinstance(reply, AgentError):
            continue
        require(isinstance(reply, ChatReply), model, f"complete returned {type(reply).__name__}, wanted ChatReply")
        require(
            isinstance(reply.text, str) and bool(reply.text.strip()), model, f"a reply's text is {reply.text!r:.60}; raise ChatReplyError"
        )
        require(isinstance(reply.model, str), model, f"a reply's model is {reply.model!r:.60}, wanted text")
        for name in ("prompt_tokens", "completion_tokens"):
            count = getattr(reply, name)
            require(isinstance(count, int) and count >= 0, model, f"{name} is {count!r:.60}, wanted a whole number, 0 or more")
    return sum(isinstance(reply, ChatReply) for reply in outcomes)


async def _asked(model: ChatModel, request: ChatRequest) -> Any:
    waited_for = model.complete(request)
    require(inspect.isawaitable(waited_for), model, "complete is no async function")
    try:
        return await waited_for
    except AgentError as error:
        return error
    except Exception as error:
        raise AssertionError(f"{type(model).__name__}: complete raised {type(error).__name__}: {error}; wanted an AgentError") from error


async def _cancel(model: ChatModel) -> None:
    task = asyncio.ensure_future(model.complete(_PLAIN))
    await asyncio.sleep(0)
    task.cancel()
    done, _ = await asyncio.wait({task}, timeout=_PATIENCE_S)
    require(bool(done), model, f"a cancelled question went on for {_PATIENCE_S:g} s")
    if not task.cancelled() and task.exception() is not None:
        require(isinstance(task.exception(), AgentError), model, f"a cancelled question ended with {task.exception()!r:.80}")


def _run(coroutine: Coroutine[Any, Any, Any]) -> Any:
    """Run in an event loop of its own, in a thread of its own: the caller may be within a running loop."""
    outcome: list[Any] = []

    def run() -> None:
        try:
            outcome.append(asyncio.run(coroutine))
        except Exception as error:  # noqa: BLE001  # raised again by the caller's thread
            outcome.append(error)

    thread = threading.Thread(target=run, name="check_chat_model")
    thread.start()
    thread.join()
    if isinstance(outcome[0], Exception):
        raise outcome[0]
    return outcome[0]
