"""Rooms: the floor parted at its doors, each part named by the furniture in it. Beyond the paper."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from seo_slam.abstraction.abstract_map import Anchor, Layout, Room
from seo_slam.abstraction.room_finding import room_of
from seo_slam.abstraction.room_words import room_votes
from seo_slam.interfaces import Embedder
from seo_slam.registry import missing
from seo_slam.settings.planning import LayoutSettings
from seo_slam.types import BoolArray

try:
    from skimage.segmentation import watershed
except ModuleNotFoundError as error:
    raise missing("finding rooms", error) from error

_EIGHT = np.ones((3, 3), dtype=np.bool_)
_ALSO = 0.5  # of the votes for the first kind: then a room is of a second kind as well
_MOST_KINDS = 3


def with_rooms(layout: Layout, anchors: Sequence[Anchor], embedder: Embedder, settings: LayoutSettings) -> tuple[Layout, tuple[Room, ...]]:
    """Return the layout with the room of each cell, and the rooms by rising id.

    Args:
        layout: with walls, obstacles and floor; its ``rooms`` are not looked at.
        anchors: furniture; none: all rooms are called "room 1", "room 2", ….
        embedder: the one that the anchors' features come from.
        settings: see ``door_m``, ``room_area_m2`` and ``name_similarity``.
    """
    cells = room_cells(layout, settings)
    names = _names(layout, cells, anchors, embedder, settings)
    areas = np.bincount(cells.ravel(), minlength=len(names) + 1)[1:] * layout.cell_m**2
    rooms = tuple(Room(k + 1, name, float(area)) for k, (name, area) in enumerate(zip(names, areas, strict=True)))
    return replace(layout, rooms=cells), rooms


def room_cells(layout: Layout, settings: LayoutSettings) -> NDArray[np.int16]:
    """Return (R, C) the room of each cell, 1, 2, … by falling area; 0 for walls and what was never seen.

    What is seen and no wall, furniture included, is parted where it is narrower than a door: the parts that remain when all within
    half a door's width of a wall is taken away are the hearts of the rooms, and the rest is given to them by a watershed on the
    distance from the walls. What was not seen is no wall: rooms with holes in their floor stay whole.
    """
    inside = _inside(layout, settings)
    clearance_m = layout.cell_m * ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
    hearts, _ = ndimage.label(clearance_m > settings.door_m / 2.0, _EIGHT)
    regions = watershed(-clearance_m, hearts, mask=inside, connectivity=_EIGHT)
    return _numbered(_without_small(regions, settings.room_area_m2 / layout.cell_m**2), layout)


def _inside(layout: Layout, settings: LayoutSettings) -> BoolArray:
    """What lies between walls: seen cells that are no wall, and the holes between them that no door's width reaches across."""
    seen = (layout.floor | layout.obstacles) & ~layout.walls
    reach = max(round(settings.door_m / 4.0 / layout.cell_m), 1)
    padded = np.pad(seen, reach)
    near = ndimage.distance_transform_edt(~padded) <= reach
    closed = ndimage.distance_transform_edt(near) > reach
    holes = ndimage.binary_fill_holes(seen | layout.walls) & ~layout.walls
    return np.asarray((seen | closed[reach:-reach, reach:-reach] | holes) & ~layout.walls)


def _without_small(regions: NDArray[np.int32], least_cells: float) -> NDArray[np.int32]:
    """Give each region that is too small to the neighbour with which it shares most of its border; drop it if it has none."""
    regions = regions.copy()
    while True:
        sizes = np.bincount(regions.ravel())
        sizes[0] = 0
        small = np.flatnonzero((sizes > 0) & (sizes < least_cells))
        if not len(small):
            return regions
        smallest = int(small[np.argmin(sizes[small])])
        here = regions == smallest
        beside = regions[ndimage.binary_dilation(here, _EIGHT) & ~here]
        beside = beside[beside > 0]
        regions[here] = np.bincount(beside).argmax() if len(beside) else 0


def _numbered(regions: NDArray[np.int32], layout: Layout) -> NDArray[np.int16]:
    """Number the regions 1, 2, … by falling area."""
    sizes = np.bincount(regions.ravel())
    sizes[0] = 0
    order = [int(k) for k in np.argsort(-sizes, kind="stable") if sizes[k] > 0]
    numbers = np.zeros(len(sizes), dtype=np.int16)
    numbers[order] = np.arange(1, len(order) + 1)
    return np.asarray(numbers[regions], dtype=np.int16).reshape(layout.floor.shape)


def _names(layout: Layout, cells: NDArray[np.int16], anchors: Sequence[Anchor], embedder: Embedder, settings: LayoutSettings) -> list[str]:
    """A name for each room; the second of a kind has a number."""
    parted = replace(layout, rooms=cells)
    votes: list[dict[str, float]] = [{} for _ in range(int(cells.max(initial=0)) + 1)]
    for anchor, vote in zip(anchors, room_votes([anchor.feature for anchor in anchors], embedder, settings.name_similarity), strict=True):
        there = votes[room_of(parted, anchor.footprint_world)]
        there.update({kind: there.get(kind, 0.0) + weight for kind, weight in vote.items()})
    kinds = [_kind(vote) for vote in votes[1:]]
    used: Counter[str] = Counter()
    names = []
    for k, kind in enumerate(kinds):
        used[kind] += 1
        names.append(f"room {k + 1}" if not kind else kind if used[kind] == 1 else f"{kind} {used[kind]}")
    return names


def _kind(vote: dict[str, float]) -> str:
    """What a room is; where two or three kinds of furniture are about as many, it is all of them: "kitchen and living room"."""
    if not vote:
        return ""
    order = sorted(vote, key=lambda word: (-vote[word], word))
    much = [word for word in order[:_MOST_KINDS] if vote[word] >= _ALSO * vote[order[0]]]
    return " and ".join(filter(None, [", ".join(much[:-1]), much[-1]]))
