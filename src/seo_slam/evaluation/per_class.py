"""What became of each class of objects: the per-class table of ``landmarks/1``."""

from collections import Counter
from collections.abc import Iterable, Sequence

from seo_slam.evaluation.scores import ClassScore, ExtraLandmark, MatchedLandmark, MissingObject


def class_table(
    matched: Iterable[MatchedLandmark], missing: Iterable[MissingObject], extra: Sequence[ExtraLandmark]
) -> tuple[ClassScore, ...]:
    """Count by class, in alphabetical order; landmarks that name no class of the truth come last, in a row labelled None.

    A match counts under its object's class whatever the landmark is called; so do duplicates and ghosts. A false landmark counts under
    the class that its category names, or else its label. A class may have no objects left: all of them were removed.
    """
    found = Counter(pair.object_label for pair in matched)
    lost = Counter(item.object_label for item in missing)
    kinds = Counter((item.object_label, item.kind) for item in extra)
    labels = {*found, *lost, *(item.object_label for item in extra)}
    return tuple(
        ClassScore(
            label=label,
            objects=found.get(label or "", 0) + lost.get(label or "", 0),
            matched=found.get(label or "", 0),
            missing=lost.get(label or "", 0),
            duplicates=kinds[label, "duplicate"],
            ghosts=kinds[label, "ghost"],
            false=kinds[label, "false"],
        )
        for label in sorted(labels, key=lambda label: (label is None, label or ""))
    )
