"""A chat server without a socket, and time that passes only when everybody waits."""

import asyncio
import heapq
import itertools
import json

import httpx

from seo_slam.backends.openai_chat import OpenAIChat
from seo_slam.interfaces import ChatRequest

LOCAL = "http://127.0.0.1:8000/v1"
QUESTION = ChatRequest("You look.", "What is it?")
SCHEMA = {"type": "object", "properties": {"word": {"type": "string"}}, "required": ["word"], "additionalProperties": False}
WITH_SCHEMA = ChatRequest("You look.", "What is it?", schema=SCHEMA, schema_name="one word")


class VirtualTime:
    """A clock and a sleep. Time jumps to the next waker as soon as nothing else happens."""

    def __init__(self):
        self.now_s = 0.0
        self._waiting = []
        self._numbers = itertools.count()

    def clock(self):
        return self.now_s

    async def sleep(self, seconds):
        until = self.now_s + max(seconds, 0.0)
        heapq.heappush(self._waiting, (until, next(self._numbers)))
        while self.now_s < until:
            await asyncio.sleep(0)

    async def _pass(self):
        while True:
            for _ in range(12):
                await asyncio.sleep(0)
            while self._waiting and self._waiting[0][0] <= self.now_s:
                heapq.heappop(self._waiting)
            if self._waiting:
                self.now_s = self._waiting[0][0]

    def run(self, coroutine):
        async def main():
            passing = asyncio.create_task(self._pass())
            try:
                return await coroutine
            finally:
                passing.cancel()

        return asyncio.run(main())


class Server:
    """Answers with what it is given, one after the other; the last one for ever. A callable is given the request's body."""

    def __init__(self, *answers, time=None, latency_s=0.0):
        self.answers = list(answers) or [said("hello")]
        self.time = time or VirtualTime()
        self.latency_s = latency_s
        self.bodies, self.requests, self.times_s = [], [], []

    async def handle(self, request):
        self.requests.append(request)
        body = json.loads(request.content)
        self.bodies.append(body)
        self.times_s.append(self.time.now_s)
        if self.latency_s:
            await self.time.sleep(self.latency_s)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if callable(answer):
            answer = answer(body)
        if isinstance(answer, Exception):
            raise answer
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)

    def chat(self, **options):
        client = httpx.AsyncClient(transport=httpx.MockTransport(self.handle))
        options = {"model": "m", "base_url": LOCAL, "cache": False, "client": client} | options
        return OpenAIChat(**options, clock=self.time.clock, sleep=self.time.sleep)

    def ask(self, request=QUESTION, **options):
        return self.time.run(self.chat(**options).complete(request))


def said(text="hello", tokens=(100, 20), **message):
    """A proper completion."""
    finish_reason = message.pop("finish_reason", "stop")
    choice = {"message": {"role": "assistant", "content": text} | message, "finish_reason": finish_reason}
    usage = {} if tokens is None else {"usage": {"prompt_tokens": tokens[0], "completion_tokens": tokens[1]}}
    return httpx.Response(200, json={"model": "m-1", "choices": [choice]} | usage)


def refused(status, message="no", headers=None, **error):
    """An error as OpenAI sends it."""
    return httpx.Response(status, headers=headers or {}, json={"error": {"message": message, **error}})
