"""The judge of a trial: distances, sight through walls, the shortest way, and what the map knew."""

from dataclasses import replace

import numpy as np
import pytest
from driven_homes import apartment

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Volatile
from seo_slam.driving.judging import distance_m, edge_m, is_mapped, judged_stop, shortest_m
from seo_slam.driving.trials import Trial, make_trials
from seo_slam.evaluation.navigation import SUCCESS_M
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.shortest import ShortestWays
from seo_slam.simulation.standpoints import SEEN_SHARE, Standpoints

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]])


@pytest.mark.parametrize(
    ("xy", "away_m"),
    [((0.5, 0.5), 0.0), ((0.2, 0.9), 0.0), ((2.0, 0.5), 1.0), ((2.0, 2.0), 2**0.5), ((-0.5, 0.1), 0.5), ((0.5, -3.0), 3.0)],
)
def test_distance_to_the_edge_of_a_hull(xy, away_m):
    assert edge_m(SQUARE, np.array(xy)) == pytest.approx(away_m)


def carried():
    """A small thing that stands on furniture, and that furniture."""
    world = apartment().world
    anchors = anchors_of(world)
    thing = next(thing for thing in world.things if thing.kind == "volatile" and anchors[thing.id] is not None)
    return thing, world.thing(anchors[thing.id])


def test_a_stop_is_judged_by_the_nearest_thing_that_was_meant():
    world, free = apartment().world, apartment().free
    thing, _ = carried()
    eyes = Standpoints(world, free).near(thing, SUCCESS_M)
    far = max(world.things, key=lambda other: distance_m(other, eyes[0]))
    stop = judged_stop(world, free, [far, thing], eyes[0])
    assert stop.thing_id == thing.id
    assert stop.distance_m == pytest.approx(np.linalg.norm(eyes[0, :2] - thing.p_world[:2]))
    assert stop.distance_m - np.linalg.norm(thing.bounds_world[1] - thing.bounds_world[0]) <= stop.surface_m <= stop.distance_m


def test_sight_is_told_from_distance():
    world, free = apartment().world, apartment().free
    thing, _ = carried()
    standpoints = Standpoints(world, free)
    eyes = standpoints.near(thing, 6.0)
    shares = standpoints.seen_shares(thing, eyes)
    assert judged_stop(world, free, [thing], eyes[int(np.argmax(shares))]).in_sight
    hidden = eyes[int(np.argmin(shares))]
    assert shares.min() < SEEN_SHARE
    assert not judged_stop(world, free, [thing], hidden).in_sight


def test_the_shortest_way_ends_where_success_is_possible():
    home = apartment()
    ways = ShortestWays(home.free)
    for trial in make_trials(home, "static", 6, seed=3):
        things = [home.world.thing(i) for i in trial.target_ids]
        start = np.array(trial.start_xy)
        straight_m = min(distance_m(thing, start) for thing in things) - SUCCESS_M
        assert straight_m - 0.05 <= shortest_m(ways, start, things) < 30.0


def anchor_at(thing, label, *volatiles):
    """An anchor with the footprint of a thing's box."""
    low, high = (corner[:2] for corner in thing.bounds_world)
    feature = np.array([1.0, 0.0])
    carried_things = tuple(Volatile(word, feature, "on", 90 + k) for k, word in enumerate(volatiles))
    return Anchor(thing.id, label, feature, np.stack([low, high]), 10, (0.0, 1.0), 0.7, carried_things)


def asking_for(*ids):
    return Trial("static", 0, "it", tuple(ids), (0.0, 0.0), 0.0)


def test_a_small_thing_is_mapped_where_it_stands_under_one_of_its_words():
    world = apartment().world
    thing, furniture = carried()
    elsewhere = max(world.things, key=lambda other: distance_m(other, thing.p_world))
    trial = asking_for(thing.id)
    assert is_mapped(world, trial, AbstractMap((anchor_at(furniture, "thing", thing.label.upper()),)))
    assert not is_mapped(world, trial, AbstractMap((anchor_at(furniture, "thing", "something else"),)))
    assert not is_mapped(world, trial, AbstractMap((anchor_at(elsewhere, "thing", thing.label),)))
    assert not is_mapped(world, trial, AbstractMap(()))


def test_furniture_is_mapped_as_an_anchor_under_an_accepted_word():
    world = apartment().world
    _, furniture = carried()
    named = replace(furniture, accepted_labels=("the other word",))
    world = world.with_thing(named)
    assert is_mapped(world, asking_for(furniture.id), AbstractMap((anchor_at(furniture, "the other word"),)))
    assert not is_mapped(world, asking_for(furniture.id), AbstractMap((anchor_at(furniture, "a third word"),)))
