"""A seeded desk in a room: fifteen things on a table top, none inside another.

World: the room's corner is the origin, z up; the desk stands before the wall at high y and its top is at 0.75 m.
"""

from dataclasses import dataclass

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation import catalogue, textures
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box, RoomBox
from seo_slam.simulation.textures import Rgb
from seo_slam.simulation.world import STRUCTURE_ID, Light, Part, Thing, World

DESK_HEIGHT_M = 0.75
DESK_SIZE_M = (1.7, 0.85)
DESK_CENTRE_M = (2.1, 2.75)
ROOM_SIZE_M = (4.2, 3.4, 2.6)

_EDGE_M = 0.03  # things stay this far from the rim of the desk
_GAP_M = 0.025  # and from each other
_TRIES = 200
_LAYOUTS = 30

_COLOURS: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.70, 0.16, 0.14), (0.95, 0.90, 0.75)),
    ((0.13, 0.34, 0.58), (0.95, 0.93, 0.88)),
    ((0.16, 0.45, 0.30), (0.96, 0.85, 0.40)),
    ((0.85, 0.62, 0.18), (0.25, 0.18, 0.12)),
    ((0.42, 0.24, 0.48), (0.93, 0.86, 0.90)),
    ((0.10, 0.48, 0.52), (0.95, 0.90, 0.80)),
    ((0.90, 0.90, 0.87), (0.20, 0.32, 0.60)),
    ((0.88, 0.48, 0.22), (0.98, 0.94, 0.86)),
)


@dataclass(frozen=True, slots=True)
class _Wish:
    """Where a thing wants to be: a rectangle on the desk (shares of it, x then y from the front) and how far it may turn."""

    label: str
    accepted: tuple[str, ...]
    parts: tuple[Part, ...]
    x: tuple[float, float] = (0.0, 1.0)
    y: tuple[float, float] = (0.0, 1.0)
    turn_rad: float = np.pi


def build_desk(seed: int = 0) -> World:
    """Return the desk of a seed.

    Raises:
        ConfigError: a thing found no place; the message names it.
    """
    wishes = _wishes(seed)
    for layout in range(_LAYOUTS):
        try:
            placed = _place_all(wishes, generator(seed, "desk", "places", layout))
            break
        except ConfigError:  # a crowded corner: begin again with other draws
            if layout == _LAYOUTS - 1:
                raise
    light = np.array([-0.45, -0.55, 1.0])
    x, y = DESK_CENTRE_M
    return World(
        things=placed,
        structure=_structure(seed),
        light=Light(light / np.linalg.norm(light)),
        gaze_world=np.array([x, y, DESK_HEIGHT_M + 0.08]),
    )


def _wishes(seed: int) -> list[_Wish]:
    """The inventory, the large first, since they are the hardest to place. Cups come as a pair, side by side."""
    colours = [_COLOURS[int(k)] for k in generator(seed, "desk", "colours").permutation(len(_COLOURS))]
    mirrored = bool(generator(seed, "desk", "mirror").integers(2))

    def key(name: str) -> catalogue.Key:
        return (seed, "desk", name)

    def side(low: float, high: float) -> tuple[float, float]:
        return (1.0 - high, 1.0 - low) if mirrored else (low, high)

    return [
        _Wish("monitor", ("screen", "television", "tv"), catalogue.monitor(key("monitor")), side(0.36, 0.56), (0.62, 0.85), 0.15),
        _Wish("keyboard", ("computer keyboard",), catalogue.keyboard(key("keyboard")), side(0.36, 0.54), (0.2, 0.36), 0.12),
        _Wish("mouse", ("computer mouse",), catalogue.mouse(key("mouse")), side(0.62, 0.7), (0.18, 0.36), 0.35),
        _Wish("lamp", ("desk lamp", "table lamp"), catalogue.lamp(key("lamp"), colours[7][0]), side(0.0, 0.25), (0.6, 1.0)),
        _Wish(
            "book",
            ("notebook",),
            catalogue.book(key("book 1"), colours[0][0], colours[0][1], (0.17, 0.24, 0.035)),
            side(0.0, 0.3),
            (0.0, 0.6),
            0.6,
        ),
        _Wish(
            "book",
            ("notebook",),
            catalogue.book(key("book 2"), colours[1][0], colours[1][1], (0.15, 0.21, 0.028)),
            side(0.6, 1.0),
            (0.0, 0.6),
            0.6,
        ),
        _Wish(
            "book",
            ("notebook",),
            catalogue.standing_book(key("book 3"), colours[2][0], colours[2][1], (0.16, 0.04, 0.23)),
            side(0.7, 1.0),
            (0.6, 1.0),
            0.3,
        ),
        _Wish("football", ("ball", "soccer ball"), catalogue.football(key("football")), side(0.6, 1.0), (0.4, 1.0)),
        _Wish("bowl", ("dish",), catalogue.bowl(key("bowl"), colours[5][0], colours[5][1]), side(0.0, 0.45), (0.0, 0.6)),
        _Wish("flower", ("plant", "potted plant"), catalogue.flower(key("flower"), (0.9, 0.35, 0.55)), (0.0, 1.0), (0.55, 1.0)),
        _Wish("box", ("carton",), catalogue.box(key("box"), colours[3][0], colours[3][1], (0.15, 0.1, 0.19)), (0.0, 1.0), (0.55, 1.0), 0.5),
        _Wish("cup", ("mug", "teacup"), catalogue.cup(key("cup 1"), colours[6][0], colours[6][1]), (0.55, 1.0), (0.0, 0.6)),
        _Wish("cup", ("mug", "teacup"), catalogue.cup(key("cup 2"), colours[4][0], colours[4][1]), (0.0, 1.0), (0.0, 1.0)),
        _Wish("bottle", ("flask",), catalogue.bottle(key("bottle"), (0.2, 0.42, 0.3), (0.92, 0.88, 0.7)), (0.0, 1.0), (0.4, 1.0)),
        _Wish("apple", ("fruit",), catalogue.apple(key("apple")), (0.0, 1.0), (0.0, 0.6)),
    ]


