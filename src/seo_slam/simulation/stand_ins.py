"""Stand-ins for the things of a room where no mesh is given: primitive shapes of like size, coloured by their key.

Each function returns the parts of one thing, base at z = 0, middle at x = y = 0, its front to -y; metres. What the desk has too comes
from ``catalogue``; larger things stand in ``stand_in_furniture``.
"""

from collections.abc import Callable

import numpy as np

from seo_slam.simulation import catalogue, textures
from seo_slam.simulation.catalogue import DARK, METAL, PAPER, WHITE, Key, pose
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box, Ellipsoid, Frustum, Torus, cylinder
from seo_slam.simulation.stand_in_furniture import bin_, chair, fan
from seo_slam.simulation.textures import Rgb
from seo_slam.simulation.world import Part

PALETTE: tuple[tuple[Rgb, Rgb], ...] = (
    ((0.70, 0.16, 0.14), (0.95, 0.90, 0.75)),
    ((0.13, 0.34, 0.58), (0.95, 0.93, 0.88)),
    ((0.16, 0.45, 0.30), (0.96, 0.85, 0.40)),
    ((0.85, 0.62, 0.18), (0.25, 0.18, 0.12)),
    ((0.42, 0.24, 0.48), (0.93, 0.86, 0.90)),
    ((0.10, 0.48, 0.52), (0.95, 0.90, 0.80)),
    ((0.80, 0.80, 0.77), (0.20, 0.32, 0.60)),
    ((0.88, 0.48, 0.22), (0.98, 0.94, 0.86)),
)
"""Ground and ink of painted things."""


def colours(key: Key) -> tuple[Rgb, Rgb]:
    """Return the ground and the ink that a key draws."""
    return PALETTE[int(generator(*key, "colours").integers(len(PALETTE)))]


def _scale(key: Key, spread: float = 0.08) -> float:
    return float(generator(*key, "size").uniform(1.0 - spread, 1.0 + spread))


def bag(key: Key) -> tuple[Part, ...]:
    """A backpack: body, front pocket, straps and a loop to carry it by."""
    base, ink = colours(key)
    s = _scale(key)
    x, y, z = 0.29 * s, 0.15 * s, 0.38 * s
    cloth = textures.cover(key, base, ink, (x, z))
    dark = textures.mottled((*key, "dark"), DARK, 0.2, 0.1)
    return (
        Part(Box((x, y, 0.82 * z)), cloth, pose(z=0.41 * z)),
        Part(Ellipsoid((x / 2, y / 2, 0.18 * z), flat_bottom=True), textures.mottled((*key, "top"), base, 0.15, 0.1), pose(z=0.82 * z)),
        Part(Box((0.7 * x, 0.05, 0.36 * z)), textures.mottled((*key, "pocket"), ink, 0.12, 0.1), pose(y=-y / 2 - 0.025, z=0.24 * z)),
        Part(Box((0.045, 0.02, 0.75 * z)), dark, pose(x=-0.3 * x, y=y / 2 + 0.01, z=0.42 * z)),
        Part(Box((0.045, 0.02, 0.75 * z)), dark, pose(x=0.3 * x, y=y / 2 + 0.01, z=0.42 * z)),
        Part(Torus(0.03, 0.006), dark, pose(y=0.02, z=1.01 * z, omega=(np.pi / 2, 0.0, 0.0))),
    )


def banana(key: Key) -> tuple[Part, ...]:
    """A bent fruit that lies on its side."""
    s = _scale(key)
    skin = textures.mottled(key, (0.93, 0.78, 0.16), 0.14, 0.06)
    tip = textures.mottled((*key, "tip"), (0.30, 0.22, 0.10), 0.15, 0.03)
    radius, thick = 0.105 * s, 0.018 * s
    parts = []
    for turn in np.linspace(-0.85, 0.85, 6):
        half = thick * (1.0 - 0.35 * abs(turn))
        x, y = radius * np.sin(turn), radius * (np.cos(turn) - 0.83)
        parts.append(Part(Ellipsoid((0.026 * s, half, half)), skin, pose(x, y, thick, (0.0, 0.0, -float(turn)))))
    for turn in (-1.08, 1.06):
        x, y = radius * np.sin(turn), radius * (np.cos(turn) - 0.83)
        parts.append(Part(Ellipsoid((0.012, 0.007, 0.007)), tip, pose(x, y, thick, (0.0, 0.0, -turn))))
    return tuple(parts)


