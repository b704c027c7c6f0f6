"""``seo-slam ask``: a request in everyday words, answered from a map."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from seo_slam import registry
from seo_slam.ask import Answer, Retrieved
from seo_slam.ask import ask as ask_map
from seo_slam.config import Component
from seo_slam.errors import ConfigError
from seo_slam.interfaces import ChatModel
from seo_slam.map import Map, embedder_of
from seo_slam.map_document import landmark_fields


def ask(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result, or its map.json or map.db.")],
    text: Annotated[str, typer.Argument(help='A request in words, such as "I am going hiking, anything good?".')],
    k: Annotated[int, typer.Option("-k", min=1, help="How many things to retrieve; a chat model sees no others.")] = 8,
    as_json: Annotated[bool, typer.Option("--json", help="For a program: JSON with the answer, its landmarks and all scores.")] = False,
    chat_model: Annotated[
        str, typer.Option("--chat-model", help="Let this model word the answer; without it, no network is used.", metavar="NAME")
    ] = "",
    chat_url: Annotated[
        str, typer.Option("--chat-url", help="Base URL of its OpenAI-compatible server; default: that of OpenAI.", metavar="URL")
    ] = "",
    key_env: Annotated[str, typer.Option("--key-env", help="Environment variable that holds its key.", metavar="VAR")] = "",
    embedder: Annotated[
        str, typer.Option("--embedder", help="Used instead of the map's own: minilm, hashed, auto, …", metavar="NAME")
    ] = "",
) -> None:
    """Answer TEXT from the things in MAP."""
    loaded = Map.load(map_path)
    chat = _chat(chat_model, chat_url, key_env)
    answer = ask_map(loaded, text, chat, k, embedder_of(embedder) if embedder else None)
    if as_json:
        typer.echo(json.dumps(_fields(text, loaded, answer, embedder), ensure_ascii=False, indent=1))
        return
    for warning in answer.warnings:
        typer.echo(f"warning: {warning}", err=True)
    if answer.refused:
        typer.echo(f"warning: the answer of {chat_model} was refused: {answer.refused}", err=True)
    typer.echo(answer.text)


def _chat(model: str, url: str, key_env: str) -> ChatModel | None:
    if not model:
        lonely = next((option for option, value in (("--chat-url", url), ("--key-env", key_env)) if value), "")
        if lonely:
            raise ConfigError(f"{lonely} is given without --chat-model; which model is to answer?")
        return None
    options: dict[str, Any] = {"model": model}
    if url:
        options["base_url"] = url
    if key_env:
        options["api_key_env"] = key_env
    made: ChatModel = registry.create("chat_model", Component(name="openai", options=options))
    return made


def _fields(text: str, loaded: Map, answer: Answer, embedder: str) -> dict[str, Any]:
    return {
        "question": text,
        "answer": answer.text,
        "source": answer.source,
        "refused": answer.refused,
        "warnings": list(answer.warnings),
        "embedder": embedder or loaded.embedder,
        "gravity": loaded.gravity,
        "landmarks": [{"why": answer.reasons.get(row.id, ""), **landmark_fields(row)} for row in answer.landmarks],
        "hits": [_hit_fields(hit) for hit in answer.hits],
    }


def _hit_fields(hit: Retrieved) -> dict[str, Any]:
    return {
        "id": hit.landmark.id,
        "label": hit.landmark.label,
        "score": round(hit.score, 6),
        "spreads": None if hit.spreads is None else round(hit.spreads, 3),
        "stands_out": hit.stands_out,
    }
