"""How far a layout reaches: over all that was seen, unless the grid would be too large, as after a pose has jumped far away."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

MOST_CELLS = 16_000_000
"""Of a layout: 200 x 200 m in cells of 5 cm, which take about 1 GB while it is made. Files may hold more."""

_BLOCK_M = 2.0
_BESIDE_BLOCKS = 1.5  # from middle to middle, also over a corner


def within_reach(xy_world: FloatArray, seen: int, side_m: float, most_squares: float) -> BoolArray:
    """Return (N,) which places a grid of limited size is to cover; all of them where that is large enough.

    Else it covers the connected piece with most of what was seen, and of the others, those with most first, those that it still has room
    for. Where that piece alone is too large, it is the part around the middle of it.

    Args:
        xy_world: (N, 2), world frame.
        seen: so many of them, the first ones, at least 1, are places of what was seen; the rest is the camera's way.
        side_m: of a square of the grid.
        most_squares: that the grid may have.
    """
    squares = np.floor(xy_world / side_m)
    if _size(squares.min(axis=0), squares.max(axis=0)) <= most_squares:
        return np.ones(len(xy_world), dtype=np.bool_)
    piece = _pieces(xy_world)
    order = np.argsort(-np.bincount(piece[:seen], minlength=int(piece.max()) + 1), kind="stable")
    lows, highs = _boxes(squares, piece)
    low, high = _cut(squares[:seen][piece[:seen] == order[0]], lows[order[0]], highs[order[0]], most_squares)
    for label in order[1:]:
        wider = np.minimum(low, lows[label]), np.maximum(high, highs[label])
        if _size(*wider) <= most_squares:
            low, high = wider
    return np.asarray(((squares >= low) & (squares <= high)).all(axis=1))


def _size(low: FloatArray, high: FloatArray) -> float:
    return float(np.prod(high - low + 1.0))


def _pieces(xy_world: FloatArray) -> IntArray:
    """(N,) the number of the piece that each place is in; pieces are apart by an empty block or more."""
    blocks, block = np.unique(np.floor(xy_world / _BLOCK_M), axis=0, return_inverse=True)
    pairs = cKDTree(blocks).query_pairs(_BESIDE_BLOCKS, output_type="ndarray")
    joins = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(blocks), len(blocks)))
    return np.asarray(connected_components(joins, directed=False)[1][block.reshape(-1)], dtype=np.int64)


def _boxes(squares: FloatArray, piece: IntArray) -> tuple[FloatArray, FloatArray]:
    """(K, 2) lowest and highest square of each piece."""
    order = np.argsort(piece, kind="stable")
    starts = np.flatnonzero(np.diff(piece[order], prepend=-1))
    return np.minimum.reduceat(squares[order], starts), np.maximum.reduceat(squares[order], starts)


def _cut(squares: FloatArray, low: FloatArray, high: FloatArray, most_squares: float) -> tuple[FloatArray, FloatArray]:
    """A box, or as much of it as there is room for, around the one of some squares that is nearest to their middle."""
    if _size(low, high) <= most_squares:
        return low, high
    sides = high - low + 1.0
    short = min(float(sides.min()), np.floor(np.sqrt(most_squares)))
    sides = np.minimum(sides, np.where(sides == sides.min(), short, np.floor(most_squares / short)))
    middle = squares[np.argmin(np.linalg.norm(squares - np.median(squares, axis=0), axis=1))]
    first = np.clip(middle - np.floor(sides / 2.0), low, high - sides + 1.0)
    return first, first + sides - 1.0
