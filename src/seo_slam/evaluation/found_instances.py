"""Which true thing each predicted object is, by its points alone: what over- and under-segmentation are counted from."""

from collections.abc import Sequence

import numpy as np

from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

MOST = 0.5
"""An object is of the thing on which at least this share of its points lies."""


def owners_of(clouds: Sequence[FloatArray], truth: LabelledCloud, near_m: float) -> tuple[int | None, ...]:
    """Return, for each cloud (M, 3), the thing on which at least half of its points lie; None where there is no such thing.

    A point lies on the thing of the nearest true point, if that is within ``near_m``.
    """
    ids = np.array(sorted(truth.instances), dtype=np.int64)
    owners: list[int | None] = []
    for p_world in clouds:
        distances_m, nearest = truth.tree.query(p_world, distance_upper_bound=near_m)
        near = np.asarray(nearest, dtype=np.int64)[np.isfinite(distances_m)]
        number, count = _most_frequent(truth.instance_ids[near], ids)
        owners.append(number if number is not None and count >= MOST * len(p_world) else None)
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


def _most_frequent(found: IntArray, ids: IntArray) -> tuple[int | None, int]:
    known = found[np.isin(found, ids)]
    if not len(known):
        return None, 0
    values, counts = np.unique(known, return_counts=True)
    return int(values[counts.argmax()]), int(counts.max())
