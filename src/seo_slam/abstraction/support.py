"""Planes that carry things: the Z histogram of a cloud (DualMap IV-A).

The paper takes the bin with most points. Points tell more of where the camera stood than of the thing: a cupboard seen from the side is all
front. Here a bin counts the squares of the floor above which it has points, and only by how much it has more than the thing usually has:
a vertical face fills few squares, the same ones at every height.
"""

from dataclasses import dataclass

import numpy as np

from seo_slam.abstraction.footprints import squares
from seo_slam.geometry import FloatArray
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.types import IntArray

_CELL_M = 0.05
_APART_M = 0.1
"""Two planes of a thing are at least so far apart."""
_MOST = 8
_ALIKE = 0.8
"""Of several planes that are nearly as large as the largest, the highest is the main one."""


@dataclass(frozen=True, slots=True)
class Plane:
    """A level surface.

    Attributes:
        height_m: z, world frame.
        area_m2: how much of it was seen, beyond what the thing has at any height.
    """

    height_m: float
    area_m2: float


def planes(p_world: FloatArray, settings: AbstractionSettings) -> tuple[Plane, ...]:
    """Return the level surfaces of a cloud (N, 3), world frame, largest first; none if it has only upright faces, or is empty."""
    if not len(p_world):
        return ()
    z = p_world[:, 2]
    counts, slabs, total = _cells_per_slab(p_world, settings.plane_bin_m)
    excess = _beyond_usual(counts, max(1, round(_APART_M / 2 / settings.plane_bin_m)))
    least = max(settings.plane_share * total, min(4.0, total))
    reach = round(_APART_M / settings.plane_bin_m)
    found: list[Plane] = []
    while len(found) < _MOST and excess.max() >= least:
        best = int(np.argmax(excess))
        while best + 1 < len(excess) and excess[best + 1] >= _ALIKE * excess.max():  # of a board, the upper face carries
            best += 1
        within = (slabs == best) | (slabs == best + 1)
        found.append(Plane(float(np.median(z[within])), float(excess[best]) * _CELL_M**2))
        excess[max(0, best - reach) : best + reach + 1] = -1.0
    return tuple(found)


def support_height(found: tuple[Plane, ...], top_m: float) -> float:
    """Return z of the plane that carries things: the highest of those nearly as large as the largest; the top where there is none."""
    return max((plane.height_m for plane in found if plane.area_m2 >= _ALIKE * found[0].area_m2), default=top_m)


def _cells_per_slab(p_world: FloatArray, bin_m: float) -> tuple[FloatArray, IntArray, int]:
    """Squares of the floor under each pair of neighbouring bins, the bin of each point counted from 1, and the squares under all.

    Pairs, since a plane may lie on the border of two bins.
    """
    z = p_world[:, 2]
    bins = np.floor((z - z.min()) / bin_m).astype(np.int64) + 1
    cell = squares(p_world, _CELL_M)
    total = int(cell.max()) + 1
    taken = np.unique(np.concatenate([bins, bins - 1]) * total + np.tile(cell, 2))
    counts = np.bincount(taken // total, minlength=int(bins.max()) + 1)
    return counts.astype(np.float64), bins, total


def _beyond_usual(counts: FloatArray, near: int) -> FloatArray:
    """Counts less their median, in which a plane itself and its neighbours do not count."""
    out = np.empty_like(counts)
    for i, count in enumerate(counts):
        others = np.concatenate([counts[: max(0, i - near)], counts[i + near + 1 :]])
        out[i] = count - (np.median(others) if len(others) else 0.0)
    return out
