"""Asks a chat model for a reply of a given type: validate, one repair turn, then give up."""

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from seo_slam.agents.reply_json import json_objects_in
from seo_slam.agents.reply_schema import schema_of as schema_of
from seo_slam.agents.reply_text import excerpt
from seo_slam.errors import ChatReplyError
from seo_slam.interfaces import ChatModel, ChatRequest

logger = logging.getLogger(__name__)

Reply = TypeVar("Reply", bound=BaseModel)

MOST_ECHOED = 1000
"""Characters of a bad reply that are shown to the model again."""
_MOST_FAULTS = 3


async def ask(
    chat: ChatModel, request: ChatRequest, reply_type: type[Reply], check: Callable[[Reply], str | None] | None = None
) -> Reply | None:
    """Ask a question and return the reply, validated; ask once more if it is bad; None if it is bad again.

    Args and errors as ``demand``, but for ``ChatReplyError``.
    """
    try:
        return await demand(chat, request, reply_type, check)
    except ChatReplyError:
        return None


async def demand(
    chat: ChatModel, request: ChatRequest, reply_type: type[Reply], check: Callable[[Reply], str | None] | None = None
) -> Reply:
    """Ask a question and return the reply, validated; ask once more if it is bad.

    Args:
        chat: the model.
        request: the question; without a schema it gets that of ``reply_type``.
        reply_type: pydantic model of the reply.
        check: says what else is wrong with a valid reply, in words for the model ("box 7 was not drawn"); None: nothing.

    Raises:
        ChatReplyError: both replies were of no use; the message says why the last one was.
        ChatRequestError: no reply could be had.
        BudgetExceeded: no question is allowed any more.
    """
    if request.schema is None:
        request = replace(request, schema=schema_of(reply_type), schema_name=reply_type.__name__.lower())
    fault = ""
    for _ in range(2):
        said = ""
        try:
            said = (await chat.complete(request)).text
            reply, fault = _read(said, reply_type, check)
            if reply is not None:
                return reply
        except ChatReplyError as error:
            fault = excerpt(str(error))
        logger.debug("%s: a reply was of no use: %s", chat.name, fault)
        complaint = (
            f"That reply is of no use: {fault}. Answer the same question again, with one JSON object of the form asked for, only that."
        )
        request = replace(request, turns=(*request.turns, (excerpt(said, MOST_ECHOED) or "(no text)", complaint)))
    raise ChatReplyError(f"asked twice, and got no reply of any use: {fault}")


def _read(said: str, reply_type: type[Reply], check: Callable[[Reply], str | None] | None) -> tuple[Reply | None, str]:
    """The reply in a text, or what is wrong with it."""
    objects = json_objects_in(said)
    if not objects:
        return None, "it holds no JSON object"
    valid: list[Reply] = []
    fault = ""
    for candidate in objects:
        try:
            reply = reply_type.model_validate(candidate)
        except (ValidationError, RecursionError) as error:
            fault = fault or _explain(error)
            continue
        if reply not in valid:
            valid.append(reply)
    if len(valid) > 1:
        return None, "it holds more than one JSON object"  # which one is meant is not ours to guess
    if not valid:
        return None, fault
    complaint = check(valid[0]) if check is not None else None
    return (None, excerpt(complaint)) if complaint else (valid[0], "")


def _explain(error: ValidationError | RecursionError) -> str:
    if isinstance(error, RecursionError):
        return "it is nested too deep"
    faults = error.errors(include_url=False, include_context=False, include_input=False)
    shown = [f"{'.'.join(map(str, fault['loc'])) or 'the object'}: {fault['msg']}" for fault in faults[:_MOST_FAULTS]]
    more = f"; and {len(faults) - _MOST_FAULTS} more" if len(faults) > _MOST_FAULTS else ""
    return excerpt("; ".join(excerpt(fault, 120) for fault in shown), 400) + more
