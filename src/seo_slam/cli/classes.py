"""The words that a map is to be made of, from the words of a command line."""

from collections.abc import Callable
from pathlib import Path

from seo_slam import registry
from seo_slam.cli.agents import chat_options
from seo_slam.config import Component, Config
from seo_slam.errors import ConfigError
from seo_slam.perception.class_list import ClassList

DETECTOR, PLACE = "detector", "place:"
CLASSES_FILE = "classes.txt"
"""In the folder of a result, where classes were given: to be edited, and given to the next run."""


def asks_a_model(classes: str | None) -> bool:
    """Whether a chat model is to be asked for the words."""
    return classes is not None and classes.startswith(PLACE)


def class_list(given: str, config: Config) -> ClassList:
    """Return the class list that ``--classes`` names, if it is a file or the detector's.

    Args:
        given: a file, or "detector".
        config: says which detector.

    Raises:
        ConfigError: the file is no class list, or the detector does not say what it knows.
    """
    if given != DETECTOR:
        return ClassList.from_file(given)
    made = registry.create("detector", config.detector, seed=config.seed)
    known = ClassList.of_detector(getattr(made, "detector", made))  # of a front end of two, the one that has words
    if known is None:
        raise ConfigError(f"--classes detector: {type(made).__name__} does not say which words it knows; give a file of words")
    return known


def place_question(given: str, model: str | None, url: str | None, key_env: str | None) -> Callable[[], ClassList]:
    """Return what asks a chat model for the words of a place, once: to be called when nothing else can be wrong, as it may cost money.

    Args:
        given: "place:" and what the place is.
        model: name of the chat model.
        url: of its server.
        key_env: variable that holds its key.

    Raises:
        ConfigError: no place or no model is named, or the key is missing. What is returned raises ``AgentError`` where the model gave
            no reply of any use.
    """
    place = given.removeprefix(PLACE).strip()
    if not place:
        raise ConfigError("--classes place:…: got no place, wanted some words such as 'place:an office'")
    if model is None:
        raise ConfigError("--classes place:… needs --chat-model NAME, the model that is asked once which things are usual there")
    from seo_slam.agents.place_classes import classes_of_place

    chat = registry.create("chat_model", Component(name="openai", options=chat_options(model, url, key_env)))
    return lambda: classes_of_place(place, chat)


def require_kept(given: str, out: Path, overwrite: bool) -> None:
    """Raise ``ConfigError`` if the words would replace another class list in the result's folder, unless ``overwrite`` is set."""
    file = out / CLASSES_FILE
    if file.exists() and not overwrite and not _is_file(given, file):
        raise ConfigError(f"{file}: is there already; give --classes {file} to use it, --overwrite to replace it, or another --out")


def keep(words: ClassList, given: str, folder: Path) -> None:
    """Write the words to the result's folder; a list that was read from there stays as its user wrote it."""
    file = folder / CLASSES_FILE
    if not _is_file(given, file):
        words.write(file, header=f"# {words.source}")


def _is_file(given: str, file: Path) -> bool:
    return file.exists() and given != DETECTOR and not asks_a_model(given) and Path(given).resolve() == file.resolve()


def with_classes(config: Config, classes: ClassList) -> Config:
    """Return settings under which other words are dropped, and what has no word gets the mean of these."""
    words = list(classes)
    front_end = {"detector": {"options": {"classes": words}}} if config.detector.name == "hybrid" else {}
    return config.updated({"features": {"classes": words, "only_classes": True}, **front_end}, "--classes")
