"""The planner benchmark on a small floor: its truth is exact, and it sees collisions and ways that are missed."""

import numpy as np
import planner
import pytest

from seo_slam.errors import NoPathError
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.settings.planning import PlannerSettings
from seo_slam.simulation.free_space import FreeSpace


@pytest.fixture
def free():
    occupied = np.zeros((40, 60), dtype=np.bool_)
    occupied[15:25, 28:32] = occupied[5, 50] = True
    return FreeSpace(occupied, np.array([1.0, -2.0]))


def test_true_clearance_is_the_distance_from_squares(free):
    points = np.random.default_rng(0).uniform([0.9, -2.1], [4.1, 0.1], (400, 2))
    squares = np.argwhere(np.pad(free.occupied, 8, constant_values=True))[:, ::-1] - 8
    low = free.corner_world + squares * free.cell_m
    beside = np.maximum(np.maximum(low[None] - points[:, None], points[:, None] - low[None] - free.cell_m), 0.0)
    wanted = np.minimum(np.linalg.norm(beside, axis=2).min(axis=1), planner.MOST_CLEARANCE_M)
    np.testing.assert_allclose(planner.Truth(free).clearance_m(points), wanted, atol=1e-9)
    assert 0 < (wanted > 0).sum() < 400


def test_both_planners_are_clean_on_a_small_floor(free):
    row = planner.planned(planner.true_layout(free), planner.Truth(free), planner.Options(40, 5, 0, PlannerSettings()))
    for kind, pairs in (("global", 40), ("local", 5)):
        assert row[kind]["exist"] == row[kind]["found"] == pairs
        assert row[kind]["missed"] == row[kind]["in_collision"] == row[kind]["wrongly_found"] == 0
        assert row[kind]["least_true_clearance_m"] >= 0.18
    assert row["largest_part_share"] == 1.0


class Straight:
    """Goes straight, whatever is in the way."""

    def path(self, a, b):
        return np.stack([a, b])


class Lazy:
    def path(self, a, b):
        raise NoPathError("too far")


def test_collisions_and_missed_ways_are_counted(free):
    grid = NavigationGrid(planner.true_layout(free), 0.18)
    straight = planner._asked(Straight(), grid, planner.Truth(free), 60, 0, np.inf)
    assert 0 < straight["in_collision"] < 60
    lazy = planner._asked(Lazy(), grid, planner.Truth(free), 20, 0, np.inf)
    assert lazy["missed"] == 20
    assert lazy["found"] == 0


def test_an_unknown_home(capsys):
    assert planner.main(["--homes", "castle"]) == 2
    assert "castle" in capsys.readouterr().err
