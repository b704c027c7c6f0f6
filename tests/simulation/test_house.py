"""The furnished house from its scene file."""

import json
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.simulation.free_space import ROBOT_RADIUS_M, home_caster
from seo_slam.simulation.house import THINGS, SimulatedHouse, furnished_house
from seo_slam.simulation.placement import gap_m
from seo_slam.simulation.relocation import relocated
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.scene import Scene
from seo_slam.simulation.standpoints import Standpoints
from seo_slam.simulation.tour_path import PATH_CLEARANCE_M


@cache
def house(meshes: Path) -> SimulatedHouse:
    return SimulatedHouse(seed=0, meshes=meshes, width=160, height=120, frames=60)


@pytest.fixture(scope="module")
def film(shared: Path) -> SimulatedHouse:
    return house(shared / "meshes")


def test_the_house_stands_as_its_file_says(shared: Path) -> None:
    world = furnished_house(shared / "meshes" / "aws-small-house")
    anchors = [thing.label for thing in world.things if thing.kind == "anchor"]
    for label, count in {"bed": 1, "sofa": 1, "table": 1, "desk": 1, "nightstand": 2, "wardrobe": 1, "chair": 8, "coffee table": 2}.items():
        assert anchors.count(label) == count, label
    low = np.min([thing.bounds_world[0] for thing in world.structure], axis=0)
    high = np.max([thing.bounds_world[1] for thing in world.structure], axis=0)
    assert low == pytest.approx([-9.5, -5.7, 0.0], abs=0.03)
    assert high == pytest.approx([9.5, 5.7, 3.0], abs=0.03)
    bed = next(thing for thing in world.things if thing.label == "bed")
    assert bed.bounds_world[0] == pytest.approx([-7.18, 1.03, 0.0], abs=0.02)
    assert bed.bounds_world[1] == pytest.approx([-5.15, 3.03, 1.26], abs=0.02)
    assert bed.bounds_thing[0][2] == pytest.approx(0.0, abs=1e-6)
    words = {thing.label for thing in world.structure}
    assert {"floor", "house wall b", "curtain", "folding door"} <= words


def test_things_rest_on_its_furniture(film: SimulatedHouse) -> None:
    small = [thing for thing in film.world.things if thing.model.startswith("ycb_")]
    assert THINGS[0] <= len(small) <= THINGS[1]
    standing = anchors_of(film.world)
    standpoints = Standpoints(film.world, film.free)
    for thing in small:
        assert standing[thing.id] is not None, thing.label
        assert standpoints.can_be_reached(thing), thing.label
    for a, b in combinations(small, 2):
        assert gap_m(a, b) > 0.02, (a.label, b.label)
    bins = [thing.id for thing in film.world.things if thing.label == "bin"]
    assert [standing[i] for i in bins] == [None, None]


def test_the_floor_is_open_through_the_doors(film: SimulatedHouse) -> None:
    assert film.free.connected_share(ROBOT_RADIUS_M) > 0.99
    main = film.free.main_part(ROBOT_RADIUS_M)
    for xy in ([-6.0, -4.0], [-6.0, 0.0], [2.0, 1.5], [7.0, -1.0], [0.3, 3.2]):
        assert main[tuple(film.free.cells(np.array([xy]))[0])], xy
    assert not main[tuple(film.free.cells(np.array([[-6.2, 2.0]]))[0])]  # the bed


def test_the_tour_goes_through_it_and_never_near_a_wall(film: SimulatedHouse) -> None:
    p_world = film.tour.p_world
    assert film.free.clearance_at(p_world).min() >= PATH_CLEARANCE_M
    steps = np.diff(p_world, axis=0)
    going = np.linalg.norm(steps, axis=1) > 1e-6
    assert (home_caster(film.world).cast(p_world[:-1][going], steps[going]).t > 1.0).all()
    low, high = p_world.min(axis=0), p_world.max(axis=0)
    assert low[0] < -6.0
    assert high[0] > 6.0


def test_a_frame_and_the_truth(film: SimulatedHouse) -> None:
    frame = film.frame(30)
    assert frame.depth_m.max() > 0.3
    assert len(np.unique(film.rendered(30).instance_ids)) > 1
    row = film.truth["objects"][0]
    assert {"kind", "anchor"} <= set(row)


def test_things_can_be_moved_about(film: SimulatedHouse) -> None:
    changes = relocated(film.world, "cross_anchor", 3, 0, free=film.free)
    was, now = anchors_of(film.world), anchors_of(Scene(film.world, changes).end)
    assert all(now[c.thing.id] not in (None, was[c.thing.id]) for c in changes)


def test_bad_input(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="got no mesh folder"):
        SimulatedHouse()
    with pytest.raises(DatasetError, match=r"got no scene\.json"):
        SimulatedHouse(meshes=tmp_path)
    scene = tmp_path / "scene.json"
    eye = np.eye(3).tolist()
    for content, words in (
        ("{", "not readable as JSON"),
        ("{}", "wanted a list"),
        (json.dumps([{"name": "Bed_01"}]), "row 0: got"),
        (json.dumps([{"name": "Bed_01", "file": "bed.glb", "R": eye}]), r"row 0 \(Bed_01\)"),
        (json.dumps([{"name": "Bed_01", "file": "bed.glb", "R": (2 * np.eye(3)).tolist(), "t": [0, 0, 0]}]), r"row 0 \(Bed_01\)"),
        (json.dumps([{"name": "Bed_01", "file": "bed.glb", "R": eye, "t": [0, 0]}]), r"row 0 \(Bed_01\)"),
        (json.dumps([{"name": "Bed_01", "file": "bed.glb", "R": eye, "t": [0, 0, 0]}]), r"bed\.glb"),
    ):
        scene.write_text(content, encoding="utf-8")
        with pytest.raises(DatasetError, match=words):
            furnished_house(tmp_path)
