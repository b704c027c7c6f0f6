"""Round and flat surfaces as triangles, as fine as a camera at arm's length can tell."""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

Triangles = tuple[FloatArray, IntArray]
"""Vertices (V, 3) in metres and faces (F, 3), indices into them."""

_SAGITTA_M = 5e-5  # how far a chord may lie below its arc: 0.03 px at 1 m
_FEWEST, _MOST = 16, 192


def turns_for(radius_m: float) -> int:
    """Return into how many chords a circle is cut, a multiple of 4."""
    chords = np.pi / np.arccos(max(1.0 - _SAGITTA_M / radius_m, 0.5))
    return 4 * int(np.ceil(np.clip(chords, _FEWEST, _MOST) / 4))


def cuboid(size_m: tuple[float, float, float]) -> Triangles:
    """Return the 12 triangles of a box around the origin, turning outward (counter-clockwise seen from outside)."""
    half = np.array(size_m) / 2.0
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return corners, np.array([face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))], dtype=np.int64)


def revolved(radius_m: FloatArray, z_m: FloatArray, turns: int) -> Triangles:
    """Return a profile (M,) of radii and heights turned around z; triangles of no area (at the axis) are left out."""
    angle = 2.0 * np.pi * np.arange(turns) / turns
    x, y = radius_m[:, None] * np.cos(angle), radius_m[:, None] * np.sin(angle)
    vertices = np.stack([x, y, np.broadcast_to(z_m[:, None], x.shape)], axis=-1).reshape(-1, 3)
    ring, step = np.arange(len(radius_m) - 1)[:, None] * turns, np.arange(turns)[None, :]
    a, b = ring + step, ring + (step + 1) % turns
    at_axis = np.broadcast_to((np.abs(radius_m) < 1e-12)[:, None], x.shape).ravel()
    lower = np.stack([a, b, b + turns], axis=-1).reshape(-1, 3)
    upper = np.stack([a, b + turns, a + turns], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate([lower[~at_axis[lower[:, 0]]], upper[~at_axis[upper[:, 1]]]])
