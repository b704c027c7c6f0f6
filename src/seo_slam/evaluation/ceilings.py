"""What a map could score at best: the ceilings that ``landmarks/1`` reports beside a map, and how far a variant gets towards them.

Both are computed on a given map: they say what better labels, and a perfect judge of its landmarks, could make of it.
"""

from collections.abc import Sequence
from dataclasses import replace

from seo_slam.evaluation.labels import LabelRule
from seo_slam.evaluation.landmarks import DEFAULT_RADIUS_M, Truth, evaluate_landmarks
from seo_slam.evaluation.per_class import class_table
from seo_slam.evaluation.scores import LandmarksResult, RadiusScore
from seo_slam.types import Landmark

ORACLE = "oracle (every label right, doubles folded, false landmarks dropped)"


def geometry_ceiling(landmarks: Sequence[Landmark], truth: Truth, radius_m: float = DEFAULT_RADIUS_M) -> LandmarksResult:
    """Score a map with labels ignored; the arguments are those of ``evaluate_landmarks``.

    Raises:
        EvaluationError: as ``evaluate_landmarks`` does.
    """
    return evaluate_landmarks(landmarks, truth, LabelRule.geometry(), radius_m)


def oracle_ceiling(landmarks: Sequence[Landmark], truth: Truth, radius_m: float = DEFAULT_RADIUS_M) -> LandmarksResult:
    """Score a map as a perfect judge would leave it: every label right, doubles folded, false landmarks dropped.

    Precision is 1 (0 if nothing matches), recall is that of ``geometry_ceiling``: no judge adds what was never mapped.
    The arguments are those of ``evaluate_landmarks``.

    Raises:
        EvaluationError: as ``evaluate_landmarks`` does.
    """
    found = geometry_ceiling(landmarks, truth, radius_m)
    return replace(
        found,
        label_rule=ORACLE,
        score=_only_matched(found.score),
        sweep=tuple(_only_matched(row) for row in found.sweep),
        extra=(),
        per_class=class_table(found.matched, found.missing, ()),
    )


def share_of_way(base_f1: float, f1: float, oracle_f1: float) -> float | None:
    """Return which share of the way from a base to the oracle a variant wins: 0 at the base, 1 at the oracle.

    It is negative if the variant is worse than the base, and None if the base is as good as the oracle: there is no way to go.
    """
    return (f1 - base_f1) / (oracle_f1 - base_f1) if oracle_f1 > base_f1 else None


def _only_matched(score: RadiusScore) -> RadiusScore:
    return replace(score, landmarks=score.matched)
