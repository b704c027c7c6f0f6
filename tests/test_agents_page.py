"""The page on agents names every kind of edit, outcome, mode and setting, and only constants that exist."""

import re
import tomllib
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import get_args

from seo_slam import registry
from seo_slam.agents.answers import AgentCounts
from seo_slam.backends.chat_budget import ChatUsage
from seo_slam.config import Config, RunnerSettings, describe_settings
from seo_slam.mapping import edit_desk, verdicts
from seo_slam.records import AgentRole, Edit, EditOutcome

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "agents.md").read_text(encoding="utf-8")


def section(heading):
    return PAGE.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def test_every_role_edit_and_outcome_is_told():
    chain = section("Three roles, and who is asked when")
    assert set(re.findall(r"^\| (\w+) \|", chain, re.MULTILINE)) - {"Role"} == set(get_args(AgentRole)) - {"any"}
    becomes = section("What becomes of a proposal")
    assert {kind.__name__ for kind in get_args(Edit)} <= set(re.findall(r"`(\w+)`", becomes))
    outcomes = becomes.partition("**outcome**")[2].partition("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", outcomes)) == set(get_args(EditOutcome))


def test_every_mode_is_told():
    rows = re.findall(r"^\| `(\w+)` \|", section("When the answers count"), re.MULTILINE)
    assert rows == list(get_args(RunnerSettings.model_fields["mode"].annotation))


def test_every_constant_of_the_table_exists_and_none_of_the_rails_is_left_out():
    rows = re.findall(r"^\| `(\w+)/(\w+)\.py` \| (.*) \|$", PAGE, re.MULTILINE)
    named = {(package, module): re.findall(r"`([A-Z_]+)`", text) for package, module, text in rows}
    for (package, module), names in named.items():
        found = import_module(f"seo_slam.{package}.{module}")
        assert [name for name in names if not hasattr(found, name)] == []
    for module, key in ((edit_desk, ("mapping", "edit_desk")), (verdicts, ("mapping", "verdicts"))):
        numbers = {name for name, value in vars(module).items() if name.isupper() and isinstance(value, float | int)}
        assert numbers - imported(module) == set(named[key])


def imported(module):
    """Capital names that a module has from another one."""
    source = Path(module.__file__).read_text(encoding="utf-8")
    return {name for name in vars(module) if name.isupper() and not re.search(rf"^{name}\b|^\w.*, {name}\b.* = ", source, re.MULTILINE)}


def test_every_setting_exists():
    known = {key for key, _, _ in describe_settings(Config)}
    named = set(re.findall(r"`(?:--set )?((?:runner|edits|map)\.[a-z_]+)", PAGE)) - {"map.db", "map.json", "edits.rails=false"}
    assert named <= known
    assert {key for key in known if key.startswith(("runner.", "edits."))} <= named


def test_what_the_result_counts_is_told():
    told = section("What goes wrong")
    assert [field for field in AgentCounts().as_dict() if f"`{field}`" not in told] == []
    assert [field.name for field in fields(ChatUsage) if f"`{field.name}`" not in told] == []
    for key in ("mode", "agents", "usage", "landmarks_done", "dropped", "superseded", "edits", "age_s"):
        assert f"| `{key}`" in told or f"`{key}`" in told


def test_the_configuration_makes_the_agents_that_it_names(monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "none-of-yours")
    blocks = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        agents = [registry.create("agent", agent) for agent in Config.from_dict(tomllib.loads(block)).agents]
        assert [(agent.role, agent.model) for agent in agents] == [
            ("verification", "qwen2.5vl"),
            ("description", "gpt-4o"),
            ("merging", "gpt-4o"),
            ("verification", ""),
        ]