def helmet(key: Key) -> tuple[Part, ...]:
    """A motorcycle helmet: shell, collar and visor."""
    base, ink = colours(key)
    s = _scale(key, 0.05)
    shell = textures.bands(key, base, ink, 0.27 * s, ((0.12, 0.2), (0.55, 0.62)), blots=4)
    return (
        Part(Frustum(0.105 * s, 0.125 * s, 0.08 * s), shell, pose(z=0.04 * s)),
        Part(Ellipsoid((0.125 * s, 0.14 * s, 0.14 * s)), shell, pose(z=0.14 * s)),
        Part(Ellipsoid((0.1 * s, 0.05 * s, 0.05 * s)), textures.mottled((*key, "visor"), DARK, 0.25, 0.1), pose(y=-0.1 * s, z=0.15 * s)),
    )


def scissors(key: Key) -> tuple[Part, ...]:
    """Open scissors that lie flat: two blades and two rings."""
    base, _ = colours(key)
    s = _scale(key)
    steel = textures.mottled((*key, "steel"), METAL, 0.12, 0.05)
    grip = textures.mottled((*key, "grip"), base, 0.12, 0.05)
    parts = []
    for side in (-1, 1):
        turn = 0.16 * side
        along = np.array([np.sin(turn), np.cos(turn)])
        x, y = 0.045 * s * along
        parts.append(Part(Box((0.018 * s, 0.12 * s, 0.004)), steel, pose(-x, y, 0.009 + 0.004 * side, (0.0, 0.0, turn))))
        parts.append(Part(Torus(0.026 * s, 0.008), grip, pose(0.034 * s * side, -0.06 * s, 0.008)))
    parts.append(Part(cylinder(0.006, 0.016), steel, pose(z=0.008)))
    return tuple(parts)


def shoe(key: Key) -> tuple[Part, ...]:
    """A trainer: sole, body, toe and a dark opening."""
    base, ink = colours(key)
    s = _scale(key)
    upper = textures.mottled(key, base, 0.15, 0.08)
    return (
        Part(Box((0.09 * s, 0.28 * s, 0.028)), textures.mottled((*key, "sole"), PAPER, 0.1, 0.08), pose(z=0.014)),
        Part(Ellipsoid((0.044 * s, 0.075 * s, 0.045), flat_bottom=True), upper, pose(y=-0.06 * s, z=0.028)),
        Part(Box((0.082 * s, 0.14 * s, 0.05)), upper, pose(y=0.065 * s, z=0.053)),
        Part(Frustum(0.041 * s, 0.036 * s, 0.05), upper, pose(y=0.09 * s, z=0.1)),
        Part(cylinder(0.03 * s, 0.004), textures.mottled((*key, "lining"), DARK, 0.2, 0.05), pose(y=0.09 * s, z=0.126)),
        Part(Box((0.086 * s, 0.02, 0.03)), textures.mottled((*key, "stripe"), ink, 0.1, 0.05), pose(y=0.03 * s, z=0.055)),
        Part(Box((0.04 * s, 0.06 * s, 0.008)), textures.mottled((*key, "laces"), WHITE, 0.2, 0.02), pose(y=-0.02 * s, z=0.078)),
    )


def racquet(key: Key) -> tuple[Part, ...]:
    """A tennis racquet that lies flat: frame, strings and grip."""
    base, _ = colours(key)
    s = _scale(key, 0.04)
    frame = textures.mottled(key, base, 0.15, 0.08)
    grip = textures.mottled((*key, "grip"), DARK, 0.25, 0.05)
    strings = textures.keys((*key, "strings"), (0.35, 0.36, 0.33), (0.88, 0.88, 0.78), (0.2 * s, 0.2 * s), columns=12, rows=12)
    return (
        Part(Torus(0.118 * s, 0.011), frame, pose(y=0.2 * s, z=0.014)),
        Part(cylinder(0.112 * s, 0.004), strings, pose(y=0.2 * s, z=0.014)),
        Part(Box((0.024, 0.17 * s, 0.02)), frame, pose(y=0.01 * s, z=0.014)),
        Part(Box((0.034, 0.26 * s, 0.028)), grip, pose(y=-0.195 * s, z=0.014)),
    )


