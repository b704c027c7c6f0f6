"""Tours: smooth, at walking pace, never near a wall, and they see everything."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from homes import apartment
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.errors import ConfigError
from seo_slam.simulation.free_space import FreeSpace, home_caster
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.tour import MOST_TURN_RAD_S, RATE_HZ, plan_tour
from seo_slam.simulation.tour_path import PATH_CLEARANCE_M, Line, Ways, smoothed, visiting_order
from seo_slam.simulation.tour_stops import Stop, stops_for

SEEDS = (0, 1)


@cache
def recording(seed: int) -> SimulatedHome:
    home = apartment(seed)
    return SimulatedHome("apartment", home.world, home.free, seed=seed, width=160, height=120)


@pytest.mark.parametrize("seed", SEEDS)
def test_walking_pace_and_gentle_turns(seed: int) -> None:
    tour = recording(seed).tour
    fine = tour.trajectory(int(10 * tour.seconds))
    steps_s = np.diff(fine.timestamps_s)
    moved = np.linalg.norm(np.diff(fine.T_world_camera[:, :3, 3], axis=0), axis=1) / steps_s
    assert moved.max() < 0.65
    assert moved[moved > 0.4].sum() > 0.5 * moved.sum()  # most of the way at walking pace; slower while it turns to look
    R = fine.T_world_camera[:, :3, :3]
    cosine = (np.einsum("nij,nij->n", R[:-1], R[1:]) - 1.0) / 2.0
    turned = np.arccos(np.clip(cosine, -1.0, 1.0)) / steps_s
    assert turned.max() < MOST_TURN_RAD_S
    faster = np.abs(np.diff(moved)) / steps_s[1:]
    assert faster.max() < 1.2  # m/s^2: no jerk
    z = fine.T_world_camera[:, 2, 3]
    assert z.min() > 1.2
    assert z.max() < 1.4
    assert (fine.T_world_camera[:, 2, 2] < 0.1).all()  # it looks ahead or down
    assert np.abs(fine.T_world_camera[:, 2, 0]).max() < 1e-9  # and is level


@pytest.mark.parametrize("seed", SEEDS)
def test_never_near_or_through_anything(seed: int) -> None:
    film = recording(seed)
    p_world = film.tour.p_world
    assert film.free.clearance_at(p_world).min() >= PATH_CLEARANCE_M
    steps = np.diff(p_world, axis=0)
    going = np.linalg.norm(steps, axis=1) > 1e-6
    for world in film.scene.worlds:
        assert (home_caster(world).cast(p_world[:-1][going], steps[going]).t > 1.0).all()
    coarse = film.trajectory.T_world_camera[:, :3, 3]  # the frames as well, straight from one to the next
    steps = np.diff(coarse, axis=0)
    going = np.linalg.norm(steps, axis=1) > 1e-6
    assert (home_caster(film.world).cast(coarse[:-1][going], steps[going]).t > 1.0).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_every_room_and_everything_in_it_gets_a_stop(seed: int) -> None:
    home, film = apartment(seed), recording(seed)
    stops = stops_for(home.world, home.free, home.world.things)
    seen = {thing_id for stop in stops for thing_id in stop.seen_ids}
    assert seen == {thing.id for thing in home.world.things}
    assert home.plan is not None
    xy = film.tour.p_world[:, :2]
    for room in home.plan.rooms:
        inside = ((xy > (room.x[0], room.y[0])) & (xy < (room.x[1], room.y[1]))).all(axis=1)
        assert inside.any(), room.name


def test_frames() -> None:
    tour = recording(0).tour
    assert len(tour.trajectory()) == int(tour.seconds * RATE_HZ) + 1
    few = tour.trajectory(7)
    assert len(few) == 7
    assert few.timestamps_s[-1] == pytest.approx(tour.seconds, abs=1e-5)
    with pytest.raises(ConfigError, match="frames: got 1"):
        tour.trajectory(1)


def room_with_a_wall() -> FreeSpace:
    """4 x 4 m, cut in two by a wall with a gap of 1 m."""
    occupied = np.zeros((80, 80), dtype=bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[:60, 40] = True
    return FreeSpace(occupied, np.array([1.0, 1.0]))


def test_a_way_goes_round_the_wall() -> None:
    free = room_with_a_wall()
    ways = Ways(free)
    nodes = ways.nodes(np.array([[1.7, 1.7], [4.3, 1.7]]))
    costs, previous = ways.between(nodes)
    assert costs[0, 1] == pytest.approx(costs[1, 0])
    line = smoothed(ways.way(previous[0], int(nodes[0]), int(nodes[1])), free)
    at = Line(line).at(np.linspace(0.0, Line(line).length_m, 500))
    assert free.clearance_at(at).min() >= PATH_CLEARANCE_M
    assert at[:, 1].max() > 4.0  # through the gap
    assert Line(line).length_m < 7.0
    bend = np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(at, axis=0).T[::-1]))))
    assert bend.max() < 0.15  # no corner


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 12))
def test_an_order_visits_all_and_no_turned_stretch_is_shorter(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).uniform(0, 10, (count, 2))
    costs = np.linalg.norm(points[:, None] - points[None], axis=2)
    order = visiting_order(costs)
    assert order[0] == 0
    assert sorted(order) == list(range(count))

    def length(visit: list[int]) -> float:
        return float(sum(costs[a, b] for a, b in pairwise(visit)))

    for i in range(1, count):
        for j in range(i + 1, count):
            assert length(order) <= length([*order[:i], *order[i : j + 1][::-1], *order[j + 1 :]]) + 1e-9


def test_bad_tours() -> None:
    free = room_with_a_wall()
    with pytest.raises(ConfigError, match="no stops"):
        plan_tour(free, [[]], 0)
    stop = Stop(np.array([1.7, 1.7]), np.array([2.0, 2.5, 0.8]), (1,))
    with pytest.raises(ConfigError, match="single place"):
        plan_tour(free, [[stop]], 0)
    with pytest.raises(ConfigError, match="nobody can walk"):
        plan_tour(FreeSpace(np.ones((20, 20), dtype=bool), np.zeros(2)), [[stop, stop]], 0)
