"""A map whose features are made otherwise than those of what is seen: the search goes on, and says so."""

from dataclasses import replace

import pytest
from fake_home import EMBEDDER, Robot, SeeingMapper, abstract_map, drive, furniture, resting

from seo_slam.navigation.navigator import Navigator
from seo_slam.records import FeatureRecipe
from seo_slam.settings.navigation import NavigationSettings

PICTURES, WORDS = FeatureRecipe(0.7, 0.3, "Clip:small"), FeatureRecipe(0.7, 0.3)


class Mapper(SeeingMapper):
    """Says how its features are made."""

    features = None

    def snapshot(self):
        local = super().snapshot()
        local.features = self.features
        return local


def searched(known, seen, text="mug", **settings):
    things, robot = furniture(), Robot((2.0, 2.0))
    mug = resting(10, "mug", things[0])
    mapper = Mapper(robot, [*things, mug])
    mapper.features = seen
    navigator = Navigator(
        replace(abstract_map(things, [(mug, things[0])], True), features=known), mapper, EMBEDDER, NavigationSettings(**settings)
    )
    navigator.ask(text)
    return drive(navigator, robot), navigator.log


def test_it_is_logged_and_told_where_nothing_is_found():
    outcome, log = searched(WORDS, PICTURES, "zebra", attempts=1)
    assert not outcome.found
    assert "the map's features are of words only, those of what is seen are of 0.7 pictures (Clip:small) and 0.3 words" in outcome.reason
    assert sum("features" in line for line in log[:-1]) == 1


def test_who_finds_has_nothing_to_explain():
    outcome, log = searched(PICTURES, WORDS)
    assert outcome.found
    assert "features" not in outcome.reason
    assert any("features" in line for line in log)


@pytest.mark.parametrize(("known", "seen"), [(None, PICTURES), (PICTURES, None), (PICTURES, PICTURES), (WORDS, FeatureRecipe(0.0, 1.0))])
def test_the_same_or_unknown_is_nothing_to_tell(known, seen):
    outcome, log = searched(known, seen, "zebra", attempts=1)
    assert not outcome.found
    assert not any("features" in line for line in (*log, outcome.reason))