def vase(key: Key) -> tuple[Part, ...]:
    """A bellied vase with an open neck."""
    base, ink = colours(key)
    s = _scale(key, 0.12)
    glaze = textures.bands(key, base, ink, 0.3 * s, ((0.35, 0.45), (0.7, 0.76)))
    return (
        Part(cylinder(0.05 * s, 0.02 * s), glaze, pose(z=0.01 * s)),
        Part(Frustum(0.05 * s, 0.1 * s, 0.12 * s, top=False), glaze, pose(z=0.08 * s)),
        Part(Frustum(0.1 * s, 0.045 * s, 0.1 * s, bottom=False, top=False), glaze, pose(z=0.19 * s)),
        Part(Frustum(0.045 * s, 0.065 * s, 0.07 * s, bottom=False, top=False), glaze, pose(z=0.275 * s)),
    )


def snowman(key: Key) -> tuple[Part, ...]:
    """Two balls of snow, a carrot, a scarf and a hat."""
    _, ink = colours(key)
    s = _scale(key, 0.05)
    snow = textures.mottled(key, WHITE, 0.05, 0.1)
    dark = textures.mottled((*key, "hat"), DARK, 0.2, 0.06)
    return (
        Part(Ellipsoid((0.09 * s, 0.09 * s, 0.075 * s)), snow, pose(z=0.075 * s)),
        Part(Ellipsoid((0.06 * s, 0.06 * s, 0.055 * s)), snow, pose(z=0.18 * s)),
        Part(Torus(0.048 * s, 0.012), textures.mottled((*key, "scarf"), (0.75, 0.15, 0.15), 0.2, 0.04), pose(z=0.14 * s)),
        Part(
            Frustum(0.009, 0.002, 0.045),
            textures.mottled((*key, "nose"), (0.92, 0.45, 0.1), 0.1, 0.03),
            pose(y=-0.075 * s, z=0.18 * s, omega=(np.pi / 2, 0.0, 0.0)),
        ),
        Part(cylinder(0.065 * s, 0.008), dark, pose(z=0.224 * s)),
        Part(cylinder(0.042 * s, 0.055 * s), textures.bands((*key, "band"), DARK, ink, 0.055, ((0.7, 0.95),), blots=0), pose(z=0.252 * s)),
        Part(Ellipsoid((0.007, 0.007, 0.007)), dark, pose(x=-0.02 * s, y=-0.055 * s, z=0.195 * s)),
        Part(Ellipsoid((0.007, 0.007, 0.007)), dark, pose(x=0.02 * s, y=-0.055 * s, z=0.195 * s)),
    )


def teacup(key: Key) -> tuple[Part, ...]:
    """A low cup with a handle on a saucer."""
    base, ink = colours(key)
    china = textures.bands(key, WHITE, base, 0.055, ((0.15, 0.4),))
    saucer = textures.mottled((*key, "saucer"), ink, 0.08, 0.05)
    return (
        Part(Frustum(0.045, 0.07, 0.014), saucer, pose(z=0.007)),
        Part(Frustum(0.026, 0.046, 0.055, top=False), china, pose(z=0.014 + 0.0275)),
        Part(
            Torus(0.017, 0.005),
            textures.mottled((*key, "handle"), WHITE, 0.06, 0.05),
            pose(x=0.05, z=0.045, omega=(np.pi / 2, 0.0, 0.0)),
        ),
    )


def toy_car(key: Key) -> tuple[Part, ...]:
    """A car with a cabin and four wheels, its bonnet to -y."""
    base, ink = colours(key)
    s = _scale(key)
    paint = textures.mottled(key, base, 0.12, 0.08)
    tyre = textures.mottled((*key, "tyre"), DARK, 0.2, 0.04)
    wheels = tuple(
        Part(cylinder(0.024 * s, 0.022), tyre, pose(0.042 * s * sx, 0.072 * s * sy, 0.024 * s, (0.0, np.pi / 2, 0.0)))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )
    return (
        Part(Box((0.095 * s, 0.235 * s, 0.035)), paint, pose(z=0.02 * s + 0.0175)),
        Part(
            Box((0.08 * s, 0.11 * s, 0.032)),
            textures.mottled((*key, "glass"), (0.3, 0.4, 0.5), 0.15, 0.06),
            pose(y=0.02, z=0.02 * s + 0.05),
        ),
        Part(Box((0.078 * s, 0.09 * s, 0.006)), paint, pose(y=0.02, z=0.02 * s + 0.069)),
        Part(Box((0.02, 0.236 * s, 0.001)), textures.mottled((*key, "stripe"), ink, 0.1, 0.05), pose(z=0.02 * s + 0.0355)),
        *wheels,
    )


