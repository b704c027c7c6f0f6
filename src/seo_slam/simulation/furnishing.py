"""Puts furniture into the rooms of a floor plan: along walls, tables also in the open, without blocking a door or cutting off floor."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.catalogue import pose
from seo_slam.simulation.floor_plan import FloorPlan, Room
from seo_slam.simulation.free_space import CELL_M, ROBOT_RADIUS_M, FreeSpace
from seo_slam.simulation.home_models import Model
from seo_slam.simulation.placement import box_gap_m
from seo_slam.simulation.world import Thing

_TO_WALL_M = 0.015
_APART_M = 0.03
_DOOR_DEEP_M = 0.95  # no furniture this far before a door
_FRONT_M = 0.35  # one can stand this far before a piece of furniture
_WALKWAY_M = 0.31  # clearance of the ways that join doors and fronts: more than the tour keeps
_AROUND_M = 0.75  # around a table in the middle of a room
_TRIES = 40
_FACES_ROOM_RAD = (np.pi, 0.0, np.pi / 2, -np.pi / 2)  # turns of what stands at the south, north, west and east wall

FREE_STANDING = ("table", "coffee table")
BESIDE_TABLES = "chair"

MakeModel = Callable[[], Model]
"""Makes a piece of furniture when it is asked for; painting takes a while, and not all are used."""


@dataclass(frozen=True, slots=True)
class _Place:
    """A pose for a piece of furniture, and a point from which one uses it; None if any side will do."""

    T_world_thing: FloatArray
    front: FloatArray | None


class Arrangement:
    """The furniture placed so far on a floor plan. Free floor stays in one part, ways between doors stay wide."""

    def __init__(self, plan: FloorPlan) -> None:
        """Begin with empty rooms."""
        self._plan = plan
        x = [value for room in plan.rooms for value in room.x]
        y = [value for room in plan.rooms for value in room.y]
        self._corner = np.array([min(x), min(y)])
        shape = np.ceil((np.array([max(y), max(x)]) - self._corner[::-1]) / CELL_M - 1e-6).astype(np.int64)
        self._occupied = np.ones(tuple(shape), dtype=np.bool_)
        for room in plan.rooms:
            self._occupied[self._cells_inside(room.inside)] = False
        for door in plan.doors:
            self._occupied[self._cells_inside(door.zone(2.5 * CELL_M))] = False
        self._zones = np.array([door.zone(_DOOR_DEEP_M) for door in plan.doors]).reshape(-1, 2, 2)
        self._fronts: list[FloatArray] = [np.array(door.middle) for door in plan.doors]
        self.things: list[Thing] = []

    def add(self, model: Model, room: Room, draws: np.random.Generator) -> bool:
        """Find a place for a piece of furniture in a room; return whether there was one."""
        thing = model.thing(len(self.things) + 1, np.eye(4))
        for place in self._places(thing, room, draws):
            placed = thing.at(place.T_world_thing)
            if self._clear(placed, room) and self._still_open(placed, place.front):
                self._occupied[self._cells_touched(placed)] = True
                if place.front is not None:
                    self._fronts.append(place.front)
                self.things.append(placed)
                return True
        return False

    def _places(self, thing: Thing, room: Room, draws: np.random.Generator) -> Iterator[_Place]:
        if thing.label == BESIDE_TABLES:
            yield from self._beside_tables(thing, room, draws)
        if thing.label in FREE_STANDING:
            yield from self._in_the_open(thing, room, draws)
        yield from self._along_walls(thing, room, draws)

    def _along_walls(self, thing: Thing, room: Room, draws: np.random.Generator) -> Iterator[_Place]:
        x0, y0, x1, y1 = room.inside
        for _ in range(_TRIES):
            side, share = int(draws.integers(4)), float(draws.random())
            low, high = thing.at(pose(omega=(0.0, 0.0, _FACES_ROOM_RAD[side]))).bounds_world
            spare = np.array([x1 - x0, y1 - y0]) - (high - low)[:2] - 2 * _TO_WALL_M
            if (spare < 0).any():
                continue
            corner = np.array([x0, y0]) + _TO_WALL_M
            along = 0 if side < 2 else 1
            corner[along] += share * spare[along]
            if side in (1, 3):
                corner[1 - along] += spare[1 - along]
            xy = corner - low[:2]
            middle = xy + (low + high)[:2] / 2.0
            inwards = np.array([(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)][side])
            front = middle + inwards * ((high - low)[1 - along] / 2.0 + _FRONT_M)
            yield _Place(pose(float(xy[0]), float(xy[1]), 0.0, (0.0, 0.0, _FACES_ROOM_RAD[side])), front)

    def _in_the_open(self, thing: Thing, room: Room, draws: np.random.Generator) -> Iterator[_Place]:
        x0, y0, x1, y1 = room.inside
        for _ in range(_TRIES):
            turn = float(draws.choice(_FACES_ROOM_RAD[1:3]))
            low, high = thing.at(pose(omega=(0.0, 0.0, turn))).bounds_world
            free_low, free_high = np.array([x0, y0]) + _AROUND_M - low[:2], np.array([x1, y1]) - _AROUND_M - high[:2]
            share = draws.random(2)
            if (free_low > free_high).any():
                continue
            xy = free_low + share * (free_high - free_low)
            placed = thing.at(pose(float(xy[0]), float(xy[1]), 0.0, (0.0, 0.0, turn)))
            if self._gap_to_others(placed) >= _AROUND_M:
                yield _Place(placed.T_world_thing, None)

    def _beside_tables(self, thing: Thing, room: Room, draws: np.random.Generator) -> Iterator[_Place]:
        """At a side of a table, its front towards it."""
        x0, y0, x1, y1 = room.inside
        tables = [t for t in self.things if t.label == "table" and x0 < t.p_world[0] < x1 and y0 < t.p_world[1] < y1]
        for _ in range(_TRIES if tables else 0):
            table = tables[int(draws.integers(len(tables)))]
            side, share = int(draws.integers(4)), float(draws.uniform(-0.6, 0.6))
            low, high = table.bounds_world
            turn = (0.0, np.pi, -np.pi / 2, np.pi / 2)[side]  # it stands to the north, south, west or east of the table
            own_low, own_high = thing.at(pose(omega=(0.0, 0.0, turn))).bounds_world
            towards = np.array([(0.0, 1.0), (0.0, -1.0), (-1.0, 0.0), (1.0, 0.0)][side])
            reach = (high - low)[:2] / 2.0 + (own_high - own_low)[:2] / 2.0
            xy = table.p_world[:2] + towards * (reach + 0.04) + towards[::-1] * share * (high - low)[:2] / 2.0
            xy = xy - (own_low + own_high)[:2] / 2.0
            yield _Place(pose(float(xy[0]), float(xy[1]), 0.0, (0.0, 0.0, turn)), None)

    def _clear(self, thing: Thing, room: Room) -> bool:
        low, high = (corner[:2] for corner in thing.bounds_world)
        x0, y0, x1, y1 = room.inside
        inside = bool((low >= (x0 + 0.005, y0 + 0.005)).all() and (high <= (x1 - 0.005, y1 - 0.005)).all())
        at_door = len(self._zones) > 0 and bool((box_gap_m(low, high, self._zones[:, 0], self._zones[:, 1]) < 1e-9).any())
        return inside and not at_door and self._gap_to_others(thing) >= _APART_M

    def _gap_to_others(self, thing: Thing) -> float:
        if not self.things:
            return float("inf")
        bounds = np.array([other.bounds_world for other in self.things])[:, :, :2]
        low, high = thing.bounds_world
        return float(box_gap_m(low[:2], high[:2], bounds[:, 0], bounds[:, 1]).min())

    def _still_open(self, thing: Thing, front: FloatArray | None) -> bool:
        """Whether the floor stays in one part and wide ways join all doors and the fronts of all furniture."""
        occupied = self._occupied.copy()
        occupied[self._cells_touched(thing)] = True
        free = FreeSpace(occupied, self._corner)
        if free.connected_share(ROBOT_RADIUS_M) < 1.0:
            return False
        wide = free.main_part(_WALKWAY_M)
        fronts = [*self._fronts, *([] if front is None else [front])]
        return not fronts or bool(wide[tuple(free.cells(np.array(fronts)).T)].all())

    def _cells_inside(self, rectangle: tuple[float, float, float, float]) -> tuple[slice, slice]:
        """Cells that lie wholly in a rectangle."""
        low, high = (np.array(rectangle).reshape(2, 2) - self._corner) / CELL_M
        first, last = np.ceil(low - 1e-6).astype(int), np.floor(high + 1e-6).astype(int)
        return slice(max(int(first[1]), 0), int(last[1])), slice(max(int(first[0]), 0), int(last[0]))

    def _cells_touched(self, thing: Thing) -> tuple[slice, slice]:
        low, high = ((corner[:2] - self._corner) / CELL_M for corner in thing.bounds_world)
        first, last = np.floor(low).astype(int), np.ceil(high).astype(int)
        return slice(int(first[1]), int(last[1])), slice(int(first[0]), int(last[0]))


def furnish(
    plan: FloorPlan,
    wanted: int,
    needed: Mapping[str, Sequence[MakeModel]],
    optional: Mapping[str, Sequence[MakeModel]],
    draws: np.random.Generator,
) -> list[Thing]:
    """Return ``wanted`` pieces of furniture in their places.

    Args:
        plan: the rooms.
        wanted: how many pieces.
        needed: room name -> what must be in it.
        optional: room name -> what may be added, in this order, room by room.
        draws: of the places.

    Raises:
        ConfigError: something that must be there, or the last of the optional ones, found no place; the message names it.
    """
    arrangement = Arrangement(plan)
    for room in plan.rooms:
        for model in sorted((make() for make in needed[room.name]), key=_footprint_m2, reverse=True):
            if not arrangement.add(model, room, draws):
                raise ConfigError(f"apartment: no free place for the {model.label} in the {room.name}")
    left = {room: list(optional[room.name]) for room in plan.rooms}
    last = "furniture"
    while len(arrangement.things) < wanted:
        waiting = [room for room in plan.rooms if left[room]]
        if not waiting:
            raise ConfigError(f"apartment: no free place for the {last}: {len(arrangement.things)} of {wanted} pieces of furniture placed")
        for room in waiting[: wanted - len(arrangement.things)]:
            model = left[room].pop(0)()
            if not arrangement.add(model, room, draws):
                last = f"{model.label} in the {room.name}"
    return arrangement.things


def _footprint_m2(model: Model) -> float:
    low, high = model.thing(1, np.eye(4)).bounds_thing
    return float(np.prod((high - low)[:2]))
