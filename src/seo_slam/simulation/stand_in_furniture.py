"""Larger stand-ins: chair, bin, fan, and the tables on which things stand. Base at z = 0, front to -y; metres."""

import numpy as np

from seo_slam.simulation import textures
from seo_slam.simulation.catalogue import DARK, METAL, Key, pose
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box, Ellipsoid, Frustum, Torus, cylinder
from seo_slam.simulation.textures import Rgb
from seo_slam.simulation.world import Part

_CLOTHS: tuple[Rgb, ...] = ((0.20, 0.35, 0.55), (0.55, 0.18, 0.16), (0.25, 0.42, 0.28), (0.60, 0.45, 0.22), (0.35, 0.30, 0.42))
_WOODS: tuple[Rgb, ...] = ((0.72, 0.54, 0.36), (0.58, 0.42, 0.28), (0.80, 0.68, 0.50), (0.48, 0.33, 0.22))


def chair(key: Key) -> tuple[Part, ...]:
    """Four legs, a padded seat and a back at high y."""
    draws = generator(*key, "size")
    wide, deep, seat = (float(draws.uniform(*span)) for span in ((0.42, 0.48), (0.42, 0.48), (0.43, 0.47)))
    back = float(draws.uniform(0.38, 0.48))
    oak = textures.wood((*key, "wood"), _WOODS[int(draws.integers(len(_WOODS)))], 0.4)
    cloth = textures.mottled((*key, "cloth"), _CLOTHS[int(draws.integers(len(_CLOTHS)))], 0.2, 0.2)
    legs = tuple(
        Part(Box((0.04, 0.04, seat - 0.05)), oak, pose(sx * (wide / 2 - 0.02), sy * (deep / 2 - 0.02), (seat - 0.05) / 2))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )
    posts = tuple(Part(Box((0.04, 0.03, back)), oak, pose(sx * (wide / 2 - 0.02), deep / 2 - 0.015, seat + back / 2)) for sx in (-1, 1))
    return (
        *legs,
        *posts,
        Part(Box((wide, deep, 0.05)), cloth, pose(z=seat - 0.025)),
        Part(Box((wide - 0.08, 0.02, 0.16)), cloth, pose(y=deep / 2 - 0.015, z=seat + back - 0.09)),
        Part(Box((wide - 0.08, 0.02, 0.05)), oak, pose(y=deep / 2 - 0.015, z=seat + 0.4 * back)),
    )


def bin_(key: Key) -> tuple[Part, ...]:
    """An open waste bin with a rim."""
    draws = generator(*key, "size")
    radius, height = float(draws.uniform(0.12, 0.15)), float(draws.uniform(0.28, 0.38))
    base = _CLOTHS[int(draws.integers(len(_CLOTHS)))]
    wall = textures.bands(key, base, METAL, height, ((0.1, 0.16), (0.8, 0.86)), blots=6)
    return (
        Part(Frustum(0.8 * radius, radius, height, top=False), wall, pose(z=height / 2)),
        Part(Torus(radius - 0.004, 0.008), textures.mottled((*key, "rim"), DARK, 0.15, 0.08), pose(z=height - 0.008)),
    )


def fan(key: Key) -> tuple[Part, ...]:
    """A table fan: foot, stem, motor, blades and a wire guard."""
    draws = generator(*key, "size")
    s = float(draws.uniform(0.92, 1.08))
    blade = _CLOTHS[int(draws.integers(len(_CLOTHS)))]
    shell = textures.mottled((*key, "shell"), (0.85, 0.85, 0.82), 0.1, 0.1)
    wire = textures.mottled((*key, "wire"), METAL, 0.1, 0.05)
    paint = textures.mottled((*key, "blade"), blade, 0.15, 0.06)
    centre, ahead = 0.25 * s, (np.pi / 2, 0.0, 0.0)
    blades = tuple(
        Part(
            Ellipsoid((0.045 * s, 0.006, 0.028 * s)),
            paint,
            pose(0.065 * s * np.cos(turn), -0.045, centre + 0.065 * s * np.sin(turn), (0.0, -float(turn), 0.0)),
        )
        for turn in (np.pi / 2, np.pi / 2 + 2 * np.pi / 3, np.pi / 2 + 4 * np.pi / 3)
    )
    rings = tuple(
        Part(Torus(r * s, 0.005), wire, pose(y=y, z=centre, omega=ahead)) for r, y in ((0.125, -0.03), (0.125, -0.06), (0.07, -0.07))
    )
    return (
        Part(Frustum(0.085 * s, 0.06 * s, 0.025), shell, pose(z=0.0125)),
        Part(cylinder(0.016, 0.22 * s), shell, pose(z=0.02 + 0.11 * s)),
        Part(Ellipsoid((0.045, 0.055, 0.045)), shell, pose(y=0.01, z=centre)),
        Part(cylinder(0.02, 0.03), shell, pose(y=-0.05, z=centre, omega=ahead)),
        *blades,
        *rings,
    )


def table(key: Key, size_m: tuple[float, float, float]) -> tuple[Part, ...]:
    """A table of width, depth and height ``size_m``: top, apron and four legs."""
    wide, deep, high = size_m
    thick = 0.035
    tone = _WOODS[int(generator(*key, "tone").integers(len(_WOODS)))]
    leg = textures.mottled((*key, "leg"), (0.35, 0.36, 0.38), 0.15, 0.2)
    legs = tuple(
        Part(Box((0.05, 0.05, high - thick)), leg, pose(sx * (wide / 2 - 0.06), sy * (deep / 2 - 0.06), (high - thick) / 2))
        for sx in (-1, 1)
        for sy in (-1, 1)
    )
    return (Part(Box((wide, deep, thick)), textures.wood((*key, "top"), tone), pose(z=high - thick / 2)), *legs)
