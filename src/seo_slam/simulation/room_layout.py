"""Puts the things of a room in their places: copies close together, everything on a real surface, nothing inside another."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.catalogue import pose
from seo_slam.simulation.placement import Surfaces, box_gap_m, gap_m
from seo_slam.simulation.room_models import RoomModel
from seo_slam.simulation.room_structure import RoomStructure, inside_room
from seo_slam.simulation.sightlines import Sightlines
from seo_slam.simulation.world import Thing

APART_M = 0.025
"""Things keep this distance between their boxes, …"""
COPIES_M = 0.18
"""… and copies of one label come this near to another copy (the paper's rooms: 2 to 20 cm)."""

_WALL_M = 0.04
_RIM_M = 0.01  # of level surface around what stands on it
_PATH_M = 0.5  # things on the floor keep this far from the camera's path
_SEEN_SHARE, _FLOOR_SEEN_SHARE = 0.25, 0.2  # of the path, by sightlines
_HIDES_M = 0.7  # what is farther off is hidden only now and then
_TURNS, _SPOTS = 8, 25  # tries for one thing: turns, and spots for each
_CLUSTERS = 20  # tries for all copies of a label
_TALL_M, _LOW_M, _FLAT_M = 0.22, 0.12, 0.05  # flat things are only seen well in front
_OUTLET_M = (0.12, 0.45)  # height of the outlet above the table tops


@dataclass(frozen=True, slots=True)
class _Area:
    """A rectangle in the plane from which places are drawn, and its share of the draws."""

    low: tuple[float, float]
    high: tuple[float, float]
    weight: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class _Spot:
    """A turned thing (at the world's origin), how far it is to be shifted in the plane, and the box (3,), (3,) it then has."""

    turned: Thing
    shift_xy: FloatArray
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, turned: Thing, xy: FloatArray) -> "_Spot":
        """The spot at which the middle of the thing's box is at ``xy``."""
        low, high = turned.bounds_world
        shift = xy - ((low + high) / 2.0)[:2]
        return cls(turned, shift, low + np.append(shift, 0.0), high + np.append(shift, 0.0))


