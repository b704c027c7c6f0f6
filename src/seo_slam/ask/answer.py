"""Ask a map: retrieval by embedding, then a chat model if there is one, else the ranked list in plain words."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field

from seo_slam.agents.loop_thread import LoopThread
from seo_slam.ask.reply import MapReply, cited_ids, reply_of, tidy
from seo_slam.ask.retrieval import Retrieved, retrieve
from seo_slam.ask.words import described, ranked_list
from seo_slam.errors import AgentError
from seo_slam.interfaces import ChatModel, Embedder
from seo_slam.map import Map
from seo_slam.types import Landmark

_SPELLING_ONLY = "hashed"


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a map answers.

    Attributes:
        text: for people. Positions in it are those of the map, never a model's.
        landmarks: what the answer is about, the best first: those that the model names, or without a model those that stand out.
            Empty if nothing fits.
        reasons: id -> why the model named it; "" where it gave no reason.
        hits: what was retrieved, with scores, best first; a model sees nothing else of the map.
        source: name of the chat model that answered, or "embedding".
        refused: why the chat model's answer was refused, in words; the text is then the ranked list. "" otherwise.
        warnings: what else the reader should know.
    """

    text: str
    landmarks: tuple[Landmark, ...]
    hits: tuple[Retrieved, ...]
    source: str = "embedding"
    refused: str = ""
    warnings: tuple[str, ...] = ()
    reasons: Mapping[int, str] = field(default_factory=dict)


def ask(map: Map, question: str, chat: ChatModel | None = None, k: int = 8, embedder: Embedder | None = None) -> Answer:
    """Ask a map in everyday words; it works inside a running event loop (a notebook), too.

    Args:
        map: what to ask.
        question: for example "I am going hiking, anything good?".
        chat: a language model that is shown the retrieved things as data and words the answer; None asks none and no network.
            It can name only things it was shown. An answer that names another id, or a place where nothing is, is sent back once and
            then refused.
        k: how many things are retrieved.
        embedder: used instead of the map's own.

    Raises:
        MapError: the question is empty or too long, k is below 1, or the map does not say which embedder made it.
        MissingBackendError, UnknownBackendError: the map's embedder cannot be had here.
    """
    hits = retrieve(map, question, k, embedder)
    if chat is None or not hits:
        return _by_embedding(map, question, hits, embedder)
    thread = LoopThread()
    try:
        return thread.wait_for(_by_model(map, question, hits, chat, embedder))
    finally:
        thread.stop()


async def ask_async(map: Map, question: str, chat: ChatModel | None = None, k: int = 8, embedder: Embedder | None = None) -> Answer:
    """Ask a map from a coroutine; arguments and errors as ``ask``."""
    hits = await asyncio.to_thread(retrieve, map, question, k, embedder)  # the first embedding loads a model
    if chat is None or not hits:
        return _by_embedding(map, question, hits, embedder)
    return await _by_model(map, question, hits, chat, embedder)


def _by_embedding(
    map_: Map, question: str, hits: tuple[Retrieved, ...], embedder: Embedder | None, refused: str = "", problem: str = ""
) -> Answer:
    warnings = [problem] if problem else []
    if hits and (embedder.name if embedder else map_.embedder) == _SPELLING_ONLY:
        warnings.append('the embedder "hashed" knows spelling, not meaning: "shoe" does not find a boot')
    good = tuple(hit.landmark for hit in hits if hit.stands_out)
    return Answer(ranked_list(question, hits, map_), good, hits, refused=refused, warnings=tuple(warnings))


async def _by_model(map_: Map, question: str, hits: tuple[Retrieved, ...], chat: ChatModel, embedder: Embedder | None) -> Answer:
    try:
        reply, refused = await reply_of(chat, question, hits, map_)
    except AgentError as error:
        return _by_embedding(map_, question, hits, embedder, problem=f"the chat model {chat.name!r} did not answer: {error}")
    if reply is None:
        return _by_embedding(map_, question, hits, embedder, refused=refused)
    return _as_answer(map_, hits, reply, chat.name)


def _as_answer(map_: Map, hits: tuple[Retrieved, ...], reply: MapReply, model: str) -> Answer:
    reasons = cited_ids(reply, [hit.landmark.id for hit in hits])
    landmarks = tuple(map_.landmark(i) for i in reasons)
    lines = [f"- {described(row, map_)}" + (f": {reasons[row.id]}" if reasons[row.id] else "") for row in landmarks]
    return Answer("\n".join([tidy(reply.answer), *lines]), landmarks, hits, source=model, reasons=reasons)
