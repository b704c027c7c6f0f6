"""Score a map with clouds against labelled points: mIoU, FmIoU, mAcc and ODR (DualMap V-A2), under a named protocol.

Every object is called by the class whose words are nearest to its feature; every true point takes the class of the predicted points
nearest to it; classes are then compared point by point.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.class_words import ClassWords
from seo_slam.evaluation.found_instances import holders_of, owners_of
from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.evaluation.scores import ENOUGH_KEYFRAMES
from seo_slam.evaluation.segmentation_protocols import SegmentationProtocol
from seo_slam.evaluation.segmentation_scores import ObjectCounts, SegmentationResult
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray, Landmark

COVERED_M = 0.05
"""A true point with a predicted point nearer than this is covered; as far may a predicted point be from the surface that it shows."""


@dataclass(frozen=True, eq=False)
class PredictedObject:
    """One object of a map.

    Attributes:
        p_world: (M, 3) its points, metres.
        feature: (D,) in the space of the class words; zeros (or none) where nothing is known of its looks.
        label: a word for it, used where there is no feature; "" for none.
        name: what messages call it.
    """

    p_world: FloatArray
    feature: FloatArray = field(default_factory=lambda: np.zeros(0))
    label: str = ""
    name: str = ""


def objects_of(landmarks: Sequence[Landmark]) -> tuple[PredictedObject, ...]:
    """Return the objects of a map's landmarks; give the stable ones."""
    return tuple(PredictedObject(row.cloud_world, row.embedding, row.label, f"landmark {row.id}") for row in landmarks)


def evaluate_segmentation(
    objects: Sequence[PredictedObject],
    truth: LabelledCloud,
    words: ClassWords,
    protocols: Sequence[SegmentationProtocol],
) -> tuple[SegmentationResult, ...]:
    """Score one prediction under some protocols.

    Args:
        objects: all of the map; an empty map scores 0.
        truth: labelled points in the same world frame.
        words: of the truth's classes, in their order, made by the embedder that made the objects' features.
        protocols: by which to score.

    Returns:
        A result a protocol, in their order.

    Raises:
        EvaluationError: an object without a cloud, with points that are not finite, or a feature of another length; words of other
            classes than the truth's; or no true point that a protocol does not drop.
    """
    _require_objects(objects, words)
    if words.names != truth.class_names:
        raise EvaluationError(f"class words: got {_some(words.names)}, wanted those of the truth: {_some(truth.class_names)}")
    similarity = words.similarity([item.feature for item in objects], [item.label for item in objects])
    owners = owners_of([item.p_world for item in objects], truth, COVERED_M)
    near = _Nearest.of(objects, truth, protocols)
    return tuple(_scored(protocol, truth, words, similarity, owners, near) for protocol in protocols)


def _scored(
    protocol: SegmentationProtocol,
    truth: LabelledCloud,
    words: ClassWords,
    similarity: FloatArray,
    owners: Sequence[int | None],
    near: "_Nearest",
) -> SegmentationResult:
    dropped = np.array([protocol.drops(name) for name in truth.class_names])
    rows = _counted_rows(truth, protocol)
    if not len(rows):
        gone = [name for name, is_dropped in zip(truth.class_names, dropped, strict=True) if is_dropped]
        raise EvaluationError(
            f"{protocol.name}: got no true points but those of dropped classes ({_some(gone)}), wanted at least one other"
        )
    true_classes = truth.class_ids[rows]
    allowed = np.isin(np.arange(len(dropped)), true_classes) if protocol.masked else np.ones(len(dropped), dtype=np.bool_)
    called = class_of_each(similarity, allowed)
    predicted = near.classes(rows, called, protocol.neighbours, len(dropped))
    confusion = np.zeros((len(dropped), len(dropped) + 1), dtype=np.int64)
    np.add.at(confusion, (true_classes, predicted), 1)
    return SegmentationResult(
        protocol=protocol,
        class_names=truth.class_names,
        dropped=tuple(bool(value) for value in dropped),
        confusion=confusion,
        called=tuple(int(index) for index in called),
        owners=tuple(owners),
        covered=near.covered(rows),
        counts=_counts(truth, dropped, called, owners, near.holders(truth, rows)),
        embedder=words.embedder,
        templates=words.templates,
    )


def class_of_each(similarity: FloatArray, allowed: BoolArray) -> IntArray:
    """Return (N,) the allowed class that is nearest in meaning, the smaller id on a tie; K where an object has no meaning at all.

    Args:
        similarity: (N, K) cosines; NaN rows where an object has neither feature nor label.
        allowed: (K,) which classes an object may be called by.
    """
    unknown = np.asarray(np.isnan(similarity).any(axis=1))
    masked = np.where(allowed & ~unknown[:, None], similarity, -np.inf)
    return np.asarray(np.where(unknown, similarity.shape[1], masked.argmax(axis=1)), dtype=np.int64)


