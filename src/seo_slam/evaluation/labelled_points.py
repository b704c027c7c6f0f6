"""Truth of a segmentation: points of which it is known to which thing, and to which class, they belong."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from seo_slam.errors import EvaluationError
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

UNLABELLED = -1
"""As an instance or a class: nobody said what this point is."""


@dataclass(frozen=True, eq=False)
class LabelledCloud:
    """Points with the thing and the class of each; keep the object as long as the points hold, since its tree is built once.

    Attributes:
        p_world: (N, 3) float64, metres.
        instance_ids: (N,) int64, which thing; ``UNLABELLED`` for none.
        class_ids: (N,) int64, index into ``class_names``; ``UNLABELLED`` for none.
        class_names: K different words, those of structure ("wall") among them. A class may have no points.
        visible_keyframes: instance id -> keyframes that saw it well; None where nobody counted.

    Raises:
        EvaluationError: no points, arrays of other shapes, points that are not finite, or a class id without a name.
    """

    p_world: FloatArray
    instance_ids: IntArray
    class_ids: IntArray
    class_names: tuple[str, ...]
    visible_keyframes: Mapping[int, int] | None = None

    def __post_init__(self) -> None:
        n = len(self.p_world)
        if n == 0:
            raise EvaluationError("truth: got no points, wanted at least one labelled point")
        if self.p_world.shape != (n, 3) or self.instance_ids.shape != (n,) or self.class_ids.shape != (n,):
            shapes = f"{self.p_world.shape}, {self.instance_ids.shape} and {self.class_ids.shape}"
            raise EvaluationError(f"truth: got points, instances and classes of shapes {shapes}, wanted (N, 3), (N,) and (N,)")
        if not np.isfinite(self.p_world).all():
            row = int(np.flatnonzero(~np.isfinite(self.p_world).all(axis=1))[0])
            raise EvaluationError(f"truth: point {row} is {self.p_world[row].tolist()}, wanted finite metres")
        require_class_names(self.class_names)
        low, high = int(self.class_ids.min()), int(self.class_ids.max())
        if low < UNLABELLED or high >= len(self.class_names):
            raise EvaluationError(f"truth: got class ids {low}..{high}, wanted {UNLABELLED}..{len(self.class_names) - 1}")

    def __len__(self) -> int:
        return len(self.p_world)

    @cached_property
    def instances(self) -> dict[int, int]:
        """Instance id -> class id, rising: the class of most of its points, the smaller id on a tie. Unlabelled points are none."""
        known = (self.instance_ids != UNLABELLED) & (self.class_ids != UNLABELLED)
        ids, rows = np.unique(self.instance_ids[known], return_inverse=True)
        counts = np.zeros((len(ids), len(self.class_names)), dtype=np.int64)
        np.add.at(counts, (rows, self.class_ids[known]), 1)
        return dict(zip(ids.tolist(), counts.argmax(axis=1).tolist(), strict=True))

    @cached_property
    def tree(self) -> cKDTree:
        """For nearest points."""
        return cKDTree(self.p_world)


def require_class_names(names: tuple[str, ...]) -> None:
    """Raise ``EvaluationError`` unless these are different words, at least one."""
    if not names:
        raise EvaluationError("class names: got none, wanted at least one")
    empty = [index for index, name in enumerate(names) if not name.strip()]
    if empty:
        raise EvaluationError(f"class names: number {empty[0]} is {names[empty[0]]!r}, wanted a word")
    doubled = sorted({name for name in names if names.count(name) > 1})
    if doubled:
        raise EvaluationError(f"class names: got {doubled[0]!r} more than once, wanted different words")
