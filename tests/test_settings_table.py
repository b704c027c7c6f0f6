"""The documentation's table of settings has every setting with its default, and the tables of parts and presets every name."""

import json
import re
from pathlib import Path

from pydantic import BaseModel

from seo_slam import registry
from seo_slam.config import PRESETS, Component, Config

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "pipeline.md").read_text(encoding="utf-8")


LONG = 100
"""A default of more characters, such as a list of words, is called "a list" in the table."""


def settings():
    """ "group.key" -> default, as --set takes it."""
    for group, field in Config.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel) and field.annotation is not Component:
            for key, value in field.default:
                text = value if isinstance(value, str) else json.dumps(value)
                yield f"{group}.{key}", text if len(text) <= LONG else "a list"


def test_every_setting_is_listed_with_its_default():
    listed = re.findall(r"^\| `(\w+\.\w+)` \| ([^|]+) \|", PAGE, flags=re.MULTILINE)
    assert listed == list(settings())


def test_every_listed_default_can_be_set():
    listed = re.findall(r"^\| `(\w+\.\w+)` \| ([^|]+) \|", PAGE, flags=re.MULTILINE)
    assert Config().with_settings(f"{key}={value}" for key, value in listed if value != "a list") == Config()


def test_every_part_is_listed_with_its_names_and_default():
    listed = re.findall(r"^\| `(\w+)` \| (`[^|]+) \| `(\w+)`", PAGE, flags=re.MULTILINE)
    for kind, names, default in listed:
        assert sorted(re.findall(r"`(\w+)`", names)) == sorted(registry._BUILT_IN[kind]), kind
        assert default == getattr(Config(), kind).name
    components = [name for name, field in Config.model_fields.items() if field.annotation is Component]
    assert [kind for kind, *_ in listed] == components


def test_every_preset_is_described():
    assert all(f"`{name}`" in PAGE for name in PRESETS)
