"""What is true of a trial: how far the robot is from what was meant, whether it sees it, and whether the map knew it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.driving.trials import Trial
from seo_slam.evaluation.navigation import SUCCESS_M
from seo_slam.geometry import FloatArray
from seo_slam.simulation.free_space import FreeSpace
from seo_slam.simulation.shortest import ShortestWays
from seo_slam.simulation.standpoints import EYE_M, SEEN_SHARE, Standpoints
from seo_slam.simulation.world import Thing, World

_BESIDE_M = 0.25  # around a footprint, a thing's middle still belongs to it: one side of furniture may never have been seen


@dataclass(frozen=True, slots=True)
class Stop:
    """Where a robot ended, held against the nearest of the things that were meant. Metres in the plane.

    Attributes:
        thing_id: which is the nearest.
        distance_m: to its middle.
        surface_m: to the edge of its box, seen from above.
        in_sight: whether it is seen from there, by a camera that may turn.
    """

    thing_id: int
    distance_m: float
    surface_m: float
    in_sight: bool


def judged_stop(world: World, free: FreeSpace, targets: Sequence[Thing], xy_world: FloatArray) -> Stop:
    """Return what is true of a stop at a point (2,).

    Args:
        world: as it is in the trial.
        free: its floor.
        targets: what was meant, in this world.
        xy_world: where the robot stands.
    """
    thing = min(targets, key=lambda t: (distance_m(t, xy_world), t.id))
    eye = np.array([[*np.asarray(xy_world)[:2], EYE_M]])
    share = float(Standpoints(world, free).seen_shares(thing, eye)[0])
    return Stop(thing.id, distance_m(thing, xy_world), edge_m(thing.corners_world()[:, :2], xy_world), share >= SEEN_SHARE)


def distance_m(thing: Thing, p_world: FloatArray) -> float:
    """Return how far a point (2 or 3,) is from the middle of a thing, in the plane."""
    return float(np.linalg.norm(thing.p_world[:2] - np.asarray(p_world)[:2]))


def edge_m(corners: FloatArray, xy: FloatArray) -> float:
    """Return how far a point (2,) is from the convex hull of points (N, 2); 0 inside."""
    offsets = np.asarray(corners) - np.asarray(xy)[:2]
    angles = np.sort(np.arctan2(offsets[:, 1], offsets[:, 0]))
    if np.diff(angles, append=angles[0] + 2.0 * np.pi).max() <= np.pi:
        return 0.0  # they are all around it
    return min(_segment_m(a, b) for a, b in combinations(offsets, 2))


def _segment_m(a: FloatArray, b: FloatArray) -> float:
    """How far the origin is from the segment between two points (2,)."""
    along = b - a
    square = float(along @ along)
    share = min(max(-float(a @ along) / square, 0.0), 1.0) if square > 0 else 0.0
    return float(np.linalg.norm(a + share * along))


def shortest_m(ways: ShortestWays, start_xy: FloatArray, targets: Sequence[Thing]) -> float:
    """Return how long the shortest way is to a place within ``SUCCESS_M`` of what is meant; infinity if there is none."""
    lengths_m = ways.lengths_m(start_xy)
    return min(float(lengths_m[ways.within(thing.p_world, SUCCESS_M)].min(initial=np.inf)) for thing in targets)


def is_mapped(home: World, trial: Trial, abstract_map: AbstractMap) -> bool:
    """Whether the abstract map has one of the things that are meant where it stood when the home was mapped.

    It has it if an anchor whose footprint's box, 25 cm larger, holds the thing's middle is called by one of its words, or carries
    something that is.
    """
    for thing in (home.thing(i) for i in trial.target_ids):
        words = {word.casefold() for word in (thing.label, *thing.accepted_labels)}
        for anchor in abstract_map.anchors:
            low, high = anchor.bounds_world
            here = (thing.p_world[:2] >= low - _BESIDE_M).all() and (thing.p_world[:2] <= high + _BESIDE_M).all()
            called = {label.casefold() for label in (anchor.label, *(v.label for v in anchor.volatiles))}
            if here and words & called:
                return True
    return False