def majority(labels: IntArray) -> IntArray:
    """Return (N,) the most frequent of each row (N, k) of class ids, the smaller id on a tie."""
    counts = (labels[:, :, None] == labels[:, None, :]).sum(axis=2)
    best = counts.max(axis=1, keepdims=True)
    return np.asarray(np.where(counts == best, labels, np.iinfo(np.int64).max).min(axis=1), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Nearest:
    """The objects nearest to each true point that any protocol counts.

    Attributes:
        row_of: (N,) row in the two arrays of each true point, -1 where no protocol counts it.
        objects: (R, k) of the k nearest predicted points, nearest first.
        distances_m: (R,) to the nearest.
    """

    row_of: IntArray
    objects: IntArray
    distances_m: FloatArray

    @classmethod
    def of(cls, objects: Sequence[PredictedObject], truth: LabelledCloud, protocols: Sequence[SegmentationProtocol]) -> "_Nearest":
        wanted = np.unique(np.concatenate([_counted_rows(truth, protocol) for protocol in protocols]))
        row_of = np.full(len(truth), -1, dtype=np.int64)
        row_of[wanted] = np.arange(len(wanted))
        if not objects:
            return cls(row_of, np.zeros((len(wanted), 0), dtype=np.int64), np.full(len(wanted), np.inf))
        p_world = np.concatenate([item.p_world for item in objects])
        owners = np.repeat(np.arange(len(objects)), [len(item.p_world) for item in objects])
        k = min(max(protocol.neighbours for protocol in protocols), len(p_world))
        distances_m, points = cKDTree(p_world).query(truth.p_world[wanted], k=np.arange(1, k + 1))
        return cls(row_of, owners[points].astype(np.int64), np.asarray(distances_m, dtype=np.float64)[:, 0])

    def classes(self, rows: IntArray, called: IntArray, neighbours: int, no_class: int) -> IntArray:
        """(R,) class that each true point gets."""
        objects = self.objects[self.row_of[rows], :neighbours]
        return majority(called[objects]) if objects.shape[1] else np.full(len(rows), no_class, dtype=np.int64)

    def holders(self, truth: LabelledCloud, rows: IntArray) -> dict[int, int]:
        """Thing -> object that is nearest to most of its points."""
        own = self.row_of[rows]
        if not self.objects.shape[1]:
            return {}
        return holders_of(truth, rows, self.objects[own, 0], self.distances_m[own] <= COVERED_M)

    def covered(self, rows: IntArray) -> float:
        """Share of true points with a predicted one nearby."""
        return float((self.distances_m[self.row_of[rows]] <= COVERED_M).mean())


def _counted_rows(truth: LabelledCloud, protocol: SegmentationProtocol) -> IntArray:
    """The true points that a protocol counts."""
    kept = np.array([not protocol.drops(name) for name in truth.class_names] + [False])  # the last is UNLABELLED's
    return np.flatnonzero(kept[truth.class_ids])


def _counts(
    truth: LabelledCloud, dropped: BoolArray, called: IntArray, owners: Sequence[int | None], holders: Mapping[int, int]
) -> ObjectCounts:
    seen = truth.visible_keyframes
    kept = {number: class_id for number, class_id in truth.instances.items() if not dropped[class_id]}
    visible = None if seen is None else {number for number in kept if seen.get(number, 0) >= ENOUGH_KEYFRAMES}
    ignored = np.append(dropped, False)[called]
    counted = [(owner, int(called[row])) for row, owner in enumerate(owners) if not ignored[row]]
    matched = {owner for owner, _ in counted if owner in kept}
    missed = kept.keys() - matched
    on_things = sum(owner in kept for owner, _ in counted)
    return ObjectCounts(
        predicted=len(counted),
        predicted_dropped=len(owners) - len(counted),
        unnamed=int((called == len(dropped)).sum()),
        objects=len(kept),
        objects_dropped=len(truth.instances) - len(kept),
        visible=None if visible is None else len(visible),
        matched=len(matched),
        duplicates=on_things - len(matched),
        of_dropped=sum(owner is not None and owner not in kept for owner, _ in counted),
        of_nothing=sum(owner is None for owner, _ in counted),
        missed=len(missed),
        missed_visible=None if visible is None else len(missed & visible),
        swallowed=sum(number in holders and not ignored[holders[number]] for number in missed),
        rightly_called=sum(owner is not None and kept.get(owner) == class_id for owner, class_id in counted),
    )


def _require_objects(objects: Sequence[PredictedObject], words: ClassWords) -> None:
    for row, item in enumerate(objects):
        name = item.name or f"object {row}"
        if item.p_world.ndim != 2 or item.p_world.shape[1:] != (3,) or not len(item.p_world):
            raise EvaluationError(f"{name}: got a cloud of shape {item.p_world.shape}, wanted (M, 3) with at least one point")
        if not np.isfinite(item.p_world).all():
            raise EvaluationError(f"{name}: its cloud holds NaN or infinity, wanted metres")
        if item.feature.shape not in ((0,), (words.features.shape[1],)):
            raise EvaluationError(
                f"{name}: got a feature of shape {item.feature.shape}, wanted ({words.features.shape[1]},) as of {words.embedder}"
            )
        if not np.isfinite(item.feature).all():
            raise EvaluationError(f"{name}: its feature holds NaN or infinity, wanted numbers")


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + (", …" if len(names) > most else "")
