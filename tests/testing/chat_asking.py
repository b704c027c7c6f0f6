"""Asks a chat server as a client would."""

import asyncio
import json
import urllib.error
import urllib.request
from contextlib import asynccontextmanager

import httpx

RIGHT = json.dumps({"verdicts": [{"box": 1, "object": "cup", "score": 1.0}, {"box": 2, "object": "N/A", "score": -1.0}]})
MERGED = json.dumps({"duplicates": [{"boxes": [1, 3], "best": 3}]})
DESCRIBED = json.dumps({"matched_label": "N/A", "generated_label": "red cup", "category": "cup"})

VERIFICATION = '{"landmarks": [{"box": 1, "label": "cup"}]}'
DESCRIPTION = '{"landmarks": [{"box": 1, "label": "cup"}], "known_labels": []}'
MERGING = '{"landmarks": [{"box": 1, "label": "cup"}], "separate_beyond_m": 0.1}'


def body(text="hello", model="tiny", **more):
    return {
        "model": model,
        "messages": [{"role": "system", "content": "Be brief."}, {"role": "user", "content": text}],
        "max_tokens": 50,
        **more,
    }


def post(server, asked=None, headers=None, path="/chat/completions"):
    """Ask with the standard library alone: status, headers, JSON."""
    data = json.dumps(body() if asked is None else asked).encode()
    request = urllib.request.Request(server.base_url + path, data, {"Content-Type": "application/json", **(headers or {})})
    try:
        with urllib.request.urlopen(request, timeout=20) as response:
            return response.status, response.headers, json.load(response)
    except urllib.error.HTTPError as error:
        with error:
            return error.code, error.headers, json.load(error)


def said(reply):
    """Text of the model in a reply."""
    return reply["choices"][0]["message"]["content"]


@asynccontextmanager
async def client(**options):
    async with httpx.AsyncClient(timeout=20, limits=httpx.Limits(max_connections=100), trust_env=False, **options) as made:
        yield made


async def ask(made, server, asked=None):
    response = await made.post(server.base_url + "/chat/completions", json=body() if asked is None else asked)
    return response.status_code, response.json()


def ask_many(server, count, asked=None):
    """Ask ``count`` times at once; what each gave, exceptions included."""

    async def run():
        async with client() as made:
            return await asyncio.gather(*(ask(made, server, asked) for _ in range(count)), return_exceptions=True)

    return asyncio.run(run())
