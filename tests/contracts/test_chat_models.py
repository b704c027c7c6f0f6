"""Every registered chat model keeps the contract, and the check notices those that do not."""

import asyncio
import json

import httpx
import pytest

from seo_slam import registry
from seo_slam.config import Component
from seo_slam.errors import ChatReplyError, ChatRequestError
from seo_slam.interfaces import ChatReply
from seo_slam.testing import check_chat_model


def answers(request):
    """A server that says something of the form asked for."""
    body = json.loads(request.content)
    schema = body.get("response_format", {}).get("json_schema", {}).get("schema", {"properties": {}})
    reply = {key: False if value["type"] == "boolean" else "pear" for key, value in schema["properties"].items()}
    text = json.dumps(reply) if reply else "pear"
    return httpx.Response(200, json={"choices": [{"message": {"content": text}, "finish_reason": "stop"}]})


@pytest.mark.parametrize("name", registry.known("chat_model"))
def test_contract(name):
    client = httpx.AsyncClient(transport=httpx.MockTransport(answers))
    options = {"model": "m", "base_url": "http://127.0.0.1:1/v1", "client": client}
    check_chat_model(registry.create("chat_model", Component(name=name, options=options)))


class Good:
    name = "good"

    async def complete(self, request):
        if request.images:
            raise ChatReplyError("it sees nothing")
        return ChatReply("pear")


def test_good_ones_pass_also_within_a_running_loop():
    check_chat_model(Good())

    async def notebook():
        check_chat_model(Good())

    asyncio.run(notebook())


class Nameless(Good):
    name = ""


class Blocking(Good):
    def complete(self, request):
        return ChatReply("pear")


class SaysText(Good):
    async def complete(self, request):
        return "pear"


class SaysNothing(Good):
    async def complete(self, request):
        return ChatReply(" ")


class CountsBadly(Good):
    async def complete(self, request):
        return ChatReply("pear", prompt_tokens=-1)


class Breaks(Good):
    async def complete(self, request):
        raise KeyError("choices")


class NeverAnswers(Good):
    async def complete(self, request):
        raise ChatRequestError("no server")


class OneLoopOnly(Good):
    loop = None

    async def complete(self, request):
        self.loop = self.loop or asyncio.get_running_loop()
        if self.loop is not asyncio.get_running_loop():
            raise RuntimeError("attached to a different loop")
        return ChatReply("pear")


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (object, "lacks name or complete"),
        (Nameless, "name is ''"),
        (Blocking, "no async function"),
        (SaysText, "returned str, wanted ChatReply"),
        (SaysNothing, "text is ' '; raise ChatReplyError"),
        (CountsBadly, "prompt_tokens is -1"),
        (Breaks, "raised KeyError: 'choices'; wanted an AgentError"),
        (NeverAnswers, "answered none"),
        (OneLoopOnly, "different loop"),
    ],
)
def test_broken_ones_are_noticed(model, words):
    with pytest.raises(AssertionError, match=words):
        check_chat_model(model())


def test_one_that_cannot_be_cancelled_is_noticed(monkeypatch):
    monkeypatch.setattr("seo_slam.testing.chat_model._PATIENCE_S", 0.01)

    class Stubborn(Good):
        asked = 0

        async def complete(self, request):
            self.asked += 1
            if self.asked > 6:  # the last question
                for _ in range(2):
                    try:
                        await asyncio.sleep(0.05)
                    except asyncio.CancelledError:
                        continue
            return ChatReply("pear")

    with pytest.raises(AssertionError, match="a cancelled question went on"):
        check_chat_model(Stubborn())
