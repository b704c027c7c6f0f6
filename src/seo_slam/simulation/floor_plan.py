"""Seeded floor plans: a rectangle cut into rooms, with doors between them, and the walls, floor and ceiling built from it.

World frame: the low corner of the plan is (2, 1) m, so that nothing lies at the origin; z up, the floor at 0.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from seo_slam.simulation import textures
from seo_slam.simulation.catalogue import pose
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.textures import Rgb, Texture
from seo_slam.simulation.world import STRUCTURE_ID, Part, Thing

WALL_HEIGHT_M = 2.5
DOOR_HEIGHT_M = 2.05
HALF_WALL_M = 0.06
CORNER_M = (2.0, 1.0)

_LEAST_SIDE_M = 3.0
_DOOR_WIDTHS_M = (0.9, 1.1)
_DOOR_FROM_CORNER_M = 0.25
_EXTRA_DOOR = 0.5  # chance that two neighbours that are joined by another way get a door as well

_WALLS: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.84, 0.80, 0.70), (0.66, 0.70, 0.62)),
    ((0.72, 0.79, 0.84), (0.55, 0.62, 0.72)),
    ((0.80, 0.84, 0.74), (0.62, 0.72, 0.55)),
    ((0.86, 0.76, 0.72), (0.72, 0.58, 0.55)),
    ((0.82, 0.81, 0.86), (0.64, 0.62, 0.74)),
)
_BOARDS: tuple[Rgb, ...] = ((0.55, 0.40, 0.27), (0.45, 0.36, 0.28), (0.62, 0.50, 0.36), (0.50, 0.42, 0.36), (0.58, 0.44, 0.32))


@dataclass(frozen=True, slots=True)
class Room:
    """A rectangle of the plan, to the middle of its walls.

    Attributes:
        name: what it is used for.
        x, y: least and largest coordinate, world frame, metres.
    """

    name: str
    x: tuple[float, float]
    y: tuple[float, float]

    @property
    def area_m2(self) -> float:
        """Size to the middle of the walls."""
        return (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])

    @property
    def inside(self) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 between the faces of the walls."""
        h = HALF_WALL_M
        return self.x[0] + h, self.y[0] + h, self.x[1] - h, self.y[1] - h


@dataclass(frozen=True, slots=True)
class Door:
    """An opening in a wall: ``axis`` 0 if the wall runs along y (at x = ``at``), 1 if along x; from ``low`` to ``high`` along it."""

    axis: int
    at: float
    low: float
    high: float

    @property
    def middle(self) -> tuple[float, float]:
        """(x, y) of the opening."""
        along = (self.low + self.high) / 2.0
        return (self.at, along) if self.axis == 0 else (along, self.at)

    def zone(self, deep_m: float) -> tuple[float, float, float, float]:
        """x0, y0, x1, y1 of the opening with a strip ``deep_m`` on either side of it."""
        if self.axis == 0:
            return self.at - deep_m, self.low, self.at + deep_m, self.high
        return self.low, self.at - deep_m, self.high, self.at + deep_m


@dataclass(frozen=True, slots=True)
class FloorPlan:
    """Rooms and the doors between them; every room can be reached from every other."""

    rooms: tuple[Room, ...]
    doors: tuple[Door, ...]


def draw_floor_plan(seed: int, layout: int, room_names: tuple[str, ...], size_m: tuple[float, float]) -> FloorPlan:
    """Return a plan of as many rooms as names; the first name goes to the largest room.

    Args:
        seed: key of the draws.
        layout: another one.
        room_names: what the rooms are used for.
        size_m: of the whole, x and y.
    """
    draws = generator(seed, "floor plan", layout)
    (x0, y0), (wide, deep) = CORNER_M, size_m
    rooms = [Room("", (x0, x0 + wide), (y0, y0 + deep))]
    while len(rooms) < len(room_names):
        rooms.sort(key=lambda room: -room.area_m2)
        rooms[:1] = _cut(rooms[0], draws)
    rooms.sort(key=lambda room: -room.area_m2)
    named = tuple(Room(name, room.x, room.y) for name, room in zip(room_names, rooms, strict=True))
    return FloorPlan(named, tuple(_doors(named, draws)))


def _cut(room: Room, draws: np.random.Generator) -> list[Room]:
    """Cut a room across its longer side, not far from the middle."""
    axis = 0 if room.x[1] - room.x[0] >= room.y[1] - room.y[0] else 1
    low, high = (room.x, room.y)[axis]
    margin = min(_LEAST_SIDE_M, (high - low) / 2.0)
    share = float(draws.uniform(0.4, 0.6))
    at = round(min(max(low + share * (high - low), low + margin), high - margin), 2)
    if axis == 0:
        return [Room("", (low, at), room.y), Room("", (at, high), room.y)]
    return [Room("", room.x, (low, at)), Room("", room.x, (at, high))]


