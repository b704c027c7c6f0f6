"""Finds places for the labels of a map so that none covers another."""

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray

_LINE_HEIGHT = 1.25
NEAR_RINGS = (1.0, 2.4, 4.2)
"""Distances of a label from its point, in steps of the gap; the nearest free one is taken."""
FAR_RINGS = (*NEAR_RINGS, 6.5, 9.0, 12.0, 16.0)
"""For crowded pictures in which no label should be missing."""
_SIDES = ((1, 0), (-1, 0), (0, -1), (0, 1), (1, -1), (1, 1), (-1, -1), (-1, 1))  # x right, y down


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a label stands.

    Attributes:
        box_px: left, top, right, bottom.
        leader: whether it stands so far from its point that a line must lead to it.
    """

    box_px: tuple[float, float, float, float]
    leader: bool


def text_width_px(text: str, font_px: float) -> float:
    """A safe estimate of a text's width in a sans-serif font: 0.62 em a character, 1 em for wide (East Asian) ones."""
    return font_px * sum(1.0 if unicodedata.east_asian_width(c) in "WF" else 0.62 for c in text)


def place_labels(
    points_px: FloatArray,
    texts: Sequence[str],
    font_px: float,
    bounds_px: tuple[float, float, float, float],
    obstacles_px: FloatArray,
    gap_px: float = 7.0,
    rings: tuple[float, ...] = NEAR_RINGS,
) -> list[Placement | None]:
    """Place labels beside their points, the first ones first; None where no place is free.

    Args:
        points_px: (N, 2) points, x right, y down.
        texts: N labels; an empty one gets no place.
        font_px: size of the letters.
        bounds_px: left, top, right, bottom; labels stay inside.
        obstacles_px: (M, 4) boxes that no label may cover.
        gap_px: space between a point and its label.
        rings: distances that are tried, in steps of the gap.
    """
    taken = np.empty((len(obstacles_px) + len(texts), 4))
    taken[: len(obstacles_px)] = obstacles_px
    count = len(obstacles_px)
    placements: list[Placement | None] = []
    for point, text in zip(points_px, texts, strict=True):
        size = np.array([text_width_px(text, font_px), _LINE_HEIGHT * font_px])
        candidates = _candidates(point, size, gap_px, rings)
        free = np.flatnonzero(_inside(candidates, bounds_px) & ~_covers_any(candidates, taken[:count]))
        if not text or len(free) == 0:
            placements.append(None)
            continue
        best = int(free[0])
        taken[count] = candidates[best]
        count += 1
        left, top, right, bottom = candidates[best].tolist()
        placements.append(Placement((left, top, right, bottom), leader=best >= len(_SIDES)))
    return placements


def _candidates(point: FloatArray, size: FloatArray, gap_px: float, rings: tuple[float, ...]) -> FloatArray:
    """(C, 4) boxes around a point, the preferred first."""
    sides = np.array(_SIDES, dtype=np.float64)
    away_px = np.array(rings)[:, None, None] * gap_px
    centres = (point + sides * (size / 2 + away_px)).reshape(-1, 2)
    return np.concatenate([centres - size / 2, centres + size / 2], axis=1)


def _inside(boxes: FloatArray, bounds_px: tuple[float, float, float, float]) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    left, top, right, bottom = bounds_px
    return np.asarray((boxes[:, 0] >= left) & (boxes[:, 1] >= top) & (boxes[:, 2] <= right) & (boxes[:, 3] <= bottom))


def _covers_any(boxes: FloatArray, taken: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    a, b = boxes[:, None, :], taken[None, :, :]
    apart = (a[..., 2] <= b[..., 0]) | (b[..., 2] <= a[..., 0]) | (a[..., 3] <= b[..., 1]) | (b[..., 3] <= a[..., 1])
    return np.asarray((~apart).any(axis=1))
