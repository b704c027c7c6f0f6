"""Things that are moved in a home, and recordings of it."""

import json
from itertools import combinations

import numpy as np
import pytest
from homes import apartment

from seo_slam.errors import ConfigError
from seo_slam.simulation.home import MOVED, REMOVED, SimulatedHome
from seo_slam.simulation.placement import gap_m
from seo_slam.simulation.relocation import Relocation, anchor_of, relocated
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.scene import Scene
from seo_slam.simulation.standpoints import Standpoints
from seo_slam.simulation.world import Thing


@pytest.mark.parametrize("kind", ["in_anchor", "cross_anchor"])
@pytest.mark.parametrize("seed", range(2))
def test_moved_things_rest_elsewhere(kind: Relocation, seed: int) -> None:
    home = apartment(0)
    changes = relocated(home.world, kind, 5, seed, free=home.free)
    assert len({change.thing.id for change in changes}) == 5
    after = Scene(home.world, changes).end
    was, now = anchors_of(home.world), anchors_of(after)
    small = [thing for thing in after.things if thing.kind == "volatile"]
    for a, b in combinations(small, 2):
        assert gap_m(a, b) > 0.02, (a.label, b.label)
    standpoints = Standpoints(after, home.free)
    for change in changes:
        thing = change.thing
        assert now[thing.id] is not None
        assert (now[thing.id] == was[thing.id]) == (kind == "in_anchor"), thing.label
        assert np.linalg.norm(thing.p_world - home.world.thing(thing.id).p_world) > 0.05
        assert standpoints.can_be_reached(thing)
    far = [np.linalg.norm(c.thing.p_world - home.world.thing(c.thing.id).p_world) >= 0.2 for c in changes]
    assert np.mean(far) >= 0.6  # small furniture has no room for more
    untouched = {thing.id for thing in small} - {change.thing.id for change in changes}
    assert all(after.thing(i) is home.world.thing(i) for i in untouched)


def test_the_same_seed_moves_the_same_things() -> None:
    home = apartment(0)

    def moves(seed: int) -> list[tuple[int, list[float]]]:
        return [
            (c.thing.id, c.thing.T_world_thing.ravel().tolist()) for c in relocated(home.world, "cross_anchor", 3, seed, free=home.free)
        ]

    assert moves(4) == moves(4) != moves(5)


def test_things_to_keep_stay() -> None:
    home = apartment(0)
    small = sorted(thing.id for thing in home.world.things if thing.kind == "volatile")
    changes = relocated(home.world, "cross_anchor", 2, 0, free=home.free, keep=small[2:])
    assert {change.thing.id for change in changes} == set(small[:2])


def test_bad_relocations() -> None:
    home = apartment(0)
    with pytest.raises(ConfigError, match="wanted in_anchor or cross_anchor"):
        relocated(home.world, "sideways", 1)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="got 50 things to move"):
        relocated(home.world, "in_anchor", 50, free=home.free)
    with pytest.raises(ConfigError, match="got -1"):
        relocated(home.world, "in_anchor", -1)
    with pytest.raises(ConfigError, match="got thing 999"):
        anchor_of(home.world, 999)
    assert relocated(home.world, "in_anchor", 0) == []


def test_what_hangs_in_the_air_has_no_anchor() -> None:
    world = apartment(0).world
    thing = next(thing for thing in world.things if thing.kind == "volatile")
    assert anchor_of(world, thing.id) is not None
    lifted = thing.T_world_thing.copy()
    lifted[2, 3] += 0.1
    assert anchor_of(world.with_thing(thing.at(lifted)), thing.id) is None


def test_changes_during_a_tour_are_seen_afterwards() -> None:
    home = apartment(1)
    film = SimulatedHome("apartment", home.world, home.free, seed=1, frames=360, width=160, height=120, level=0.0)
    events = [change.event for change in film.scene.changes]
    assert (events.count("removed"), events.count("moved")) == (REMOVED, MOVED)
    assert len({change.thing.id for change in film.scene.changes}) == REMOVED + MOVED
    labels = [thing.label for thing in film.world.things]
    assert all(labels.count(change.thing.label) == 1 for change in film.scene.changes)
    truth = film.truth
    json.dumps(truth)
    rows = {row["id"]: row for row in truth["objects"]}
    seen = np.array([row["visible_keyframes"] >= 5 for row in rows.values()])
    assert seen.mean() >= 0.95
    assert all(rows[c.thing.id]["visible_keyframes"] >= 5 for c in film.scene.changes if c.event == "moved")
    for row in rows.values():
        assert row["anchor"] == (anchor_of(film.scene.end, row["id"]) if row["kind"] == "volatile" else None)


def test_a_second_recording_begins_in_the_changed_home() -> None:
    home = apartment(0)
    moved = relocated(home.world, "cross_anchor", 4, 1, free=home.free)
    film = SimulatedHome("again", home.world, home.free, changes=moved, frames=3, width=64, height=48)
    assert film.scene.world_at(0.0) is film.scene.end

    def places(things: tuple[Thing, ...]) -> dict[int, list[float]]:
        return {thing.id: thing.p_world.tolist() for thing in things}

    assert places(film.world.things) == places(Scene(home.world, moved).end.things)
    assert len(film.tour.legs_end_s) == 2
    assert film.tour.legs_end_s[1] - film.tour.legs_end_s[0] < 5.0  # nothing to go back to
    still = SimulatedHome("still", home.world, home.free, changes=False, frames=3, width=64, height=48)
    assert not still.scene.changes
