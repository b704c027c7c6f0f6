"""The words that a map is to be made of, from the words of a command line."""

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


def class_list(given: str, config: Config, model: str | None, url: str | None, key_env: str | None) -> ClassList:
    """Return the class list that ``--classes`` names.

    Args:
        given: a file, "detector", or "place:" and what the place is.
        config: says which detector.
        model: name of the chat model that is asked about a place, once.
        url: of its server.
        key_env: variable that holds its key.

    Raises:
        ConfigError: the file is no class list, the detector does not say what it knows, or no model is named.
        AgentError: the model gave no reply of any use.
    """
    if given == DETECTOR:
        made = registry.create("detector", config.detector, seed=config.seed)
        known = ClassList.of_detector(getattr(made, "detector", made))  # of a front end of two, the one that has words
        if known is None:
            raise ConfigError(f"--classes detector: {type(made).__name__} does not say which words it knows; give a file of words")
        return known
    if not asks_a_model(given):
        return ClassList.from_file(given)
    if model is None:
        raise ConfigError("--classes place:… needs --chat-model NAME, the model that is asked once which things are usual there")
    from seo_slam.agents.place_classes import classes_of_place

    chat = registry.create("chat_model", Component(name="openai", options=chat_options(model, url, key_env)))
    return classes_of_place(given.removeprefix(PLACE), chat)


def with_classes(config: Config, classes: ClassList) -> Config:
    """Return settings under which other words are dropped, and what has no word gets the mean of these."""
    words = list(classes)
    front_end = {"detector": {"options": {"classes": words}}} if config.detector.name == "hybrid" else {}
    return config.updated({"features": {"classes": words, "only_classes": True}, **front_end}, "--classes")
