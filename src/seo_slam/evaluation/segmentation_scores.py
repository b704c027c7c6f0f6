"""What an evaluation of a segmentation returns, and how several scenes are put together."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.segmentation_protocols import SegmentationProtocol
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

NO_CLASS = "(no class)"
"""What an object without feature and label is called; it is never right."""

COUNTED = {
    "predicted": "objects of the map but those that are called by a dropped class",
    "objects": "G: true things but those of dropped classes",
    "visible": "G of those that were seen well in 5 keyframes or more",
    "odr": "predicted / visible, or / objects where the truth does not say what was visible",
    "odr_objects": "predicted / objects",
    "odr_with_dropped": "all objects of the map / all true things, dropped classes included",
    "matched": "true things with a predicted object, whatever it is called; an object is the thing of the greatest intersection over union "
    "among those on which a quarter of its points or more lie",
    "duplicates": "further predicted objects on a matched thing: pieces and copies",
    "of_dropped": "predicted objects on things of dropped classes (pieces of wall that are called something else)",
    "of_nothing": "predicted objects that lie on no thing: what is not there",
    "swallowed": "missed things within 5 cm of an object of something else, which gets most of their points; nothing is near the others",
    "rightly_called": "predicted objects on a thing that are called by its class",
    "covered": "share of true points with a predicted point within 5 cm",
}
"""What the numbers of a result mean."""


@dataclass(frozen=True, slots=True)
class ObjectCounts:
    """Objects against things; ``COUNTED`` says what each number counts."""

    predicted: int
    predicted_dropped: int
    unnamed: int
    objects: int
    objects_dropped: int
    visible: int | None
    matched: int
    duplicates: int
    of_dropped: int
    of_nothing: int
    missed: int
    missed_visible: int | None
    swallowed: int
    rightly_called: int

    @property
    def odr(self) -> float | None:
        """Object density ratio (DualMap V-A2): 1 is the best. None where there is nothing to be found."""
        return _ratio(self.predicted, self.objects if self.visible is None else self.visible)

    @property
    def odr_objects(self) -> float | None:
        """The ratio to all things."""
        return _ratio(self.predicted, self.objects)

    @property
    def odr_with_dropped(self) -> float | None:
        """The ratio if dropped classes count on both sides."""
        return _ratio(self.predicted + self.predicted_dropped, self.objects + self.objects_dropped)

    def as_dict(self) -> dict[str, Any]:
        """Ratios and counts as JSON types."""
        ratios = {"odr": self.odr, "odr_objects": self.odr_objects, "odr_with_dropped": self.odr_with_dropped}
        return ratios | asdict(self)


@dataclass(frozen=True, slots=True)
class ClassRow:
    """How one class fared. ``is_dropped``: it was predicted, and its IoU is 0. ``recall`` is None without true points."""

    name: str
    is_dropped: bool
    true_points: int
    predicted_points: int
    right_points: int
    iou: float
    recall: float | None


@dataclass(frozen=True, slots=True, eq=False)
class SegmentationResult:
    """Scores of one map under one protocol.

    Attributes:
        protocol: which.
        class_names: K, the candidates; class ids are their indices.
        dropped: K, whether the protocol drops it.
        confusion: (K, K + 1) points by true and by predicted class; the last column is ``NO_CLASS``.
        called: the class of each object, K for ``NO_CLASS``.
        owners: the true thing that each object is by its points; None where it is none.
        covered: share of true points with a predicted one nearby.
        counts: objects against things.
        embedder, templates: how class names were turned into vectors.
    """

    protocol: SegmentationProtocol
    class_names: tuple[str, ...]
    dropped: tuple[bool, ...]
    confusion: IntArray = field(repr=False)
    called: tuple[int, ...] = field(repr=False)
    owners: tuple[int | None, ...] = field(repr=False)
    covered: float
    counts: ObjectCounts
    embedder: str
    templates: tuple[str, ...]

    @property
    def miou(self) -> float:
        """Mean IoU over the protocol's classes."""
        return mean_iou(self.confusion, self.protocol, self.dropped)

    @property
    def fmiou(self) -> float:
        """IoU of each class weighted by its share of the true points."""
        return weighted_iou(self.confusion)

    @property
    def macc(self) -> float:
        """Mean recall of the classes with true points."""
        return mean_recall(self.confusion)

    @property
    def per_class(self) -> tuple[ClassRow, ...]:
        """Classes of true or predicted points, in order of their ids; ``NO_CLASS`` last."""
        return class_rows(self.confusion, self.class_names, self.dropped)

    @property
    def called_by_name(self) -> tuple[str, ...]:
        """What each object is called."""
        return tuple((*self.class_names, NO_CLASS)[index] for index in self.called)

    def as_dict(self) -> dict[str, Any]:
        """Everything as JSON types."""
        names = self.class_names
        return {
            **self.protocol.as_dict(),
            "miou": self.miou,
            "fmiou": self.fmiou,
            "macc": self.macc,
            **self.counts.as_dict(),
            "covered": self.covered,
            "class_names": list(names),
            "dropped_classes": [name for name, gone in zip(names, self.dropped, strict=True) if gone],
            "per_class": [asdict(row) for row in self.per_class],
            "label_rule": "class with the greatest cosine to the object's feature; to its label where it has no feature",
            "embedder": self.embedder,
            "templates": list(self.templates),
            "counted": COUNTED,
        }


