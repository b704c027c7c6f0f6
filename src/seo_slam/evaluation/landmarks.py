"""How well a map's landmarks match the objects that are there: protocol ``landmarks/1``.

Rebuilt from SEO-SLAM's Table II: a landmark is a true positive if one-to-one assignment gives it an object, else a false one;
precision = TP / landmarks, recall = TP / G. The paper does not give its matching rule; this one is stated in every result.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.false_positives import FalsePositives
from seo_slam.evaluation.labels import LabelRule
from seo_slam.evaluation.per_class import class_table
from seo_slam.evaluation.scores import (
    ENOUGH_KEYFRAMES,
    LANDMARKS_PROTOCOL,
    LandmarksResult,
    MatchedLandmark,
    MissingObject,
    RadiusScore,
)
from seo_slam.evaluation.true_objects import FormerPlace, Truth, TruthObject, reach_m
from seo_slam.geometry import FloatArray, require_transform, transform_points
from seo_slam.types import BoolArray, Landmark

__all__ = ["FormerPlace", "Truth", "TruthObject", "assign", "distances", "evaluate_landmarks", "moved"]

DEFAULT_RADIUS_M = 0.2
SWEPT_RADII_M = (0.1, 0.2, 0.3, 0.5)


def evaluate_landmarks(
    landmarks: Sequence[Landmark],
    truth: Truth,
    rule: LabelRule | None = None,
    radius_m: float = DEFAULT_RADIUS_M,
    truth_count: int | None = None,
) -> LandmarksResult:
    """Score a map, protocol ``landmarks/1``.

    Args:
        landmarks: of the map, in the true world; only those with the state "stable" count. A landmark's ``category`` names it
            as well as its ``label`` does.
        truth: what is there at the end.
        rule: when labels agree; ``exact`` by default.
        radius_m: a pair may match up to this distance, or up to half the object's smaller horizontal extent if that is more.
        truth_count: a G of the caller's own, reported beside the others (``RadiusScore.given``).

    Raises:
        EvaluationError: the truth has no objects, the radius is not above 0, or ``truth_count`` is below 1 or below what was matched.
    """
    if not truth.objects:
        raise EvaluationError("the truth has no objects; wanted at least one that is present at the end")
    if not (np.isfinite(radius_m) and radius_m > 0):
        raise EvaluationError(f"radius_m: got {radius_m}, wanted a distance above 0, in metres")
    rule = rule or LabelRule.exact()
    stable = sorted((landmark for landmark in landmarks if landmark.state == "stable"), key=lambda landmark: landmark.id)
    words = [_words(landmark) for landmark in stable]
    distance_m = distances(np.array([landmark.position_m for landmark in stable]).reshape(-1, 3), truth.objects)
    agree = np.array([[rule.agree(named, item.labels) for item in truth.objects] for named in words], dtype=np.bool_).reshape(
        distance_m.shape
    )
    radii_m = sorted({*SWEPT_RADII_M, radius_m})
    scores = {radius: _score(radius, truth, *_matches(distance_m, agree, truth, radius), truth_count) for radius in radii_m}
    allowed, pairs = _matches(distance_m, agree, truth, radius_m)
    matched_rows, matched_objects = {row for row, _ in pairs}, {column for _, column in pairs}
    matched = tuple(
        _matched(stable[row], truth.objects[column], distance_m[row, column]) for row, column in sorted(pairs, key=lambda p: p[1])
    )
    missing = tuple(
        _missing(item, stable, distance_m[:, column]) for column, item in enumerate(truth.objects) if column not in matched_objects
    )
    kinds = FalsePositives(truth, rule, radius_m)
    extra = tuple(
        kinds.sort(landmark, words[row], distance_m[row], allowed[row]) for row, landmark in enumerate(stable) if row not in matched_rows
    )
    return LandmarksResult(
        protocol=LANDMARKS_PROTOCOL,
        radius_m=radius_m,
        label_rule=rule.describe(),
        score=scores[radius_m],
        tentative=len(landmarks) - len(stable),
        sweep=tuple(scores[radius] for radius in radii_m),
        matched=matched,
        missing=missing,
        extra=extra,
        per_class=class_table(matched, missing, extra),
    )


def moved(landmarks: Sequence[Landmark], T_truth_map: FloatArray) -> tuple[Landmark, ...]:
    """Landmarks brought into another world by a rigid transform: position, covariance, and the box that holds the turned size.

    Raises:
        FrameError: ``T_truth_map`` is not a rigid (4, 4) transform.
    """
    T = require_transform(T_truth_map, "T_truth_map")
    R = T[:3, :3]
    return tuple(
        replace(
            landmark,
            position_m=transform_points(T, landmark.position_m),
            covariance_m2=R @ landmark.covariance_m2 @ R.T,
            size_m=np.abs(R) @ landmark.size_m,
        )
        for landmark in landmarks
    )


def distances(p_world: FloatArray, objects: Sequence[TruthObject]) -> FloatArray:
    """Metres (N, M) from points (N, 3) to the nearest centre of each of M objects."""
    columns = [np.linalg.norm(p_world[:, None] - item.centers_m[None], axis=2).min(axis=1) for item in objects]
    return np.stack(columns, axis=1) if columns else np.zeros((len(p_world), 0))


def assign(distance_m: FloatArray, allowed: BoolArray) -> list[tuple[int, int]]:
    """Pair rows with columns one-to-one: as many allowed pairs as possible, and of those the least sum of distances.

    Args:
        distance_m: (N, M).
        allowed: (N, M), which pairs may match.

    Returns:
        ``(row, column)`` of each match, by rising row.
    """
    if not allowed.any():
        return []
    # One forbidden pair costs more than all allowed ones together, so the count comes before the distance.
    forbidden = 1.0 + float(distance_m[allowed].max()) * min(distance_m.shape)
    rows, columns = linear_sum_assignment(np.where(allowed, distance_m, forbidden))
    return [(int(row), int(column)) for row, column in zip(rows, columns, strict=True) if allowed[row, column]]


def _words(landmark: Landmark) -> tuple[str, ...]:
    return tuple(word for word in (landmark.label, landmark.category) if word)


def _matches(distance_m: FloatArray, agree: BoolArray, truth: Truth, radius_m: float) -> tuple[BoolArray, list[tuple[int, int]]]:
    reaches_m = np.array([reach_m(item, radius_m) for item in truth.objects])
    allowed = np.asarray((distance_m <= reaches_m) & agree, dtype=np.bool_)
    return allowed, assign(distance_m, allowed)


def _score(radius_m: float, truth: Truth, allowed: BoolArray, pairs: Sequence[tuple[int, int]], truth_count: int | None) -> RadiusScore:
    if truth_count is not None and truth_count < max(len(pairs), 1):
        raise EvaluationError(
            f"truth_count: got {truth_count}, wanted at least 1, and at least the {len(pairs)} objects matched within {radius_m:g} m"
        )
    seen = [item.visible_keyframes for item in truth.objects]
    visible = None
    if all(count is not None for count in seen):
        visible = frozenset(column for column, count in enumerate(seen) if (count or 0) >= ENOUGH_KEYFRAMES)
    return RadiusScore(
        landmarks=len(allowed),
        objects=len(truth.objects),
        matched=len(pairs),
        radius_m=radius_m,
        visible_objects=None if visible is None else len(visible),
        visible_matched=None if visible is None else sum(column in visible for _, column in pairs),
        given_objects=truth_count,
    )


def _matched(landmark: Landmark, item: TruthObject, distance_m: float) -> MatchedLandmark:
    return MatchedLandmark(landmark.id, landmark.label, item.id, item.labels[0], float(distance_m))


def _missing(item: TruthObject, stable: Sequence[Landmark], distance_m: FloatArray) -> MissingObject:
    if not stable:
        return MissingObject(item.id, item.labels[0])
    row = int(np.argmin(distance_m))
    return MissingObject(item.id, item.labels[0], stable[row].id, stable[row].label, float(distance_m[row]))
