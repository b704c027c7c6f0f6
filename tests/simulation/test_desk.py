"""The seeded desk: what stands on it, and where."""

from itertools import combinations

import numpy as np
import pytest

from seo_slam.simulation.desk import DESK_CENTRE_M, DESK_HEIGHT_M, DESK_SIZE_M, build_desk, footprints_overlap
from seo_slam.simulation.trajectory import swaying_arc
from seo_slam.simulation.world import Part, Thing

INVENTORY = sorted(
    "monitor keyboard mouse lamp book book book football bowl flower box cup cup bottle apple".split()  # noqa: SIM905
)


def inside(part: Part, thing: Thing, p_world: np.ndarray) -> np.ndarray:
    """Whether points lie inside a part: a ray meets it both ways along each of two lines."""
    T = thing.T_world_thing @ part.T_thing_part
    p = (p_world - T[:3, 3]) @ T[:3, :3]
    out = np.ones(len(p), dtype=bool)
    for axis in ([0.3, 0.5, 0.8], [0.9, -0.2, 0.1]):
        for sign in (1, -1):
            out &= np.isfinite(part.shape.intersect(p, np.broadcast_to(sign * np.array(axis), p.shape)))
    return out


@pytest.mark.parametrize("seed", range(5))
def test_things_rest_on_the_desk_apart_from_each_other(seed: int) -> None:
    world = build_desk(seed)
    assert sorted(thing.label for thing in world.things) == INVENTORY
    centre, half = np.array(DESK_CENTRE_M), np.array(DESK_SIZE_M) / 2
    for thing in world.things:
        low, high = thing.bounds_world
        assert low[2] == pytest.approx(DESK_HEIGHT_M, abs=1e-9), thing.label
        assert (low[:2] > centre - half).all(), thing.label
        assert (high[:2] < centre + half).all(), thing.label
    draws = np.random.default_rng(seed)
    for a, b in combinations(world.things, 2):
        assert not footprints_overlap(a, b), (a.label, b.label)
        # The same by another way: no sampled point lies in a part of both.
        low = np.maximum(a.bounds_world[0], b.bounds_world[0])
        high = np.minimum(a.bounds_world[1], b.bounds_world[1])
        if (low < high).all():
            p = draws.uniform(low, high, (400, 3))
            in_a = np.any([inside(part, a, p) for part in a.parts], axis=0)
            in_b = np.any([inside(part, b, p) for part in b.parts], axis=0)
            assert not (in_a & in_b).any(), (a.label, b.label)


def test_overlap_is_noticed() -> None:
    world = build_desk(0)
    a, b = world.things[0], world.things[4]
    assert footprints_overlap(a, b.at(a.T_world_thing))
    middle = a.p_world[None, :]
    assert inside(a.parts[2], a, middle).all()


@pytest.mark.parametrize("seed", range(5))
def test_cups_stand_side_by_side(seed: int) -> None:
    cups = [thing for thing in build_desk(seed).things if thing.label == "cup"]
    apart = np.linalg.norm(cups[0].T_world_thing[:3, 3] - cups[1].T_world_thing[:3, 3])
    assert 0.1 <= apart <= 0.15


def test_many_seeds_find_a_place_and_differ() -> None:
    places = [build_desk(seed).things[8].p_world for seed in range(100, 106)]
    assert len(np.unique(np.round(places, 4), axis=0)) == len(places)


def test_same_seed_same_world() -> None:
    a, b = build_desk(3), build_desk(3)
    for first, second in zip(a.things, b.things, strict=True):
        assert (first.T_world_thing == second.T_world_thing).all()
        assert all((p.texture.levels == q.texture.levels).all() for p, q in zip(first.parts, second.parts, strict=True))


@pytest.mark.parametrize("seed", range(5))
def test_path_is_smooth_level_and_in_the_room(seed: int) -> None:
    path = swaying_arc(build_desk(seed).gaze_world, 90, seed)
    p = path.T_world_camera[:, :3, 3]
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) * 15.0
    assert speed.max() < 1.5
    assert np.abs(np.diff(speed)).max() < 0.1  # no jumps
    assert np.allclose(path.T_world_camera[:, 2, 0], 0.0)  # the camera's x axis stays level
    assert (path.T_world_camera[:, 2, 1] < 0).all()  # its y axis points down
    assert (p[:, 1] > 0.3).all()
    assert ((p[:, 0] > 0.2) & (p[:, 0] < 4.0)).all()
    assert (p[:, 1] < DESK_CENTRE_M[1] - DESK_SIZE_M[1] / 2).all()
