"""Things for a desk, built from primitive shapes. Each function returns the parts of one, base at z = 0, facing -y; metres.

``key`` seeds the paint; sizes vary a little with it too.
"""

import numpy as np

from seo_slam.geometry import FloatArray, so3_exp
from seo_slam.simulation import textures
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box, Ellipsoid, Frustum, Torus, cylinder
from seo_slam.simulation.textures import Rgb
from seo_slam.simulation.world import Part

Key = tuple[int | str, ...]

PAPER: Rgb = (0.90, 0.87, 0.78)
DARK: Rgb = (0.13, 0.13, 0.15)
WHITE: Rgb = (0.92, 0.92, 0.9)
METAL: Rgb = (0.62, 0.64, 0.67)


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, omega: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return a (4, 4) pose from a position in metres and a rotation vector in radians."""
    T = np.eye(4)
    T[:3, :3] = so3_exp(omega)
    T[:3, 3] = (x, y, z)
    return T


def book(key: Key, base: Rgb, ink: Rgb, size_m: tuple[float, float, float]) -> tuple[Part, ...]:
    """A book that lies flat: pages between two covers, the back at -x."""
    x, y, z = size_m
    plate = 0.004
    front = textures.cover(key, base, ink, (x, y))
    return (
        Part(Box((x, y, plate)), front, pose(z=plate / 2)),
        Part(Box((x - 0.01, y - 0.012, z - 2 * plate)), textures.mottled((*key, "pages"), PAPER, 0.1, 0.05), pose(z=z / 2)),
        Part(Box((plate, y, z - 2 * plate)), textures.mottled((*key, "spine"), base, 0.15, 0.1), pose(x=(plate - x) / 2, z=z / 2)),
        Part(Box((x, y, plate)), front, pose(z=z - plate / 2)),
    )


def standing_book(key: Key, base: Rgb, ink: Rgb, size_m: tuple[float, float, float]) -> tuple[Part, ...]:
    """A book that stands upright, its cover to -y; ``size_m`` is width, thickness, height."""
    x, y, z = size_m
    front = textures.cover(key, base, ink, (x, z))
    return (
        Part(Box((x, 0.004, z)), front, pose(y=0.002 - y / 2, z=z / 2)),
        Part(Box((x - 0.01, y - 0.008, z - 0.01)), textures.mottled((*key, "pages"), PAPER, 0.1, 0.05), pose(z=z / 2)),
        Part(Box((0.004, y - 0.008, z)), textures.mottled((*key, "spine"), base, 0.15, 0.1), pose(x=0.002 - x / 2, z=z / 2)),
        Part(Box((x, 0.004, z)), front, pose(y=y / 2 - 0.002, z=z / 2)),
    )


def cup(key: Key, base: Rgb, ink: Rgb) -> tuple[Part, ...]:
    """An open cup with a handle."""
    draws = generator(*key, "size")
    radius, height = float(draws.uniform(0.036, 0.042)), float(draws.uniform(0.088, 0.102))
    wall = textures.bands(key, base, ink, height, ((0.25, 0.6), (0.85, 1.0)))
    ring = Torus(0.024, 0.0065)
    return (
        Part(Frustum(0.9 * radius, radius, height, top=False), wall, pose(z=height / 2)),
        Part(
            ring,
            textures.mottled((*key, "handle"), base, 0.06, 0.05),
            pose(x=radius + 0.015, z=height / 2, omega=(np.pi / 2, 0.0, 0.0)),
        ),
    )


def bottle(key: Key, base: Rgb, ink: Rgb) -> tuple[Part, ...]:
    """A bottle with shoulders, a neck, a cap and a label around it."""
    glass = textures.mottled((*key, "glass"), base, 0.15, 0.12)
    return (
        Part(cylinder(0.037, 0.16), textures.bands(key, base, ink, 0.16, ((0.25, 0.8),)), pose(z=0.08)),
        Part(Frustum(0.037, 0.014, 0.05), glass, pose(z=0.185)),
        Part(cylinder(0.014, 0.03), glass, pose(z=0.225)),
        Part(cylinder(0.017, 0.018), textures.mottled((*key, "cap"), ink, 0.1, 0.05), pose(z=0.249)),
    )


def football(key: Key, radius_m: float = 0.09) -> tuple[Part, ...]:
    """A ball with dark patches, tilted so that its poles do not show."""
    paint = textures.patches(key, (0.95, 0.95, 0.93), (0.1, 0.1, 0.14), 2 * radius_m)
    return (Part(Ellipsoid((radius_m,) * 3), paint, pose(z=radius_m, omega=(0.5, 0.3, 0.0))),)


def apple(key: Key, base: Rgb = (0.78, 0.13, 0.1)) -> tuple[Part, ...]:
    """An apple with a stalk."""
    skin = textures.bands(key, base, (0.85, 0.62, 0.2), 0.075, ((0.0, 0.16),), blots=14)
    stalk = textures.mottled((*key, "stalk"), (0.35, 0.22, 0.1), 0.1, 0.03)
    return (
        Part(Ellipsoid((0.039, 0.039, 0.036)), skin, pose(z=0.036)),
        Part(cylinder(0.0025, 0.022), stalk, pose(z=0.079)),
    )


def bowl(key: Key, base: Rgb, ink: Rgb) -> tuple[Part, ...]:
    """An open bowl on a foot."""
    return (
        Part(cylinder(0.035, 0.012), textures.mottled((*key, "foot"), base, 0.06, 0.05), pose(z=0.006)),
        Part(Frustum(0.04, 0.085, 0.055, top=False), textures.bands(key, base, ink, 0.055, ((0.2, 0.55),)), pose(z=0.0395)),
    )


def monitor(key: Key, size_m: tuple[float, float] = (0.52, 0.31)) -> tuple[Part, ...]:
    """A screen on a foot."""
    x, z = size_m
    shell = textures.mottled((*key, "shell"), DARK, 0.2, 0.15)
    inner = (x - 0.03, z - 0.03)
    return (
        Part(Box((0.22, 0.17, 0.012)), shell, pose(z=0.006)),
        Part(Box((0.05, 0.03, 0.16)), shell, pose(y=0.03, z=0.09)),
        Part(Box((x, 0.03, z)), shell, pose(z=0.09 + z / 2)),
        Part(Box((inner[0], 0.004, inner[1])), textures.screen(key, inner), pose(y=-0.0165, z=0.09 + z / 2), glow=0.6),
    )


def keyboard(key: Key) -> tuple[Part, ...]:
    """A flat keyboard, its long side along x."""
    size = (0.43, 0.135)
    return (
        Part(
            Box((*size, 0.02)),
            textures.keys(key, (0.24, 0.25, 0.28), (0.8, 0.8, 0.78), size),
            pose(z=0.01),
        ),
    )


def mouse(key: Key, base: Rgb = (0.2, 0.21, 0.24)) -> tuple[Part, ...]:
    """A computer mouse, its long side along y."""
    return (
        Part(Ellipsoid((0.032, 0.056, 0.036), flat_bottom=True), textures.mottled(key, base, 0.25, 0.08), pose()),
        Part(
            Ellipsoid((0.005, 0.012, 0.006)),
            textures.mottled((*key, "wheel"), METAL, 0.1, 0.03),
            pose(y=-0.026, z=0.031),
        ),
    )


def box(key: Key, base: Rgb, ink: Rgb, size_m: tuple[float, float, float]) -> tuple[Part, ...]:
    """A printed carton."""
    x, y, z = size_m
    return (Part(Box(size_m), textures.cover(key, base, ink, (max(x, y), z)), pose(z=z / 2)),)


def lamp(key: Key, base: Rgb) -> tuple[Part, ...]:
    """A table lamp: foot, stem and an open shade."""
    metal = textures.mottled((*key, "metal"), METAL, 0.15, 0.1)
    shade = textures.bands(key, base, PAPER, 0.16, ((0.08, 0.16), (0.84, 0.92)), blots=0)
    return (
        Part(Frustum(0.075, 0.065, 0.02), metal, pose(z=0.01)),
        Part(cylinder(0.011, 0.24), metal, pose(z=0.14)),
        Part(Frustum(0.11, 0.07, 0.16, bottom=False, top=False), shade, pose(z=0.30), glow=0.25),
    )


def flower(key: Key, petal: Rgb) -> tuple[Part, ...]:
    """A pot with leaves and blossoms."""
    draws = generator(*key, "leaves")
    parts = [
        Part(Frustum(0.045, 0.06, 0.095), textures.bands(key, (0.66, 0.34, 0.2), (0.85, 0.6, 0.4), 0.095, ((0.0, 0.2),)), pose(z=0.0475))
    ]
    green = textures.mottled((*key, "leaf"), (0.2, 0.45, 0.16), 0.3, 0.06)
    blossom = textures.mottled((*key, "petal"), petal, 0.15, 0.04)
    for k in range(8):
        turn = 2.0 * np.pi * k / 8.0 + float(draws.uniform(-0.2, 0.2))
        out, up = float(draws.uniform(0.03, 0.055)), float(draws.uniform(0.12, 0.17))
        parts.append(
            Part(
                Ellipsoid((0.042, 0.02, 0.012)),
                green,
                pose(out * np.cos(turn), out * np.sin(turn), up) @ pose(omega=(0, 0, turn)) @ pose(omega=(0, -0.5, 0)),
            )
        )
    for k in range(5):
        turn = 2.0 * np.pi * (k + 0.3) / 5.0
        out = 0.0 if k == 0 else 0.045
        up = 0.225 if k == 0 else float(draws.uniform(0.18, 0.205))
        x, y = out * np.cos(turn), out * np.sin(turn)
        parts.append(Part(cylinder(0.003, up - 0.09), green, pose(0.8 * x, 0.8 * y, (up + 0.09) / 2)))
        parts.append(Part(Ellipsoid((0.022, 0.022, 0.018)), blossom, pose(x, y, up)))
    return tuple(parts)