def _doors(rooms: tuple[Room, ...], draws: np.random.Generator) -> Iterator[Door]:
    """A door wherever it joins rooms that were apart, and now and then one more."""
    group = list(range(len(rooms)))
    shared = [(i, j, wall) for i in range(len(rooms)) for j in range(i) if (wall := _shared_wall(rooms[i], rooms[j])) is not None]
    for k in draws.permutation(len(shared)):
        i, j, (axis, at, low, high) = shared[k]
        extra, width, share = float(draws.random()), float(draws.uniform(*_DOOR_WIDTHS_M)), float(draws.random())
        if group[i] == group[j] and extra >= _EXTRA_DOOR:
            continue
        group = [group[j] if g == group[i] else g for g in group]
        start = round(low + _DOOR_FROM_CORNER_M + share * (high - low - width - 2 * _DOOR_FROM_CORNER_M), 2)
        yield Door(axis, at, start, round(start + width, 2))


def _shared_wall(a: Room, b: Room) -> tuple[int, float, float, float] | None:
    """Axis, place and stretch of the wall between two rooms, if it is wide enough for a door."""
    for axis in (0, 1):
        across_a, across_b = ((a.x, b.x), (a.y, b.y))[axis]
        along_a, along_b = ((a.y, b.y), (a.x, b.x))[axis]
        for at in set(across_a) & set(across_b):
            low, high = max(along_a[0], along_b[0]), min(along_a[1], along_b[1])
            if high - low > _DOOR_WIDTHS_M[1] + 2 * _DOOR_FROM_CORNER_M:
                return axis, at, low, high
    return None


def build_structure(plan: FloorPlan, seed: int) -> tuple[Thing, ...]:
    """Return walls, floor and ceiling.

    Every room lines its own side of a wall, so that a wall may have another paper on either side.
    """
    walls: list[Part] = []
    floor: list[Part] = []
    for k, room in enumerate(plan.rooms):
        paper = textures.wallpaper((seed, "paper", k), *_WALLS[k % len(_WALLS)])
        boards = textures.planks((seed, "boards", k), _BOARDS[k % len(_BOARDS)])
        walls.extend(_lining(room, plan.doors, paper))
        floor.append(_slab(room.x, room.y, (-0.04, 0.0), boards))
    x = (min(room.x[0] for room in plan.rooms), max(room.x[1] for room in plan.rooms))
    y = (min(room.y[0] for room in plan.rooms), max(room.y[1] for room in plan.rooms))
    plaster = textures.mottled((seed, "ceiling"), (0.93, 0.93, 0.9), 0.06, 0.6)
    ceiling = _slab(x, y, (WALL_HEIGHT_M, WALL_HEIGHT_M + 0.04), plaster)
    named = (("walls", walls), ("floor", floor), ("ceiling", [ceiling]))
    return tuple(Thing(STRUCTURE_ID, name, tuple(parts), np.eye(4), kind="fixed") for name, parts in named)


def _lining(room: Room, doors: tuple[Door, ...], paper: Texture) -> Iterator[Part]:
    """The four walls of a room, open where a door is, with a lintel above it."""
    for axis, at, along in ((0, room.x[0], room.y), (0, room.x[1], room.y), (1, room.y[0], room.x), (1, room.y[1], room.x)):
        inwards = HALF_WALL_M if at == (room.x[0], room.y[0])[axis] else -HALF_WALL_M
        across = (min(at, at + inwards), max(at, at + inwards))
        own = sorted(
            (door.low, door.high)
            for door in doors
            if door.axis == axis and door.at == at and along[0] <= door.low and door.high <= along[1]
        )
        start = along[0]
        for low, high in own:
            yield _wall(axis, across, (start, low), (0.0, WALL_HEIGHT_M), paper)
            yield _wall(axis, across, (low, high), (DOOR_HEIGHT_M, WALL_HEIGHT_M), paper)
            start = high
        yield _wall(axis, across, (start, along[1]), (0.0, WALL_HEIGHT_M), paper)


def _wall(axis: int, across: tuple[float, float], along: tuple[float, float], z: tuple[float, float], paper: Texture) -> Part:
    return _slab(across, along, z, paper) if axis == 0 else _slab(along, across, z, paper)


def _slab(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], paint: Texture) -> Part:
    low, high = np.array([x[0], y[0], z[0]]), np.array([x[1], y[1], z[1]])
    size, middle = high - low, (low + high) / 2.0
    return Part(Box((float(size[0]), float(size[1]), float(size[2]))), paint, pose(float(middle[0]), float(middle[1]), float(middle[2])))