class Layout:
    """The places found so far in a room."""

    def __init__(self, structure: RoomStructure, surfaces: Surfaces, sightlines: Sightlines, models: Sequence[RoomModel]) -> None:
        """Begin with an empty room; thing ``k + 1`` has model ``k``."""
        self.structure = structure
        self._surfaces = surfaces
        self._sightlines = sightlines
        self._models = models
        self._tables = np.array([[corner[:2] for corner in table.bounds_world] for table in structure.tables])
        self.things: dict[int, Thing] = {}
        labels = list(dict.fromkeys(model.label for model in models))
        self._ids = {label: [k + 1 for k, model in enumerate(models) if model.label == label] for label in labels}

    def place_all(self, draws: np.random.Generator) -> None:
        """Find a place for everything: the outlet first, then what stands on the floor, then large before small.

        Raises:
            ConfigError: something found none; the message names it.
        """
        floor_side = float(draws.choice((-1.0, 1.0)))
        for label in sorted(self._ids, key=self._difficulty):
            self._place_label(label, draws, floor_side)
            floor_side = -floor_side if self._models[self._ids[label][0] - 1].on_floor else floor_side

    def place_again(self, label: str, draws: np.random.Generator) -> None:
        """Take all copies of a label away and find other places for them.

        Raises:
            ConfigError: there are none.
        """
        for thing_id in self._ids[label]:
            self.things.pop(thing_id, None)
        self._place_label(label, draws, float(draws.choice((-1.0, 1.0))))

    def elsewhere(self, thing: Thing, others: Sequence[Thing], draws: np.random.Generator, least_m: float) -> Thing | None:
        """Return a thing at a new place on a table at least ``least_m`` away, clear of all others; None if none was found."""
        model = self._models[thing.id - 1]
        for spot in self._spots(model, thing.id, self._areas(model, 0.0), draws):
            far = float(np.linalg.norm(((spot.low + spot.high) / 2.0 - thing.p_world)[:2])) >= least_m
            if far and (moved := self._settled(spot, others)) is not None:
                return moved
        return None

    def _difficulty(self, label: str) -> tuple[int, float]:
        model = self._models[self._ids[label][0] - 1]
        low, high = model.bounds
        first = 0 if model.kind == "fixed" else 1 if model.on_floor else 2
        return first, -float(np.prod((high - low)[:2])) * len(self._ids[label])

    def _place_label(self, label: str, draws: np.random.Generator, floor_side: float) -> None:
        ids = self._ids[label]
        for _ in range(_CLUSTERS):
            copies: list[Thing] = []
            for thing_id in ids:
                placed = self._place(thing_id, copies, draws, floor_side)
                if placed is None:
                    break
                copies.append(placed)
            if len(copies) == len(ids):
                self.things.update({thing.id: thing for thing in copies})
                return
        raise ConfigError(f"no free place for the {label} (thing {', '.join(map(str, ids))}) among {len(self.things)} things")

    def _place(self, thing_id: int, copies: list[Thing], draws: np.random.Generator, floor_side: float) -> Thing | None:
        model = self._models[thing_id - 1]
        if model.kind == "fixed":
            return self._on_wall(model, thing_id, draws)
        others = [*self.things.values(), *copies]
        spots = (
            self._beside(model, thing_id, copies, draws) if copies else self._spots(model, thing_id, self._areas(model, floor_side), draws)
        )
        return next((placed for spot in spots if (placed := self._settled(spot, others)) is not None), None)

    def _settled(self, spot: _Spot, others: Sequence[Thing]) -> Thing | None:
        """The thing let down at a spot: if it is clear of the others, stands, is seen from enough of the path, and hides no neighbour."""
        thing = self._rested(spot) if self._clear(spot, others) else None
        if thing is None or not self._is_seen(thing, others):
            return None
        for other in others:
            if gap_m(other, thing) < _HIDES_M:
                rest = [*(third for third in others if third is not other), thing]
                if not self._is_seen(other, rest):
                    return None
        return thing

    def _is_seen(self, thing: Thing, others: Sequence[Thing]) -> bool:
        least = _FLOOR_SEEN_SHARE if self._models[thing.id - 1].on_floor else _SEEN_SHARE
        return self._sightlines.share(thing, others) >= least

    def _spots(self, model: RoomModel, thing_id: int, areas: list[_Area], draws: np.random.Generator) -> Iterator[_Spot]:
        """Spots drawn from areas, the middle of the thing's box in them."""
        weights = np.array([area.weight for area in areas])
        for _ in range(_TURNS):
            turned = self._turned(model, thing_id, draws)
            for _ in range(_SPOTS):
                area = areas[int(draws.choice(len(areas), p=weights / weights.sum()))]
                yield _Spot.of(turned, draws.uniform(area.low, area.high))

    def _beside(self, model: RoomModel, thing_id: int, copies: list[Thing], draws: np.random.Generator) -> Iterator[_Spot]:
        """Spots beside a copy: mostly to its left or right, a few centimetres from box to box."""
        for _ in range(_TURNS):
            turned = self._turned(model, thing_id, draws)
            low, high = turned.bounds_world
            half = (high - low)[:2] / 2.0
            for _ in range(_SPOTS):
                other_low, other_high = copies[int(draws.integers(len(copies)))].bounds_world
                axis = 0 if draws.random() < (0.3 if model.on_floor else 0.75) else 1
                reach = (other_high - other_low)[:2] / 2.0 + half
                offset = np.empty(2)
                offset[axis] = float(draws.choice((-1.0, 1.0))) * (reach[axis] + draws.uniform(APART_M + 0.005, 0.9 * COPIES_M))
                offset[1 - axis] = 0.6 * draws.uniform(-1.0, 1.0) * reach[1 - axis]
                yield _Spot.of(turned, ((other_low + other_high) / 2.0)[:2] + offset)

    def _turned(self, model: RoomModel, thing_id: int, draws: np.random.Generator) -> Thing:
        return model.thing(thing_id, pose(omega=(0.0, 0.0, float(draws.uniform(-model.turn_rad, model.turn_rad)))))

    def _areas(self, model: RoomModel, floor_side: float) -> list[_Area]:
        row = self.structure.row
        if model.on_floor:
            areas = []
            for side in (-1.0, 1.0):
                end = row.high_m[0] if side > 0 else row.low_m[0]
                near, far = sorted((end + 0.1 * side, end + 1.1 * side))
                weight = 3.0 if side == floor_side else 1.0
                areas.append(_Area((near, row.low_m[1] - 0.1), (far, self.structure.size_m[1] - 0.2), weight))
            areas.append(_Area((row.low_m[0], row.low_m[1] - 0.5), (row.high_m[0], row.low_m[1] - 0.25), 0.5))
            return areas
        low, high = model.bounds
        tall = float((high - low)[2])
        band = (0.45, 1.0) if tall > _TALL_M else (0.0, 0.4) if tall < _FLAT_M else (0.0, 0.6) if tall < _LOW_M else (0.1, 0.85)
        areas = []
        for table in self.structure.tables:
            (x0, y0, _), (x1, y1, _) = table.bounds_world
            deep = y1 - y0
            areas.append(_Area((x0, y0 + band[0] * deep), (x1, y0 + band[1] * deep), (x1 - x0) * deep))
            if tall >= _FLAT_M:
                areas.append(_Area((x0, y0), (x1, y1), 0.3 * (x1 - x0) * deep))
        return areas

    def _clear(self, spot: _Spot, others: Sequence[Thing]) -> bool:
        """Whether it keeps its distance from all others, judged in the plane: no thing stands above another."""
        if not inside_room(spot.low, spot.high, self.structure.size_m, _WALL_M):
            return False
        inside, beside = self._at_tables(spot.low[:2] - _RIM_M, spot.high[:2] + _RIM_M)
        if self._models[spot.turned.id - 1].on_floor:
            if not beside or self._sightlines.clearance_m(spot.low, spot.high) < _PATH_M:
                return False
        elif not inside:
            return False
        if not others:
            return True
        lows, highs = (np.array([other.bounds_world[k][:2] for other in others if other.kind != "fixed"]).reshape(-1, 2) for k in (0, 1))
        return bool((box_gap_m(spot.low[:2], spot.high[:2], lows, highs) >= APART_M).all())

    def _at_tables(self, low: FloatArray, high: FloatArray) -> tuple[bool, bool]:
        """Whether a rectangle lies within the box of one table, and whether it is outside of all: a cheap guess before rays are cast."""
        lows, highs = self._tables[:, 0], self._tables[:, 1]
        inside = ((low >= lows) & (high <= highs)).all(axis=1).any()
        beside = ((low > highs) | (high < lows)).any(axis=1).all()
        return bool(inside), bool(beside)

    def _rested(self, spot: _Spot) -> Thing | None:
        """The thing let down on what is straight below it, if that is one level piece, and the right one."""
        footing = self._surfaces.below(spot.low[:2] - _RIM_M, spot.high[:2] + _RIM_M, self.structure.size_m[2] - 0.2)
        if footing is None:
            return None
        on_table = any(footing.owner is table for table in self.structure.tables)
        if on_table == self._models[spot.turned.id - 1].on_floor:
            return None
        return spot.turned.at(_shifted(spot.turned.T_world_thing, np.append(spot.shift_xy, footing.at_m - spot.low[2])))

    def _on_wall(self, model: RoomModel, thing_id: int, draws: np.random.Generator) -> Thing | None:
        """The outlet: flat on the wall behind the row, above the table tops."""
        row = self.structure.row
        low, high = model.bounds
        half = (high - low)[0] / 2.0
        for _ in range(_SPOTS):
            x = float(draws.uniform(row.low_m[0] + 0.2, row.high_m[0] - 0.2))
            z = row.top_m + float(draws.uniform(*_OUTLET_M))
            rectangle = np.array([x - half, z]), np.array([x + half, z + high[2]])
            footing = self._surfaces.behind(rectangle[0] - _RIM_M, rectangle[1] + _RIM_M, row.high_m[1] + 0.05)
            if footing is not None:
                return model.thing(thing_id, pose(x, footing.at_m - float(high[1]), z))
        return None


def _shifted(T_world_thing: FloatArray, shift: FloatArray) -> FloatArray:
    T = T_world_thing.copy()
    T[:3, 3] += shift
    return T
