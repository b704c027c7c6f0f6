"""Homes by name."""

import pytest

from seo_slam.driving.homes import home_named, parsed_home
from seo_slam.errors import ConfigError


@pytest.mark.parametrize(
    ("name", "kind", "seed"),
    [("house", "house", 0), ("House:2", "house", 2), ("apartment", "apartment", 0), (" apartment:13", "apartment", 13)],
)
def test_names(name, kind, seed):
    assert parsed_home(name) == (kind, seed)


@pytest.mark.parametrize("name", ["", "desk", "apartment:", "apartment:x", "apartment:-1", "house:1:2"])
def test_other_names_are_refused(name):
    with pytest.raises(ConfigError, match="wanted house, or apartment:SEED"):
        home_named(name)


def test_the_house_needs_its_models():
    with pytest.raises(ConfigError, match="mesh folder"):
        home_named("house")
