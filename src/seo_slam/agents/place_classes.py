"""The words of a place, asked of a chat model once (DualMap III-A1)."""

import json
import logging
from collections.abc import Iterable
from pathlib import Path

from pydantic import Field

from seo_slam.agents.asking import demand
from seo_slam.agents.loop_thread import LoopThread
from seo_slam.agents.prompts import prompt
from seo_slam.agents.replies import Reply
from seo_slam.agents.reply_text import excerpt
from seo_slam.errors import ConfigError
from seo_slam.interfaces import ChatModel, ChatRequest
from seo_slam.perception.background import is_background
from seo_slam.perception.class_list import ClassList
from seo_slam.perception.labels import clean_label

logger = logging.getLogger(__name__)

MOST_CLASSES = 80
_FEWEST = 3
_LONGEST_WORD = 40
_LONGEST_PLACE = 500
_TOKENS_A_CLASS, _TOKENS = 8, 100
_SOURCE = "classes of: "
_HEADER = f"# {_SOURCE}"
"""First line of a file, and the source of the list: all files with the words of a place begin alike."""


class PlaceClasses(Reply):
    """What the model is to reply."""

    classes: tuple[str, ...] = Field(max_length=1000, description="common nouns, the most usual first")


def classes_of_place(place: str, chat: ChatModel | None, cache: str | Path | None = None, most: int = MOST_CLASSES) -> ClassList:
    """Return the kinds of things usual at a place: from the file, if there is one, else from the chat model, and written to the file.

    The file is a class list as ``ClassList.from_file`` reads it, and may be edited; its first line says which place it is of.

    Args:
        place: in words, such as "an office" or "the kitchen of a restaurant".
        chat: the model that is asked; may be None where the file is there.
        cache: the file; None: ask every time.
        most: words at most.

    Raises:
        ConfigError: the place is empty, the file is of another place, cannot be read or written, or there is neither file nor model.
        AgentError: no reply could be had, or none of any use.
    """
    place = excerpt(place, _LONGEST_PLACE)
    if not place:
        raise ConfigError("classes of a place: got no place, wanted some words such as 'an office'")
    if most < _FEWEST:
        raise ConfigError(f"classes of a place: most is {most}, wanted at least {_FEWEST}")
    file = None if cache is None else Path(cache)
    if file is not None and file.exists():
        _require_place(file, place)
        return ClassList.from_file(file)
    if chat is None:
        raise ConfigError(f"classes of a place: there is no chat model to ask, and no file {file}")
    if file is not None and not file.parent.is_dir():  # before the question is paid for
        raise ConfigError(f"{file}: class list cannot be written: there is no folder {file.parent}")
    thread = LoopThread()  # an event loop may be running here already, as in a notebook
    try:
        classes = thread.wait_for(ask_for_classes(place, chat, most))
    finally:
        thread.stop()
    if file is not None:
        classes.write(file, header=f"# {classes.source}")
    return classes


async def ask_for_classes(place: str, chat: ChatModel, most: int = MOST_CLASSES) -> ClassList:
    """Ask a chat model, and return what it named: cleaned, each word once, without parts of the building.

    Raises:
        AgentError: no reply could be had, or none of any use.
    """
    request = ChatRequest(
        system=prompt("classes").text,
        text=f"Which things are usual there?\n{json.dumps({'place': place, 'most_classes': most}, ensure_ascii=False)}",
        schema_name="classes",
        max_tokens=_TOKENS + _TOKENS_A_CLASS * most,
    )
    reply = await demand(chat, request, PlaceClasses, _complaint)
    words = usable_words(reply.classes)
    logger.info("%s named %d classes of %s, of which %d are used", chat.name, len(reply.classes), place, min(len(words), most))
    return ClassList(words[:most], f"{_SOURCE}{place}")


def usable_words(said: Iterable[str]) -> tuple[str, ...]:
    """Return words in lower case, without marks of lists around them, each once; no background, nothing that is no word."""
    words: dict[str, None] = {}
    for text in said:
        word = " ".join((clean_label(text) or "").casefold().strip(" .,;:-*•\"'`#0123456789()").split())
        is_word = any(c.isalnum() for c in word) and len(word) <= _LONGEST_WORD and "#" not in word
        if is_word and not is_background(word):
            words[word] = None
    return tuple(words)


def _complaint(reply: PlaceClasses) -> str | None:
    found = len(usable_words(reply.classes))
    return None if found >= _FEWEST else f"it names {found} usable kinds of things, wanted {_FEWEST} or more"


def _require_place(file: Path, place: str) -> None:
    """A list of another place, left in the file by an earlier run, must not be taken silently."""
    try:
        first = file.read_text(encoding="utf-8-sig").partition("\n")[0]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{file}: class list cannot be read: {error}") from error
    if first.startswith(_HEADER) and first.removeprefix(_HEADER).strip() != place:
        other = first.removeprefix(_HEADER).strip()
        raise ConfigError(
            f"{file}: holds the classes of {other!r:.80}, wanted those of {place!r:.80}; name another file, or remove this one"
        )
