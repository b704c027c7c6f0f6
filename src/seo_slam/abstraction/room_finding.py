"""Which room something is in. The one rule that naming rooms, describing the map and queries for a room go by."""

import numpy as np
from numpy.typing import NDArray

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.geometry import FloatArray

_BESIDE_M = (0.0, 0.15, 0.3, 0.6, 1.0)  # how far beside it the floor of a thing's room is looked for


def room_of(layout: Layout, xy_world: FloatArray) -> int:
    """Return the id of the room that most of some points are in; where none is in any, of the room right beside them; 0 if none is near.

    Walls and what was never seen are no room and do not count: furniture covers its floor and stands at walls, so that a footprint may
    have no cell of a room. Of two rooms with equally many points it is the larger one, which has the lower id.

    Args:
        layout: with its rooms.
        xy_world: (N, 2) points, for example of a footprint, world frame; N > 0.
    """
    cells = layout.cells(xy_world)
    inside = ((cells >= 0) & (cells < layout.rooms.shape)).all(axis=1)
    room = _most(layout.rooms[tuple(cells[inside].T)])
    return room or room_of_box(layout, xy_world.min(axis=0), xy_world.max(axis=0))


def room_of_box(layout: Layout, low_world: FloatArray, high_world: FloatArray) -> int:
    """Return ``room_of`` all points of an upright box, given its corners (2,) or more, world frame."""
    for beside_m in _BESIDE_M:
        (first_row, first_column), (last_row, last_column) = layout.cells(np.stack([low_world - beside_m, high_world + beside_m]))
        room = _most(layout.rooms[max(first_row, 0) : max(last_row + 1, 0), max(first_column, 0) : max(last_column + 1, 0)])
        if room:
            return room
    return 0


def _most(rooms: NDArray[np.int16]) -> int:
    """The id above 0 that is there most often, the lowest of several; 0 if there is none."""
    counts = np.bincount(rooms[rooms > 0].ravel())
    return int(np.argmax(counts)) if len(counts) else 0
