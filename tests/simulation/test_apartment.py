"""Seeded apartments: rooms, furniture, things on it, free floor."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from homes import apartment

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.simulation.apartment import SimulatedApartment
from seo_slam.simulation.apartment_plan import FURNITURE, ROOMS, THINGS
from seo_slam.simulation.desk import footprints_overlap
from seo_slam.simulation.floor_plan import draw_floor_plan
from seo_slam.simulation.free_space import ROBOT_RADIUS_M, FreeSpace, free_space, home_caster, without_ceiling
from seo_slam.simulation.placement import gap_m
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.standpoints import Standpoints

SEEDS = (0, 1, 2)
NAMES = ("a", "b", "c", "d", "e")


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("rooms", range(ROOMS[0], ROOMS[1] + 1))
def test_every_room_of_a_plan_has_a_way_to_every_other(seed: int, rooms: int) -> None:
    plan = draw_floor_plan(seed, 0, NAMES[:rooms], (10.0, 8.0))
    assert sum(room.area_m2 for room in plan.rooms) == pytest.approx(80.0)
    reached = {plan.rooms[0].name}
    for _ in plan.rooms:
        for door in plan.doors:
            assert door.high - door.low >= 0.8
            x, y = door.middle
            beside = {r.name for r in plan.rooms if r.x[0] <= x <= r.x[1] and r.y[0] <= y <= r.y[1]}
            assert len(beside) == 2
            reached |= beside if beside & reached else set()
    assert reached == {room.name for room in plan.rooms}


@pytest.mark.parametrize("seed", SEEDS)
def test_furniture_and_things(seed: int) -> None:
    home = apartment(seed)
    assert home.plan is not None
    assert ROOMS[0] <= len(home.plan.rooms) <= ROOMS[1]
    anchors = [thing for thing in home.world.things if thing.kind == "anchor"]
    small = [thing for thing in home.world.things if thing.kind == "volatile"]
    assert FURNITURE[0] <= len(anchors) <= FURNITURE[1]
    assert THINGS[0] <= len(small) <= THINGS[1]
    for a, b in combinations(anchors, 2):
        assert not footprints_overlap(a, b), (a.label, b.label)
    for a, b in combinations(small, 2):
        assert gap_m(a, b) > 0.02, (a.label, b.label)
    for anchor in anchors:
        low, high = anchor.bounds_world
        assert low[2] == pytest.approx(0.0, abs=1e-6)
        room = [r for r in home.plan.rooms if r.x[0] < anchor.p_world[0] < r.x[1] and r.y[0] < anchor.p_world[1] < r.y[1]]
        x0, y0, x1, y1 = room[0].inside
        assert (low[:2] >= (x0, y0)).all(), anchor.label
        assert (high[:2] <= (x1, y1)).all(), anchor.label
    assert min(np.linalg.norm(thing.p_world[:2]) for thing in home.world.things) > 1.0


@pytest.mark.parametrize("seed", SEEDS)
def test_things_rest_on_furniture_and_can_be_reached(seed: int) -> None:
    home = apartment(seed)
    standing = anchors_of(home.world)
    assert None not in standing.values()
    standpoints = Standpoints(home.world, home.free)
    for thing_id, anchor_id in standing.items():
        thing, anchor = home.world.thing(thing_id), home.world.thing(anchor_id or 0)
        low, high = thing.bounds_world
        anchor_low, anchor_high = anchor.bounds_world
        assert (low[:2] >= anchor_low[:2]).all(), thing.label
        assert (high[:2] <= anchor_high[:2]).all(), thing.label
        assert anchor_low[2] < low[2] <= anchor_high[2] + 1e-6, thing.label
        assert standpoints.can_be_reached(thing), thing.label
    assert len(set(standing.values())) >= len(standing) / 4  # spread over the home


@pytest.mark.parametrize("seed", SEEDS)
def test_the_free_floor_is_one_part_and_reaches_every_room(seed: int) -> None:
    home = apartment(seed)
    assert home.free.connected_share(ROBOT_RADIUS_M) == 1.0
    assert home.plan is not None
    main = home.free.main_part(ROBOT_RADIUS_M)
    for door in home.plan.doors:
        assert main[tuple(home.free.cells(np.array([door.middle]))[0])]
    middles = home.free.middles(np.argwhere(main))
    for room in home.plan.rooms:
        inside = (middles >= (room.x[0], room.y[0])) & (middles <= (room.x[1], room.y[1]))
        assert inside.all(axis=1).mean() > 0.05, room.name


def test_free_floor_agrees_with_rays_and_boxes() -> None:
    """A robot's disc anywhere on the free floor touches no box of furniture and no wall."""
    home = apartment(0)
    cells = np.argwhere(home.free.main_part(ROBOT_RADIUS_M))
    xy = home.free.middles(cells[:: max(len(cells) // 200, 1)])
    for thing in home.world.things:
        low, high = thing.bounds_world
        away = np.linalg.norm(np.maximum(np.maximum(low[:2] - xy, xy - high[:2]), 0.0), axis=1)
        assert thing.kind == "volatile" or away.min() > ROBOT_RADIUS_M - home.free.cell_m, thing.label
    caster = home_caster(without_ceiling(home.world))
    for turn in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
        rays = np.tile([np.cos(turn), np.sin(turn), 0.0], (len(xy), 1))
        assert (caster.cast(np.column_stack([xy, np.full(len(xy), 0.4)]), rays).t > ROBOT_RADIUS_M - home.free.cell_m).all()


def test_clearance_of_a_known_grid() -> None:
    occupied = np.zeros((5, 41), dtype=bool)
    occupied[:, 20] = True
    free = FreeSpace(occupied, np.array([3.0, 1.0]), 0.1)
    assert free.clearance_at(np.array([[3.05 + 1.0, 1.25]]))[0] == pytest.approx(10 * 0.1 - 0.95, abs=0.2)
    assert free.connected_share(0.01) == pytest.approx(0.5)
    assert (free.cells(free.middles(np.array([[3, 7]]))) == [[3, 7]]).all()
    assert free.clearance_at(np.array([[0.0, 0.0]]))[0] == 0.0


def test_a_world_without_floor_is_refused() -> None:
    with pytest.raises(ConfigError, match="wanted a floor"):
        free_space(replace(apartment(0).world, structure=()))


def test_the_same_in_every_process() -> None:
    script = (
        "import hashlib, numpy as np\n"
        "from seo_slam.simulation.apartment_plan import plan_apartment\n"
        "home = plan_apartment(0)\n"
        "d = hashlib.sha256(b''.join(t.T_world_thing.tobytes() + t.label.encode() for t in home.world.things))\n"
        "d.update(home.free.occupied.tobytes())\n"
        "print(d.hexdigest())\n"
    )
    there = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.strip()
    home = apartment(0)
    here = hashlib.sha256(b"".join(thing.T_world_thing.tobytes() + thing.label.encode() for thing in home.world.things))
    here.update(home.free.occupied.tobytes())
    assert there == here.hexdigest()


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="level"):
        SimulatedApartment(level=-1.0)
    with pytest.raises(ConfigError, match="image size"):
        SimulatedApartment(width=8)
    with pytest.raises(DatasetError, match=r"manifest\.json"):
        SimulatedApartment(meshes=tmp_path)
