"""Variants with agents: simulated models over HTTP, in recorded time."""

import pytest
from simulated_models import ModelKnobs, asks_models
from simulated_runs import VARIANTS, Job, make_recording, run_variants

from seo_slam.config import Config

HASHED = ["embedder.name=hashed"]


def job(*names, **changed):
    variants = {name: Config.preset(VARIANTS[name]).with_settings(HASHED) for name in names}
    return Job("SM1", 0, 0.5, variants, frames=30, size_px=(160, 120), **changed)


def run(made):
    pipelines, failures = run_variants(make_recording(made), made)
    assert failures == []
    return {name: pipeline.result() for name, pipeline in pipelines.items()}


def test_which_variants_ask_models():
    asking = {name for name, preset in VARIANTS.items() if asks_models(Config.preset(preset))}
    assert asking == {"RG+A", "RG+D+A", "RG+D+L+A"}


def test_agents_are_asked_over_http_without_a_key_and_change_the_map(monkeypatch):
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    results = run(job("RG+D+L", "RG+D+L+A"))
    assert not any(agent["role"] != "any" and agent.get("model") for agent in results["RG+D+L"].agents.get("agents", []))
    asked = {agent["name"]: agent for agent in results["RG+D+L+A"].agents["agents"]}
    assert asked["verification"]["answered"] > 5
    assert asked["verification"]["failed"] == 0
    assert results["RG+D+L+A"].agents["mode"] == "virtual"
    assert any(row.category for row in results["RG+D+L+A"].map.landmarks)


def test_virtual_time_gives_the_same_map_twice():
    first, second = (run(job("RG+D+L+A"))["RG+D+L+A"].map.to_json() for _ in range(2))
    assert first == second


@pytest.mark.parametrize(("accuracy", "stated"), [(None, 0.85), (0.6, 0.6)])
def test_what_a_result_states(accuracy, stated):
    assert ModelKnobs(accuracy).as_dict()["accuracy"]["verification"] == stated
