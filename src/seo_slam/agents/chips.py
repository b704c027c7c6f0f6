"""Where the plate with a box's number goes: beside its box, over nothing that is to be looked at, and over no other plate."""

from collections.abc import Sequence

import numpy as np

from seo_slam.geometry import FloatArray

Rect = tuple[int, int, int, int]
"""``x0, y0, x1, y1`` in whole pixels."""

CHIP_PX = 28
"""Side of a plate: its figure is 17 pixels high, which models read in pictures of 512."""

_GAP_PX = 4  # from a box, so that its outline stays whole
_GRID_PX = 8
_COVERING = 10.0  # price of covering all of a box; 40 pixels of distance cost 1
_DISTANCE_PX = 40.0
_GOOD_ENOUGH = 0.25
_OVER_A_CHIP = 1e6


def chip_place(box: Rect, others: Sequence[Rect], chips: Sequence[Rect], cell: Rect) -> Rect:
    """Return where the plate of a box goes: at its side if that is free, else the nearest free place in the cell.

    Args:
        box: to be numbered.
        others: other boxes, which it is not to cover either.
        chips: plates that are there already.
        cell: it lies wholly inside.
    """
    beside = _beside(box, cell)
    if len(beside):
        costs = _costs(beside, box, others, chips)
        if costs.min() <= _GOOD_ENOUGH:
            return _chip(beside[int(costs.argmin())])
    places = np.concatenate([beside, _everywhere(cell)])
    return _chip(places[int(_costs(places, box, others, chips).argmin())])


def rect_gap(a: Rect, b: Rect) -> float:
    """Return the pixels between two rectangles, 0 if they touch or overlap."""
    return float(np.hypot(max(a[0] - b[2], b[0] - a[2], 0), max(a[1] - b[3], b[1] - a[3], 0)))


def _beside(box: Rect, cell: Rect) -> FloatArray:
    """Upper left corners (P, 2) of places along the sides of a box, then in its corners, that lie in the cell."""
    x0, y0, x1, y1 = box
    left, right, above, below = x0 - _GAP_PX - CHIP_PX, x1 + _GAP_PX, y0 - _GAP_PX - CHIP_PX, y1 + _GAP_PX
    columns, lines = (x0, x1 - CHIP_PX, (x0 + x1 - CHIP_PX) // 2), (y0, y1 - CHIP_PX, (y0 + y1 - CHIP_PX) // 2)
    places = [(x, y) for y in (above, below) for x in columns] + [(x, y) for x in (left, right) for y in lines]
    places += [(x, y) for y in (y0, y1 - CHIP_PX) for x in (x0, x1 - CHIP_PX)]
    inside = [(x, y) for x, y in places if x >= cell[0] and y >= cell[1] and x + CHIP_PX <= cell[2] and y + CHIP_PX <= cell[3]]
    return np.array(inside, dtype=np.float64).reshape(-1, 2)


def _everywhere(cell: Rect) -> FloatArray:
    x = np.arange(cell[0], cell[2] - CHIP_PX + 1, _GRID_PX, dtype=np.float64)
    y = np.arange(cell[1], cell[3] - CHIP_PX + 1, _GRID_PX, dtype=np.float64)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _costs(places: FloatArray, box: Rect, others: Sequence[Rect], chips: Sequence[Rect]) -> FloatArray:
    """(P,) how bad each place is: what it covers of boxes, as shares of them, how far it lies, and plates it would cover."""
    apart_x = np.maximum(np.maximum(box[0] - places[:, 0] - CHIP_PX, places[:, 0] - box[2]), 0.0)
    apart_y = np.maximum(np.maximum(box[1] - places[:, 1] - CHIP_PX, places[:, 1] - box[3]), 0.0)
    cost = np.maximum(np.hypot(apart_x, apart_y) - _GAP_PX, 0.0) / _DISTANCE_PX
    for rect in (box, *others):
        area = max((rect[2] - rect[0]) * (rect[3] - rect[1]), 1)
        cost += _COVERING * _covered(places, rect) / area
    for chip in chips:
        cost += _OVER_A_CHIP * (_covered(places, chip) > 0)
    return np.asarray(cost, dtype=np.float64)


def _covered(places: FloatArray, rect: Rect) -> FloatArray:
    """(P,) square pixels of a rectangle under a plate at each place."""
    x = np.minimum(places[:, 0] + CHIP_PX, rect[2]) - np.maximum(places[:, 0], rect[0])
    y = np.minimum(places[:, 1] + CHIP_PX, rect[3]) - np.maximum(places[:, 1], rect[1])
    return np.asarray(np.maximum(x, 0.0) * np.maximum(y, 0.0), dtype=np.float64)


def _chip(place: FloatArray) -> Rect:
    x, y = round(float(place[0])), round(float(place[1]))
    return x, y, x + CHIP_PX, y + CHIP_PX
