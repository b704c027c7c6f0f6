"""Which landmarks of a view lie near enough to each other to be asked about together, as possible doubles."""

from collections.abc import Sequence

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.interfaces import AgentView

SLACK_M = 0.1
"""Two landmarks may be one thing if their extents, with this between them, touch; the paper's distance of two separate things."""


def near_pairs(ids: Sequence[int], view: AgentView) -> list[tuple[int, int]]:
    """Return the pairs (lower id first) of ``ids`` that could be one thing: as near as their extents reach."""
    ordered = sorted(ids)
    if len(ordered) < 2:
        return []
    p_world, reach_m = places(ordered, view)
    apart = np.linalg.norm(p_world[:, None] - p_world[None], axis=2)
    near = apart <= np.maximum(reach_m[:, None], reach_m[None]) + SLACK_M
    return [(ordered[a], ordered[b]) for a, b in zip(*np.nonzero(np.triu(near, k=1)), strict=True)]


def nearby_group(first: int, ids: Sequence[int], view: AgentView, most: int) -> list[int]:
    """Return at most ``most`` of ``ids``: ``first``, and those nearest to it."""
    p_world, _ = places(list(ids), view)
    own, _ = places([first], view)
    order = np.argsort(np.linalg.norm(p_world - own[0], axis=1), kind="stable")
    return [first, *(ids[k] for k in order if ids[k] != first)][:most]


def places(ids: Sequence[int], view: AgentView) -> tuple[FloatArray, FloatArray]:
    """Return (N, 3) positions, world frame, and (N,) half of the largest extent, metres."""
    rows = np.searchsorted(view.landmarks.ids, np.array(ids, dtype=np.int64))
    return view.landmarks.p_world[rows], 0.5 * view.landmarks.size_m[rows].max(axis=1)
