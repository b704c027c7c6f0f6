"""What the three agents that ask a chat model share."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import Any, ClassVar

from pydantic import ValidationError

from seo_slam import registry
from seo_slam.agents.compose import row_of
from seo_slam.agents.prompts import Prompt, prompt
from seo_slam.config import Component
from seo_slam.errors import ConfigError
from seo_slam.interfaces import Agent, AgentView, ChatModel, ChatRequest
from seo_slam.perception.labels import clean_label


class ChatAgent(Agent):
    """Base of the agents that ask a chat model. A subclass names its prompt and writes ``propose``."""

    prompt_name: ClassVar[str]

    def __init__(self, chat: ChatModel | str | Mapping[str, Any], temperature: float = 0.7, max_tokens: int = 250) -> None:
        """Know the model and how to ask it.

        Args:
            chat: a chat model, the name of one, or ``{"name": ..., "options": {...}}`` as in a config file.
            temperature: of the reply (SEO-SLAM IV-B).
            max_tokens: of the reply (SEO-SLAM IV-B).

        Raises:
            ConfigError: a number out of range, or something that is no chat model.
            UnknownBackendError, MissingBackendError: the chat model cannot be made.
        """
        if not (math.isfinite(temperature) and 0.0 <= temperature <= 2.0):
            raise ConfigError(f"agent {self.name!r}: temperature is {temperature}, wanted 0..2")
        if max_tokens < 1:
            raise ConfigError(f"agent {self.name!r}: max_tokens is {max_tokens}, wanted at least 1")
        self._chat = _chat_model(chat, self.name)
        self._temperature = float(temperature)
        self._max_tokens = int(max_tokens)

    @property
    def name(self) -> str:
        """Written beside every edit of this agent."""
        return self.prompt_name

    @property
    def chat(self) -> ChatModel:
        """The model that it asks."""
        return self._chat

    @property
    def model(self) -> str:
        """Name of the model that it asks."""
        return self._chat.name

    @property
    def prompt(self) -> Prompt:
        """The prompt that it asks with."""
        return prompt(self.prompt_name)

    @property
    def prompt_hash(self) -> str:
        """Which prompt it asks with."""
        return self.prompt.hash

    def usage(self) -> dict[str, Any]:
        """What its chat model has used so far, as ``ChatUsage`` names it; empty if the model does not say.

        Agents that share one model object all tell what was used together.
        """
        said = getattr(self._chat, "usage", None)
        used = said() if callable(said) else said
        if is_dataclass(used) and not isinstance(used, type):
            return asdict(used)
        return dict(used) if isinstance(used, Mapping) else {}

    def request(self, question: str, facts: Mapping[str, Any], images: tuple[bytes, ...]) -> ChatRequest:
        """Return a question that ends in one line of JSON: what detectors or models said stands only there."""
        line = json.dumps(facts, ensure_ascii=False, allow_nan=False)
        return ChatRequest(
            system=self.prompt.text,
            text=f"{question}\n{line}",
            images=images,
            schema_name=self.prompt_name,
            temperature=self._temperature,
            max_tokens=self._max_tokens,
        )


def asked_ids(view: AgentView, most: int) -> tuple[int, ...]:
    """Return the ids that a view asks about, at most so many, without those that have no box or are no landmarks of it."""
    known = {int(i) for i in view.landmarks.ids}
    wanted = view.asked or tuple(view.boxes_px)
    return tuple(i for i in dict.fromkeys(wanted) if i in view.boxes_px and i in known)[:most]


def shown_label(view: AgentView, landmark_id: int) -> str:
    """Return what the map calls a landmark, on one line and without invisible characters."""
    return clean_label(view.landmarks.name_of(row_of(view, landmark_id))) or ""


def version_of(view: AgentView, landmark_id: int) -> int:
    """Return the version of a landmark that the view shows."""
    return int(view.landmarks.versions[row_of(view, landmark_id)])


def only_answers(boxes: Sequence[int], count: int) -> set[int]:
    """Return the numbers 1..count that are named exactly once: of what is said twice, nobody knows which was meant."""
    return {box for box in boxes if 1 <= box <= count and list(boxes).count(box) == 1}


def _chat_model(given: Any, agent: str) -> ChatModel:
    if isinstance(given, Mapping):
        try:
            given = Component.model_validate(dict(given))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"]))
            raise ConfigError(f'agent {agent!r}: chat: {where}: {first["msg"]}; wanted {{"name": …, "options": {{…}}}}') from None
    made = registry.create("chat_model", given) if isinstance(given, str | Component) else given
    if not isinstance(made, ChatModel):
        raise ConfigError(f"agent {agent!r}: chat is a {type(made).__name__}, wanted a chat model, its name, or name and options")
    return made