def electric_outlet(key: Key) -> tuple[Part, ...]:
    """A double socket on a wall: its back is the plane of high y, its front to -y."""
    plate = textures.mottled(key, WHITE, 0.05, 0.08)
    dark = textures.mottled((*key, "hole"), DARK, 0.1, 0.03)
    sockets = tuple(
        Part(
            cylinder(0.026, 0.004),
            textures.mottled((*key, "well"), (0.6, 0.6, 0.58), 0.1, 0.05),
            pose(x, -0.006, 0.045, (np.pi / 2, 0.0, 0.0)),
        )
        for x in (-0.042, 0.042)
    )
    holes = tuple(Part(Box((0.008, 0.003, 0.008)), dark, pose(x + dx, -0.0085, 0.045)) for x in (-0.042, 0.042) for dx in (-0.01, 0.01))
    return (Part(Box((0.16, 0.01, 0.09)), plate, pose(z=0.045)), *sockets, *holes)


def cheez_it_box(key: Key) -> tuple[Part, ...]:
    """A red carton of crackers."""
    return catalogue.box(key, (0.78, 0.10, 0.09), (0.97, 0.83, 0.25), (0.164, 0.072, 0.213))


def hammer(key: Key) -> tuple[Part, ...]:
    """A claw hammer that lies on its side, its handle along y."""
    base, _ = colours(key)
    s = _scale(key)
    steel = textures.mottled((*key, "steel"), METAL, 0.15, 0.05)
    along_x = (0.0, np.pi / 2, 0.0)
    return (
        Part(Box((0.028, 0.19 * s, 0.026)), textures.mottled(key, base, 0.15, 0.08), pose(y=-0.07 * s, z=0.016)),
        Part(
            cylinder(0.009, 0.11 * s),
            textures.wood((*key, "shaft"), (0.72, 0.55, 0.33), 0.2),
            pose(y=0.07 * s, z=0.016, omega=(np.pi / 2, 0.0, 0.0)),
        ),
        Part(cylinder(0.016, 0.055), steel, pose(x=-0.035, y=0.13 * s, z=0.016, omega=along_x)),
        Part(Box((0.06, 0.026, 0.026)), steel, pose(x=0.01, y=0.13 * s, z=0.016)),
        Part(Box((0.05, 0.012, 0.012)), steel, pose(x=0.055, y=0.12 * s, z=0.016, omega=(0.0, 0.0, -0.35))),
    )


def book(key: Key) -> tuple[Part, ...]:
    """A book that lies, or now and then stands."""
    base, ink = colours(key)
    s = _scale(key, 0.12)
    if generator(*key, "stands").random() < 0.3:
        return catalogue.standing_book(key, base, ink, (0.17 * s, 0.045, 0.24 * s))
    return catalogue.book(key, base, ink, (0.17 * s, 0.24 * s, 0.035))


def _painted(build: Callable[[Key, Rgb, Rgb], tuple[Part, ...]]) -> Callable[[Key], tuple[Part, ...]]:
    return lambda key: build(key, *colours(key))


STAND_INS: dict[str, Callable[[Key], tuple[Part, ...]]] = {
    "apple": catalogue.apple,
    "bag": bag,
    "banana": banana,
    "bin": bin_,
    "book": book,
    "bottle": _painted(catalogue.bottle),
    "bowl": _painted(catalogue.bowl),
    "chair": chair,
    "Cheez-It box": cheez_it_box,
    "cup": _painted(catalogue.cup),
    "electric outlet": electric_outlet,
    "fan": fan,
    "flower": lambda key: catalogue.flower(key, colours(key)[0]),
    "football": lambda key: catalogue.football(key, 0.09 * _scale(key)),
    "hammer": hammer,
    "helmet": helmet,
    "monitor": catalogue.monitor,
    "racquet": racquet,
    "scissors": scissors,
    "shoe": shoe,
    "snowman": snowman,
    "teacup": teacup,
    "toy car": toy_car,
    "vase": vase,
}
"""Label -> what builds one from a key."""

STAND_IN_WORDS: dict[str, tuple[str, ...]] = {
    "bag": ("backpack",),
    "racquet": ("tennis racket",),
    "shoe": ("sneaker",),
    "cup": ("mug",),
    "flower": ("potted plant",),
}
"""Words that are right for a stand-in, beyond the synonyms of its label."""
