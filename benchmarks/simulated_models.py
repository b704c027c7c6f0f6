"""Simulated vision-language models for the variants with agents: over HTTP, with a stated accuracy, in virtual time."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from seo_slam.config import Component, Config
from seo_slam.simulation.chat_answers import ACCURACY, SimulatedChat
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.testing.chat_server import ChatServer


@dataclass(frozen=True, slots=True)
class ModelKnobs:
    """How good and how fast the simulated models are.

    Attributes:
        accuracy: of all agents; None: those of the protocol (verification 0.85, description 0.90, merging 0.90).
        latency_s: recorded seconds from question to answer.
        in_flight: questions at once.
        sticky: share of the mistakes that come back from the same side of the same thing.
    """

    accuracy: float | None = None
    latency_s: float = 1.0
    in_flight: int = 8
    sticky: float = 0.7

    def as_dict(self) -> dict[str, Any]:
        """Return what a result states."""
        accuracy = dict(ACCURACY) if self.accuracy is None else dict.fromkeys(ACCURACY, self.accuracy)
        return {
            "accuracy": accuracy,
            "latency_s": self.latency_s,
            "in_flight": self.in_flight,
            "sticky": self.sticky,
            "kind": "simulated model",
        }


def asks_models(config: Config) -> bool:
    """Whether a variant's agents ask chat models."""
    return any("chat" in agent.options for agent in config.agents)


@contextmanager
def models_for(recording: SimulatedRecording, variants: Mapping[str, Config], knobs: ModelKnobs) -> Iterator[dict[str, Config]]:
    """Serve a simulated model that sees the recording; yield the variants with their agents sent there, in virtual time."""
    if not any(map(asks_models, variants.values())):
        yield dict(variants)
        return
    given = ACCURACY if knobs.accuracy is None else knobs.accuracy
    model = SimulatedChat(given, sticky=knobs.sticky, seed=recording.seed, look_alikes=recording.look_alikes)
    recording.show_to(model)
    with ChatServer(model) as server:
        yield {name: sent_to(config, server.base_url, knobs) if asks_models(config) else config for name, config in variants.items()}


def sent_to(config: Config, base_url: str, knobs: ModelKnobs) -> Config:
    """Return settings whose agents ask a server, with answers that count in recorded time."""
    agents = []
    for agent in config.agents:
        if "chat" not in agent.options:
            agents.append(agent.model_dump())
            continue
        chat = agent.options["chat"]
        options = {**chat["options"], "base_url": base_url, "reply_format": "json_schema"}
        agents.append(Component(name=agent.name, options={**agent.options, "chat": {**chat, "options": options}}).model_dump())
    runner = {"mode": "virtual", "latency_s": knobs.latency_s, "in_flight": knobs.in_flight}
    return config.updated({"agents": agents, "runner": runner}, "simulated models")
