"""The page on the life of a landmark names every kind of event, and only settings and constants that exist."""

import re
from importlib import import_module
from pathlib import Path
from typing import get_args

from seo_slam.config import Config, describe_settings
from seo_slam.types import LandmarkState

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "life-cycle.md").read_text(encoding="utf-8")


def test_every_kind_of_event_is_told():
    made = r'(?:MapEvent\(|_becomes\(thing, "\w+", )"(\w+)"'
    kinds = {kind for file in (ROOT / "src" / "seo_slam" / "mapping").glob("*.py") for kind in re.findall(made, file.read_text("utf-8"))}
    assert {"created", "found", "moved", "confirmed"} <= kinds
    events = PAGE.partition("## Events")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", events, re.MULTILINE)) == kinds


def test_every_state_is_told():
    states = PAGE.partition("## Events")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", states, re.MULTILINE)) == set(get_args(LandmarkState))


def test_every_constant_of_the_table_exists():
    rows = re.findall(r"^\| `(\w+)\.py` \| (.*) \|$", PAGE, re.MULTILINE)
    named = [(module, name) for module, text in rows for name in re.findall(r"`([A-Z_]+)`", text)]
    assert len(named) > 20
    assert [name for module, name in named if not hasattr(import_module(f"seo_slam.mapping.{module}"), name)] == []


def test_every_setting_exists():
    known = {key for key, _, _ in describe_settings(Config)}
    named = set(re.findall(r"`((?:life|map|lifting)\.[a-z_]+)(?: = \w+)?`", PAGE)) - {"map.landmarks", "map.tentative", "map.db"}
    assert named <= known
    assert {key for key in known if key.startswith("life.")} <= named | {"life.enabled"}
