"""What an anchor hides of what is on it: how steeply one must look down, from each side, to see a place on it over its edges."""

import numpy as np

from seo_slam.abstraction.abstract_map import Place
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

SECTORS = 16
"""Directions around a place, the first from -180 to -157.5 degrees against x."""

_OWN_M = 0.2  # so near to a place the anchor's points may be the thing's own
_OPEN = -10.0
"""Slope where nothing stands around: whatever looks from there sees the place."""


def place_on(middle_world: FloatArray, p_anchor_world: FloatArray) -> Place:
    """Return a place (3,) with what points (N, 3) of its anchor hide of it.

    Args:
        middle_world: of the thing.
        p_anchor_world: cloud of the anchor, without stray points.
    """
    way = np.asarray(p_anchor_world, dtype=np.float64)[:, :3] - middle_world
    away_m = np.linalg.norm(way[:, :2], axis=1)
    around = away_m > _OWN_M
    slopes = np.full(SECTORS, _OPEN)
    np.maximum.at(slopes, _sector(way[around, :2], SECTORS), way[around, 2] / away_m[around])
    return Place(np.asarray(middle_world, dtype=np.float64), slopes)


def shows(place: Place, xy_world: FloatArray, z_m: float) -> BoolArray:
    """Return (N,) whether the anchor leaves the place in sight of an eye at points (N, 2) and a height."""
    way = np.asarray(xy_world, dtype=np.float64) - place.p_world[:2]
    slope = (z_m - place.p_world[2]) / np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    return np.asarray(slope > place.horizon[_sector(way, len(place.horizon))])


def _sector(way: FloatArray, sectors: int) -> IntArray:
    bearings = np.arctan2(way[:, 1], way[:, 0])
    return np.asarray(np.floor((bearings + np.pi) / (2.0 * np.pi) * sectors).astype(np.int64) % sectors)
