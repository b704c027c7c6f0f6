"""One layout of two that were made of the same place, or of places side by side."""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.abstraction.extent import MOST_CELLS
from seo_slam.types import BoolArray

_LOG = logging.getLogger(__name__)


def joined(known: Layout, seen: Layout, warn: Callable[[str], None] = _LOG.warning, most_cells: int = MOST_CELLS) -> Layout:
    """Return a layout over the ground of both, in the cells of the first one; what the second adds is of no room yet.

    What either calls floor, obstacle or wall is one: a thing that was carried away since stays an obstacle until the place is mapped anew.
    Two that lie so far apart that it would have more cells than it may stay two, and the known one is returned.

    Args:
        known: gives the grid.
        seen: may have another grid; each of its cells goes to the one that its middle lies in.
        warn: is told if what was seen is left out.
        most_cells: that it may have, or as many as the known one has.
    """
    cells = np.argwhere(np.ones_like(seen.floor))
    at = known.cells(seen.middles(cells))
    rows, columns = known.floor.shape
    low = np.minimum(at.min(axis=0, initial=0), 0)
    high = np.maximum(at.max(axis=0, initial=0) + 1, (rows, columns))
    shape = tuple(int(n) for n in high - low)
    if shape[0] * shape[1] > max(most_cells, known.floor.size):
        warn(
            f"layout: the floor that was seen now is left out: with it, so far from that of the map that is continued, it would have "
            f"{shape[0] * shape[1]} cells, wanted at most {most_cells}"
        )
        return known
    corner = known.corner_world + known.cell_m * low[::-1]

    def both(of_known: BoolArray, of_seen: BoolArray) -> BoolArray:
        out = np.zeros(shape, dtype=np.bool_)
        out[-low[0] : rows - low[0], -low[1] : columns - low[1]] = of_known
        chosen = at[of_seen.ravel()] - low
        out[chosen[:, 0], chosen[:, 1]] = True
        return out

    rooms = np.zeros(shape, dtype=np.int16)
    rooms[-low[0] : rows - low[0], -low[1] : columns - low[1]] = known.rooms
    return replace(
        known,
        corner_world=corner,
        walls=both(known.walls, seen.walls),
        obstacles=both(known.obstacles, seen.obstacles),
        floor=both(known.floor, seen.floor),
        rooms=rooms,
    )
