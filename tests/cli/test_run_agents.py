"""Which agents a run has: ``--agents``, ``--chat-model`` and their mistakes."""

import pytest

from seo_slam.cli.agents import with_agents
from seo_slam.config import LOCAL_AGENTS, Config
from seo_slam.errors import ConfigError


def test_nothing_said_keeps_what_the_settings_say():
    config = Config.from_dict({"agents": [{"name": "mine:Agent"}]})
    assert with_agents(config, None, None, None, None) == config


def test_a_named_model_is_asked_by_all_three_in_the_background():
    config = with_agents(Config(), None, "tiny-vision", "http://127.0.0.1:8080/v1", "MY_KEY")
    assert [agent.name for agent in config.agents] == ["verification", "description", "merging", "local_verification"]
    options = [agent.options["chat"]["options"] for agent in config.agents[:3]]
    assert options == [{"model": "tiny-vision", "base_url": "http://127.0.0.1:8080/v1", "api_key_env": "MY_KEY"}] * 3
    assert config.runner.mode == "background"


def test_local_and_none():
    chat = Config.preset("seo_slam_chat")
    assert [agent.name for agent in with_agents(chat, "local", None, None, None).agents] == [agent.name for agent in LOCAL_AGENTS]
    assert with_agents(chat, "none", None, None, None).agents == ()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("chat", None, None, None), "--chat-model"),
        (("chatty", None, None, None), "wanted local, chat, none"),
        (("local", "gpt-4o", None, None), "--chat-model goes with --agents chat, got --agents local"),
        ((None, None, "http://x/v1", None), "--chat-url goes with --agents chat"),
        (("none", None, None, "KEY"), "--key-env goes with --agents chat"),
    ],
)
def test_words_that_do_not_go_together(words, message):
    with pytest.raises(ConfigError, match=message):
        with_agents(Config(), *words)
