"""Which agents a run has, from the words of a command line."""

from typing import Any

from seo_slam.config import LOCAL_AGENTS, WITNESS, Config, chat_agents
from seo_slam.errors import ConfigError

_ASKING = frozenset(agent["name"] for agent in chat_agents({}))
KINDS = ("local", "chat", "none")


def with_agents(config: Config, kind: str | None, model: str | None, url: str | None, key_env: str | None) -> Config:
    """Return settings with the agents that were asked for.

    Args:
        config: what preset and file say; kept where nothing is asked for.
        kind: "local", "chat" or "none"; naming a model means "chat".
        model: name of the chat model of all three agents.
        url: of its server.
        key_env: variable that holds its key.

    Raises:
        ConfigError: another kind, or words that do not go together.
    """
    named = [option for option, value in (("--chat-model", model), ("--chat-url", url), ("--key-env", key_env)) if value is not None]
    if kind is None and model is not None:
        kind = "chat"
    if kind is not None and kind not in KINDS:
        raise ConfigError(f"--agents: got {kind!r}, wanted {', '.join(KINDS)}")
    if named and kind != "chat":
        raise ConfigError(f"{named[0]} goes with --agents chat, got --agents {kind or 'nothing'}")
    if kind is None:
        return config
    if kind == "chat" and model is None:
        raise ConfigError("--agents chat needs --chat-model NAME (or give --preset seo_slam_chat, or agents in a config file)")
    options = chat_options(model, url, key_env)
    local = [agent.model_dump() for agent in LOCAL_AGENTS]
    chosen = {"local": local, "chat": [*chat_agents(options), WITNESS], "none": []}[kind]
    mode = {"runner": {"mode": "background"}} if kind == "chat" and config.runner.mode == "inline" else {}
    return config.updated({"agents": chosen, **mode}, f"--agents {kind}")


def asks_chat(config: Config, kind: str | None) -> bool:
    """Whether ``--chat-model`` is for agents: ``--agents`` says so, or says nothing and the settings have agents that ask one."""
    return kind == "chat" or (kind is None and any(agent.name in _ASKING for agent in config.agents))


def chat_options(model: str | None, url: str | None, key_env: str | None) -> dict[str, Any]:
    """Return options of the chat model "openai"; what is None is left to its default."""
    given = (("model", model), ("base_url", url), ("api_key_env", key_env))
    return {key: value for key, value in given if value is not None}