@dataclass(frozen=True, slots=True)
class SegmentationSummary:
    """Scores over several scenes, put together as the protocol says; ``odr`` and its spread are means of the scenes' values."""

    protocol: SegmentationProtocol
    scenes: int
    miou: float
    fmiou: float
    macc: float
    odr: float | None
    odr_error: float | None

    def as_dict(self) -> dict[str, Any]:
        """JSON types; ``odr_error`` is the mean of |ODR - 1|."""
        return asdict(self) | {"protocol": self.protocol.name, "aggregation": self.protocol.scenes}


def over_scenes(results: Sequence[SegmentationResult]) -> SegmentationSummary:
    """Put the scenes of one protocol together.

    Raises:
        EvaluationError: no results, or of several protocols.
    """
    protocols = {result.protocol.name: result.protocol for result in results}
    if len(protocols) != 1:
        raise EvaluationError(f"scenes: got results of {', '.join(sorted(protocols)) or 'no protocol'}, wanted those of one")
    protocol = results[0].protocol
    if protocol.scenes == "confusion":
        total, dropped = _summed(results)
        scores = mean_iou(total, protocol, dropped), weighted_iou(total), mean_recall(total)
    else:
        scores = (
            float(np.mean([result.miou for result in results])),
            float(np.mean([result.fmiou for result in results])),
            float(np.mean([result.macc for result in results])),
        )
    ratios = [result.counts.odr for result in results if result.counts.odr is not None]
    odr = float(np.mean(ratios)) if ratios else None
    error = float(np.mean(np.abs(np.array(ratios) - 1.0))) if ratios else None
    return SegmentationSummary(protocol, len(results), *scores, odr, error)


def mean_iou(confusion: IntArray, protocol: SegmentationProtocol, dropped: Sequence[bool]) -> float:
    """Mean IoU over the true classes, or over true and predicted ones; dropped ones are 0 there, and so is ``NO_CLASS``."""
    rows = class_rows(confusion, [""] * len(confusion), dropped)
    counted = [row.iou for row in rows if protocol.mean_over == "union" or row.true_points]
    return float(np.mean(counted))


def weighted_iou(confusion: IntArray) -> float:
    """FmIoU: the sum over classes of share of true points times IoU."""
    true = confusion.sum(axis=1)
    return float((true / true.sum() * _ious(confusion)).sum())


def mean_recall(confusion: IntArray) -> float:
    """Mean over classes with true points of the share that is right: mAcc."""
    true = confusion.sum(axis=1)
    there = true > 0
    return float((confusion.diagonal()[there] / true[there]).mean())


def class_rows(confusion: IntArray, names: Sequence[str], dropped: Sequence[bool]) -> tuple[ClassRow, ...]:
    """Return a row for each class that has true or predicted points."""
    true, predicted, right = confusion.sum(axis=1), confusion.sum(axis=0), confusion.diagonal()
    ious = _ious(confusion)
    rows = [
        ClassRow(
            name=names[k],
            is_dropped=bool(dropped[k]),
            true_points=int(true[k]),
            predicted_points=int(predicted[k]),
            right_points=int(right[k]),
            iou=float(ious[k]),
            recall=float(right[k] / true[k]) if true[k] else None,
        )
        for k in np.flatnonzero((true > 0) | (predicted[:-1] > 0)).tolist()
    ]
    if predicted[-1]:
        rows.append(ClassRow(NO_CLASS, False, 0, int(predicted[-1]), 0, 0.0, None))
    return tuple(rows)


def _ious(confusion: IntArray) -> FloatArray:
    right = confusion.diagonal()
    union = confusion.sum(axis=1) + confusion.sum(axis=0)[:-1] - right
    return np.asarray(np.divide(right, union, out=np.zeros(len(right)), where=union > 0), dtype=np.float64)


def _summed(results: Sequence[SegmentationResult]) -> tuple[IntArray, tuple[bool, ...]]:
    """Confusion of all scenes, classes joined by name."""
    names = sorted({name for result in results for name in result.class_names})
    total = np.zeros((len(names), len(names) + 1), dtype=np.int64)
    for result in results:
        place = np.array([names.index(name) for name in result.class_names], dtype=np.int64)
        total[np.ix_(place, np.append(place, len(names)))] += result.confusion
    return total, tuple(results[0].protocol.drops(name) for name in names)


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None
