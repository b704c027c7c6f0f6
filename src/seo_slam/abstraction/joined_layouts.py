"""One layout of two that were made of the same place, or of places side by side."""

from dataclasses import replace

import numpy as np

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.types import BoolArray


def joined(known: Layout, seen: Layout) -> Layout:
    """Return a layout over the ground of both, in the cells of the first one; what the second adds is of no room yet.

    What either calls floor, obstacle or wall is one: a thing that was carried away since stays an obstacle until the place is mapped anew.

    Args:
        known: gives the grid.
        seen: may have another grid; each of its cells goes to the one that its middle lies in.
    """
    cells = np.argwhere(np.ones_like(seen.floor))
    at = known.cells(seen.middles(cells))
    rows, columns = known.floor.shape
    low = np.minimum(at.min(axis=0, initial=0), 0)
    high = np.maximum(at.max(axis=0, initial=0) + 1, (rows, columns))
    shape = tuple(int(n) for n in high - low)
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
