"""Walls, floor and a row of tables. World: the room's corner is the origin, z up; the row stands before the wall at high y."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation import catalogue, textures
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box, RoomBox
from seo_slam.simulation.room_models import RoomModel
from seo_slam.simulation.room_path import TableRow
from seo_slam.simulation.textures import Rgb
from seo_slam.simulation.world import STRUCTURE_ID, Light, Part, Thing, World

CEILING_M = 2.6
SHELL = ("room", "floor")
"""Labels of the structure that is no furniture."""
_FLOOR_BESIDE_M = 2.4  # between the ends of the row and the walls: chairs, and the ends of the walk
_BEFORE_M = 2.9  # between the front of the row and the wall behind the camera
_WALLS: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.80, 0.79, 0.72), (0.62, 0.68, 0.66)),
    ((0.74, 0.79, 0.81), (0.58, 0.64, 0.72)),
    ((0.82, 0.76, 0.70), (0.70, 0.58, 0.50)),
)


@dataclass(frozen=True, eq=False)
class RoomStructure:
    """An empty room.

    Attributes:
        world: structure only.
        tables: those of the structure.
        row: the space that they take.
        size_m: of the room.
    """

    world: World
    tables: tuple[Thing, ...]
    row: TableRow
    size_m: tuple[float, float, float]


def build_structure(tables: Sequence[RoomModel], seed: int, room: str, layout: int) -> RoomStructure:
    """Set up tables side by side, each a little off and turned, and a room around them."""
    draws = generator(seed, room, "structure", layout)
    behind_m = float(draws.uniform(0.25, 0.5))
    deepest = max(float((model.bounds[1] - model.bounds[0])[1]) for model in tables)
    depth_m = _BEFORE_M + deepest + 0.15 + behind_m
    middle_y = depth_m - behind_m - deepest / 2.0 - 0.05
    placed: list[Thing] = []
    x = _FLOOR_BESIDE_M
    for model in tables:
        turned = catalogue.pose(omega=(0.0, 0.0, float(draws.uniform(-0.04, 0.04))))
        low, high = model.thing(STRUCTURE_ID, turned).bounds_world
        T = turned.copy()
        T[:3, 3] = (x - low[0], middle_y + float(draws.uniform(-0.04, 0.04)), 0.0)
        placed.append(model.thing(STRUCTURE_ID, T))
        x += float(high[0] - low[0]) + float(draws.uniform(0.04, 0.14))
    corners = [table.bounds_world for table in placed]
    low = np.min([low for low, _ in corners], axis=0)
    high = np.max([high for _, high in corners], axis=0)
    row = TableRow((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), float(high[2]))
    size_m = (float(high[0]) + _FLOOR_BESIDE_M, depth_m, CEILING_M)
    light = np.array([-0.45, -0.55, 1.0])
    world = World(
        things=(),
        structure=(*_shell(seed, room, size_m), *placed),
        light=Light(light / np.linalg.norm(light)),
        gaze_world=np.array([row.middle_x_m, middle_y, row.top_m]),
    )
    return RoomStructure(world, tuple(placed), row, size_m)


def with_tables_as_things(world: World) -> World:
    """Return a room in which the tables have ids, above those of all other things, and can be found."""
    first = 1000 + max((thing.id for thing in world.things), default=0)  # things that come later have ids below
    tables = [thing for thing in world.structure if thing.label not in SHELL]
    named = [replace(table, id=first + n, kind="anchor") for n, table in enumerate(tables)]
    return replace(world, things=(*world.things, *named), structure=tuple(t for t in world.structure if t.label in SHELL))


def _shell(seed: int, room: str, size_m: tuple[float, float, float]) -> tuple[Thing, ...]:
    x, y, z = size_m
    paper = _WALLS[int(generator(seed, room, "walls").integers(len(_WALLS)))]
    wall = textures.wallpaper((seed, room, "wall"), *paper)
    boards = textures.planks((seed, room, "floor"), (0.55, 0.40, 0.27))
    return (
        Thing(STRUCTURE_ID, "room", (Part(RoomBox(size_m), wall, catalogue.pose()),), catalogue.pose(x / 2, y / 2, z / 2 - 0.05)),
        Thing(STRUCTURE_ID, "floor", (Part(Box((x, y, 0.02)), boards, catalogue.pose()),), catalogue.pose(x / 2, y / 2, -0.01)),
    )


def inside_room(low: FloatArray, high: FloatArray, size_m: tuple[float, float, float], margin_m: float) -> bool:
    """Whether a box stays this far from all walls."""
    return bool((low[:2] >= margin_m).all() and (high[:2] <= np.array(size_m[:2]) - margin_m).all() and high[2] <= size_m[2] - margin_m)
