"""The navigator in a home drawn by hand: found, moved, not there, no way, and what it keeps for the next query."""

import numpy as np
import pytest
from fake_home import EMBEDDER, Robot, SeeingMapper, abstract_map, drive, furniture, resting

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.errors import ConfigError, MapError, NoPathError
from seo_slam.navigation.global_planner import VoronoiPlanner
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.navigator import Navigator
from seo_slam.settings.navigation import NavigationSettings

SETTINGS = NavigationSettings()


def home(mapped=("mug", 1), now=None, settings=SETTINGS, start=(2.0, 2.0), door=True, says=None, more=(), **parts):
    """A navigator over the map of a home, and a robot in the home as it is now: ``(label, carrier id)`` of the small thing in each."""
    things = furniture()
    by_id = {thing.id: thing for thing in things}
    was = resting(10, mapped[0], by_id[mapped[1]])
    now = was if now is None else resting(10, mapped[0], by_id[now[0]], *now[1:]) if now else None
    robot = Robot(start)
    mapper = SeeingMapper(robot, [*things, *more, *([now] if now else [])], says=says, door=door)
    old_map = abstract_map(things, [(was, by_id[mapped[1]])], door)
    if "grid" not in parts:
        grid = NavigationGrid(old_map.layout, 0.18)
        parts |= {"grid": grid, "far": VoronoiPlanner(grid), "near": VoronoiPlanner(grid)}
    navigator = Navigator(old_map, mapper, EMBEDDER, settings, **parts)
    return navigator, robot, now


def stops_by(robot, thing):
    return np.linalg.norm(robot.xy - thing.center[:2]) < 1.0


def test_found_where_the_map_has_it():
    navigator, robot, mug = home()
    assert navigator.ask("the mug") is None
    outcome = drive(navigator, robot)
    assert outcome.found
    assert len(outcome.attempts) == 1
    assert outcome.attempts[0].found_id == 110
    np.testing.assert_allclose(outcome.target_world, mug.center, atol=0.05)
    assert stops_by(robot, mug)


def test_moved_within_its_anchor():
    navigator, robot, mug = home(now=(1, 0.35, -0.2))
    navigator.ask("mug")
    outcome = drive(navigator, robot)
    assert (outcome.ending, len(outcome.attempts)) == ("found", 1)
    assert stops_by(robot, mug)


def test_moved_to_another_anchor():
    navigator, robot, mug = home(now=(4,))
    navigator.ask("mug")
    outcome = drive(navigator, robot)
    print(navigator.log, outcome)
    assert outcome.found
    assert stops_by(robot, mug)


def test_absent():
    navigator, robot, _ = home(now=())
    navigator.ask("mug")
    outcome = drive(navigator, robot)
    print(navigator.log, outcome)
    assert outcome.ending == "not_found"