def _place_all(wishes: list[_Wish], draws: np.random.Generator) -> tuple[Thing, ...]:
    corner = np.array(DESK_CENTRE_M) - np.array(DESK_SIZE_M) / 2.0
    placed: list[Thing] = []
    for wish in wishes:
        placed.append(_place(wish, len(placed) + 1, placed, corner, draws))
    return tuple(placed)


def _place(wish: _Wish, thing_id: int, placed: list[Thing], corner: FloatArray, draws: np.random.Generator) -> Thing:
    partner = placed[-1] if wish.label == "cup" and placed and placed[-1].label == "cup" else None
    size = np.array(DESK_SIZE_M)
    for _ in range(_TRIES):
        turn = float(draws.uniform(-wish.turn_rad, wish.turn_rad))
        if partner is not None:  # 9 to 14 cm from middle to middle
            angle, apart = float(draws.uniform(-np.pi, np.pi)), float(draws.uniform(0.1, 0.15))
            xy = partner.T_world_thing[:2, 3] + apart * np.array([np.cos(angle), np.sin(angle)])
        else:
            xy = corner + size * np.array([draws.uniform(*wish.x), draws.uniform(*wish.y)])
        T = catalogue.pose(float(xy[0]), float(xy[1]), DESK_HEIGHT_M, (0.0, 0.0, turn))
        thing = Thing(thing_id, wish.label, wish.parts, T, wish.accepted)
        low, high = thing.bounds_world
        inside = (low[:2] >= corner + _EDGE_M).all() and (high[:2] <= corner + size - _EDGE_M).all()
        if inside and not any(footprints_overlap(thing, other, _GAP_M) for other in placed):
            return thing
    raise ConfigError(f"desk: no free place for the {wish.label} (thing {thing_id}) after {_TRIES} tries in {_LAYOUTS} layouts")


def footprints_overlap(a: Thing, b: Thing, gap_m: float = 0.0) -> bool:
    """Whether the rectangles that two upright things stand on come closer than ``gap_m`` (separating axes)."""
    corners = [thing.corners_world()[:, :2] for thing in (a, b)]
    for thing in (a, b):
        for axis in thing.T_world_thing[:2, :2].T:
            first, second = (c @ axis for c in corners)
            if first.max() + gap_m <= second.min() or second.max() + gap_m <= first.min():
                return False
    return True


def _structure(seed: int) -> tuple[Thing, ...]:
    """Room, floor and desk."""
    x, y = DESK_CENTRE_M
    wide, deep = DESK_SIZE_M
    room_x, room_y, room_z = ROOM_SIZE_M
    wall = textures.wallpaper((seed, "wall"), (0.80, 0.79, 0.72), (0.62, 0.68, 0.66))
    boards = textures.planks((seed, "floor"), (0.55, 0.40, 0.27))
    top = textures.wood((seed, "desk top"), (0.72, 0.54, 0.36))
    leg = textures.mottled((seed, "leg"), (0.35, 0.36, 0.38), 0.15, 0.2)
    thick = 0.035
    legs = tuple(
        Part(
            Box((0.05, 0.05, DESK_HEIGHT_M - thick)),
            leg,
            catalogue.pose(sx * (wide / 2 - 0.06), sy * (deep / 2 - 0.06), (DESK_HEIGHT_M - thick) / 2),
        )
        for sx in (-1, 1)
        for sy in (-1, 1)
    )
    desk = (Part(Box((wide, deep, thick)), top, catalogue.pose(z=DESK_HEIGHT_M - thick / 2)), *legs)
    return (
        Thing(
            STRUCTURE_ID,
            "room",
            (Part(RoomBox(ROOM_SIZE_M), wall, catalogue.pose()),),
            catalogue.pose(room_x / 2, room_y / 2, room_z / 2 - 0.05),
        ),
        Thing(
            STRUCTURE_ID,
            "floor",
            (Part(Box((room_x, room_y, 0.02)), boards, catalogue.pose()),),
            catalogue.pose(room_x / 2, room_y / 2, -0.01),
        ),
        Thing(STRUCTURE_ID, "desk", desk, catalogue.pose(x, y)),
    )
