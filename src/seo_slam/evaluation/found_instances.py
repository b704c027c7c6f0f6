"""Which true thing each predicted object is, by its points alone: what over- and under-segmentation are counted from."""

from collections.abc import Sequence

import numpy as np

from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

LEAST = 0.25
"""An object may be of a thing on which at least this share of its points lies."""
MOST = 0.5
"""A thing is held by the object that is nearest to most of its points, if at least this share of them is near any object."""


def owners_of(clouds: Sequence[FloatArray], truth: LabelledCloud, near_m: float) -> tuple[int | None, ...]:
    """Return, for each cloud (M, 3), the thing that it is; None where it is none.

    A point lies on the thing of the nearest true point, if that is within ``near_m``. Of the things on which at least a quarter of its
    points lie, a cloud is the one with the greatest intersection over union: depth noise scatters half the points of a banana over the
    table below it, and yet it is the banana that it covers.
    """
    ids, sizes = np.unique(truth.instance_ids[np.isin(truth.instance_ids, list(truth.instances))], return_counts=True)
    owners: list[int | None] = []
    for p_world in clouds:
        distances_m, nearest = truth.tree.query(p_world, distance_upper_bound=near_m)
        near = truth.instance_ids[np.asarray(nearest, dtype=np.int64)[np.isfinite(distances_m)]]
        counts = np.array([(near == number).sum() for number in ids], dtype=np.int64)
        common = np.minimum(counts, sizes)
        overlap = np.where(counts >= LEAST * len(p_world), common / (len(p_world) + sizes - common), 0.0)
        best = int(overlap.argmax()) if len(ids) else 0
        owners.append(int(ids[best]) if len(ids) and overlap[best] > 0 else None)
    return tuple(owners)


def holders_of(truth: LabelledCloud, rows: IntArray, nearest_object: IntArray, is_near: BoolArray) -> dict[int, int]:
    """Return thing -> the object that is nearest to most of its points; things with most points far from all objects are left out.

    Args:
        truth: labelled points.
        rows: (R,) which of them to look at.
        nearest_object: (R,) the object nearest to each.
        is_near: (R,) whether it is near enough.
    """
    held: dict[int, int] = {}
    of_rows = truth.instance_ids[rows]
    for number in truth.instances:
        own = of_rows == number
        objects, counts = np.unique(nearest_object[own & is_near], return_counts=True)
        if len(objects) and counts.sum() >= MOST * own.sum():
            held[number] = int(objects[counts.argmax()])
    return held
