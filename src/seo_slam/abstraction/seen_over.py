"""Floor that was not seen, but seen over so low that nothing a robot would bump into can stand there."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray

_STEP_CELLS = 0.8  # between two points of a ray
_BEFORE_END_CELLS = 2.0  # where a ray ends something begins, about there


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What one frame saw, world frame, metres.

    Attributes:
        eye_world: (3,) where the camera was.
        p_world: (N, 3) points on surfaces.
    """

    eye_world: FloatArray
    p_world: FloatArray


def low_on_rays(views: Sequence[View], floor_plane: FloatArray, below_m: float, cell_m: float, most_rays: int) -> FloatArray:
    """Return (K, 2) places, about a cell apart, where the rays from eyes to points passed at most ``below_m`` above the floor.

    Args:
        views: of the frames.
        floor_plane: (3,) a, b, c of the floor's height a x + b y + c.
        below_m: above the floor.
        cell_m: of the layout.
        most_rays: of one view, taken evenly.
    """
    found = [np.zeros((0, 2))]
    for view in views:
        every = max(int(np.ceil(len(view.p_world) / most_rays)), 1)
        found.append(_low_on_rays(view.eye_world, view.p_world[::every], floor_plane, below_m, cell_m))
    return np.concatenate(found)


def _low_on_rays(eye: FloatArray, ends: FloatArray, plane: FloatArray, below_m: float, cell_m: float) -> FloatArray:
    above_eye = float(eye[2] - eye[:2] @ plane[:2] - plane[2])
    above_ends = ends[:, 2] - ends[:, :2] @ plane[:2] - plane[2]
    ends, above_ends = ends[above_ends < below_m], above_ends[above_ends < below_m]
    way = ends[:, :2] - eye[:2]
    length_m = np.linalg.norm(way, axis=1)
    # Height above the floor falls linearly along a ray, so it is low from one share of it on.
    first = np.clip((above_eye - below_m) / np.maximum(above_eye - above_ends, 1e-9), 0.0, 1.0)
    last = 1.0 - _BEFORE_END_CELLS * cell_m / np.maximum(length_m, 1e-9)
    kept = last > first
    if not kept.any():
        return np.zeros((0, 2))
    way, first, last, length_m = way[kept], first[kept], last[kept], length_m[kept]
    count = int(np.ceil(((last - first) * length_m).max() / (_STEP_CELLS * cell_m))) + 1
    at = first[:, None] + np.arange(count) * (_STEP_CELLS * cell_m / length_m)[:, None]
    return np.asarray((eye[:2] + way[:, None] * at[..., None])[at <= last[:, None]])
