"""The pages on DualMap's maps and navigation name only settings that exist, with values that hold."""

import re
import tomllib
from pathlib import Path

import pytest

from seo_slam.config import Config, describe_settings
from seo_slam.settings.hybrid import HybridSettings

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = ("dualmap.md", "abstract-map.md", "navigation.md")
GROUPS = "features|clouds|overlap|status|layout|abstraction|planner|navigation"


@pytest.mark.parametrize("page", PAGES)
def test_every_setting_exists(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    known = {key for key, *_ in describe_settings(Config)}
    named = set(re.findall(rf"`((?:{GROUPS})\.[a-z_0-9]+)", text)) - {"clouds.ply", "features.npz"}
    assert named
    assert named <= known


def test_the_files_can_be_laid_over_the_preset():
    text = (DOCS / "dualmap.md").read_text(encoding="utf-8")
    files = [tomllib.loads(body) for body in re.findall(r"```toml\n(.*?)```", text, flags=re.DOTALL)]
    assert len(files) == 2
    for values in files:
        made = Config.preset("dualmap").updated(values, "docs/dualmap.md")
        HybridSettings.model_validate(made.detector.options.get("settings", {}))
    assert files[1]["status"].keys() >= {"alike_cosine", "fold"}


def test_thresholds_of_the_front_end_are_listed():
    text = (DOCS / "dualmap.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| `settings` \|.*$", text, flags=re.MULTILINE)
    listed = dict(re.findall(r"`(\w+)` ([\w.]+)", row.partition("thresholds:")[2]))
    assert {key: str(value) for key, value in listed.items()} == {
        key: f"{v:g}" if isinstance(v, float) else v for key, v in HybridSettings()
    }
