"""Small things on furniture: where they can rest and be reached, and on what they stand."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.catalogue import pose
from seo_slam.simulation.free_space import FreeSpace, home_caster
from seo_slam.simulation.home_models import Model
from seo_slam.simulation.placement import Surfaces, gap_m
from seo_slam.simulation.standpoints import Standpoints
from seo_slam.simulation.world import Light, Thing, World

APART_M = 0.03
"""Things on furniture keep this distance between their boxes."""

_MARGIN_M = 0.01  # from the rim
_LEVELS_M = (0.15, 1.45)  # heights of the surfaces in use: what is higher is not seen from 1.3 m
_SAME_LEVEL_M = 0.015
_LEAST_SHARE = 0.12  # of a piece of furniture, that a surface takes
_ANCHOR_TRIES, _SPOT_TRIES = 12, 14
_MOST_ON_ONE = 4
_NOT_CARRYING = ("chair", "room divider")


class Carriers:
    """The furniture of a home on which things can stand."""

    def __init__(self, world: World, free: FreeSpace) -> None:
        """Find the level surfaces of every anchor of a world.

        Args:
            world: what is carried about is passed over: furniture and structure count.
            free: where its floor is free.
        """
        bare = replace(world, things=tuple(thing for thing in world.things if thing.kind != "volatile"))
        self._surfaces = Surfaces(bare, home_caster(bare))
        self._standpoints = Standpoints(bare, free)
        anchors = [thing for thing in bare.things if thing.kind == "anchor" and thing.label not in _NOT_CARRYING]
        self._levels = {anchor.id: levels for anchor in anchors if (levels := _levels(anchor))}
        self.anchors: tuple[Thing, ...] = tuple(anchor for anchor in anchors if anchor.id in self._levels)
        """Those with a surface to stand on."""

    def rest(
        self,
        model: Model | Thing,
        thing_id: int,
        anchors: Sequence[Thing],
        others: Sequence[Thing],
        draws: np.random.Generator,
        away_from: FloatArray | None = None,
        least_m: float = 0.0,
    ) -> Thing | None:
        """Return a thing at rest on one of some anchors, clear of the others, with a place to stand within 1 m that sees it.

        Args:
            model: what it looks like.
            thing_id: its id.
            anchors: which may carry it.
            others: all other things that are carried about.
            draws: of the place.
            away_from: (3,) world frame; it comes to rest at least ``least_m`` from there.
            least_m: see ``away_from``.

        Returns:
            None if no place was found.
        """
        thing = model if isinstance(model, Thing) else model.thing(thing_id, np.eye(4))
        known = [anchor for anchor in anchors if anchor.id in self._levels]
        for _ in range(_ANCHOR_TRIES if known else 0):
            anchor = known[int(draws.integers(len(known)))]
            for placed in self._spots(thing, anchor, draws):
                far = away_from is None or float(np.linalg.norm(placed.p_world - away_from)) >= least_m
                if far and all(gap_m(placed, other) >= APART_M for other in others) and self._standpoints.can_be_reached(placed, others):
                    return placed
        return None

    def below(self, thing: Thing) -> int | None:
        """Return the id of the anchor that a thing stands on."""
        return carrier_below(thing, self._surfaces)

    def _spots(self, thing: Thing, anchor: Thing, draws: np.random.Generator) -> Iterator[Thing]:
        low, high = anchor.bounds_world
        for _ in range(_SPOT_TRIES):
            level = self._levels[anchor.id][int(draws.integers(len(self._levels[anchor.id])))]
            turned = thing.at(pose(omega=(0.0, 0.0, float(draws.uniform(-np.pi, np.pi)))))
            own_low, own_high = turned.bounds_world
            first, last = low[:2] - own_low[:2] + _MARGIN_M, high[:2] - own_high[:2] - _MARGIN_M
            share = draws.random(2)
            if (first > last).any():
                continue
            xy = first + share * (last - first)
            tall = float(own_high[2] - own_low[2])
            footing = self._surfaces.below(own_low[:2] + xy - _MARGIN_M, own_high[:2] + xy + _MARGIN_M, level + tall + _SAME_LEVEL_M + 0.01)
            if footing is None or footing.owner is not anchor or abs(footing.at_m - level) > _SAME_LEVEL_M:
                continue
            T = turned.T_world_thing.copy()
            T[:3, 3] = (*xy, footing.at_m - own_low[2])
            yield thing.at(T)


def anchor_of(world: World, thing_id: int) -> int | None:
    """Return the id of the piece of furniture on which a thing stands; None if it stands on the floor or hangs.

    Raises:
        ConfigError: no such thing.
    """
    world.thing(thing_id)
    return anchors_of(world).get(thing_id)


def anchors_of(world: World) -> dict[int, int | None]:
    """Return, for each thing that people carry about, the id of the furniture on which it stands; None as in ``anchor_of``."""
    bare = replace(world, things=tuple(other for other in world.things if other.kind != "volatile"))
    surfaces = Surfaces(bare, home_caster(bare))
    return {thing.id: carrier_below(thing, surfaces) for thing in world.things if thing.kind == "volatile"}


def carrier_below(thing: Thing, surfaces: Surfaces) -> int | None:
    """Return the id of the anchor straight below the middle of a thing, within 2 cm of its base."""
    middle, base_m = thing.p_world[:2], float(thing.bounds_world[0][2])
    footing = surfaces.below(middle - 0.002, middle + 0.002, base_m + 0.02)
    if footing is None or footing.owner.kind != "anchor" or abs(footing.at_m - base_m) > 0.02:
        return None
    return footing.owner.id


def _levels(anchor: Thing) -> tuple[float, ...]:
    """Heights at which rays from above meet much of an anchor: its top, its boards, and their undersides, on which nothing rests."""
    caster = home_caster(World((anchor,), (), Light(np.array([0.0, 0.0, 1.0])), np.zeros(3)))
    low, high = anchor.bounds_world
    x, y = np.meshgrid(*(np.linspace(a + 0.02, b - 0.02, 12) for a, b in zip(low[:2], high[:2], strict=True)))
    p = np.stack([x.ravel(), y.ravel(), np.full(x.size, high[2] + 0.1)], axis=-1)
    met: list[FloatArray] = []
    for _ in range(40):
        t = caster.cast(p, np.tile([0.0, 0.0, -1.0], (len(p), 1))).t
        p, t = p[np.isfinite(t)], t[np.isfinite(t)]
        if not len(p):
            break
        p = p - np.column_stack([np.zeros((len(t), 2)), t])
        met.append(p[:, 2].copy())
        p[:, 2] -= 1e-3
    heights = np.sort(np.concatenate(met)) if met else np.zeros(0)
    heights = heights[(heights >= _LEVELS_M[0]) & (heights <= _LEVELS_M[1])]
    groups = np.split(heights, np.flatnonzero(np.diff(heights) > _SAME_LEVEL_M / 2) + 1)
    return tuple(float(group.max()) for group in groups if len(group) >= _LEAST_SHARE * x.size)


def put_on_furniture(world: World, free: FreeSpace, models: Sequence[Model], draws: np.random.Generator) -> World:
    """Return the world with small things at rest on its furniture, spread over it.

    Raises:
        ConfigError: something found no place; the message names it.
    """
    carriers = Carriers(world, free)
    if not carriers.anchors:
        raise ConfigError("home: got no furniture with a level surface, wanted some to put things on")
    carried = [thing for thing in world.things if thing.kind == "volatile"]
    count = dict.fromkeys((anchor.id for anchor in carriers.anchors), 0)
    next_id = max((thing.id for thing in world.things), default=0) + 1
    for model in sorted(models, key=_bulk, reverse=True):
        usable = [anchor for anchor in carriers.anchors if count[anchor.id] < _MOST_ON_ONE]
        least = min(count[anchor.id] for anchor in usable) if usable else 0
        rested = carriers.rest(model, next_id, [anchor for anchor in usable if count[anchor.id] <= least + 1], carried, draws)
        rested = rested or carriers.rest(model, next_id, usable, carried, draws)
        if rested is None:
            raise ConfigError(f"home: no free place for the {model.label} (thing {next_id}) on {len(carriers.anchors)} pieces of furniture")
        carried.append(rested)
        anchor_id = carriers.below(rested)
        if anchor_id in count:
            count[anchor_id] += 1
        next_id += 1
    kept = [thing for thing in world.things if thing.kind != "volatile"]
    return replace(world, things=tuple(sorted((*kept, *carried), key=lambda thing: thing.id)))


def _bulk(model: Model) -> float:
    low, high = model.thing(1, np.eye(4)).bounds_thing
    return float(np.prod(high - low))
