"""How well a map's landmarks match the objects that are there: protocol ``landmarks/1``.

Rebuilt from SEO-SLAM's Table II: a landmark is a true positive if one-to-one assignment gives it an object, else a false one;
precision = TP / landmarks, recall = TP / G. The paper does not give its matching rule; this one is stated in every result.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.labels import LabelRule
from seo_slam.evaluation.scores import (
    LANDMARKS_PROTOCOL,
    ExtraLandmark,
    LandmarksResult,
    MatchedLandmark,
    MissingObject,
    RadiusScore,
)
from seo_slam.geometry import FloatArray, require_transform, transform_points
from seo_slam.types import BoolArray, Landmark

DEFAULT_RADIUS_M = 0.2
SWEPT_RADII_M = (0.1, 0.2, 0.3, 0.5)
_ENOUGH_KEYFRAMES = 5


@dataclass(frozen=True, slots=True, eq=False)
class TruthObject:
    """An object that is there when the recording ends.

    Attributes:
        id: its name in the truth.
        labels: all words that count as right.
        centers_m: (C, 3) its centres in the true world (of the box, of the visible surface); the nearest one counts.
        half_extent_m: half the smaller horizontal extent; 0 where no box is known.
        visible_keyframes: in how many keyframes it was in view; None where unknown.
    """

    id: str
    labels: tuple[str, ...]
    centers_m: FloatArray
    half_extent_m: float = 0.0
    visible_keyframes: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FormerPlace:
    """A place named by the timeline. Where the object is not there (any more) at the end, a landmark there is a ghost.

    Attributes:
        id: the object's.
        event: "removed", "moved" or "added".
        labels: the object's; empty where unknown, and then any label counts.
        center_m: (3,) in the true world.
        half_extent_m: as for ``TruthObject``.
    """

    id: str
    event: str
    labels: tuple[str, ...]
    center_m: FloatArray
    half_extent_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The objects present at the end, and the places that the timeline names."""

    objects: tuple[TruthObject, ...]
    places: tuple[FormerPlace, ...] = ()


def evaluate_landmarks(
    landmarks: Sequence[Landmark],
    truth: Truth,
    rule: LabelRule | None = None,
    radius_m: float = DEFAULT_RADIUS_M,
) -> LandmarksResult:
    """Score a map, protocol ``landmarks/1``.

    Args:
        landmarks: of the map, in the true world; only those with the state "stable" count. A landmark with an attribute
            ``category`` is known by it, too.
        truth: what is there at the end.
        rule: when labels agree; ``exact`` by default.
        radius_m: a pair may match up to this distance, or up to half the object's smaller horizontal extent if that is more.

    Raises:
        EvaluationError: the truth has no objects, or the radius is not above 0.
    """
    if not truth.objects:
        raise EvaluationError("the truth has no objects; wanted at least one that is present at the end")
    if not (np.isfinite(radius_m) and radius_m > 0):
        raise EvaluationError(f"radius_m: got {radius_m}, wanted a distance above 0, in metres")
    rule = rule or LabelRule.exact()
    stable = [landmark for landmark in landmarks if landmark.state == "stable"]
    words = [_words(landmark) for landmark in stable]
    distance_m = distances(np.array([landmark.position_m for landmark in stable]).reshape(-1, 3), truth.objects)
    agree = np.array([[rule.agree(named, item.labels) for item in truth.objects] for named in words], dtype=np.bool_).reshape(
        distance_m.shape
    )
    allowed, pairs = _matches(distance_m, agree, truth, radius_m)
    matched_rows, matched_objects = {row for row, _ in pairs}, {column for _, column in pairs}
    former = [place for place in truth.places if not _still_there(place, truth.objects, radius_m)]
    extra = tuple(
        _extra(landmark, words[row], truth, former, distance_m[row], allowed[row], rule, radius_m)
        for row, landmark in enumerate(stable)
        if row not in matched_rows
    )
    return LandmarksResult(
        protocol=LANDMARKS_PROTOCOL,
        radius_m=radius_m,
        label_rule=rule.describe(),
        score=_score(radius_m, len(stable), truth, pairs),
        tentative=len(landmarks) - len(stable),
        sweep=tuple(
            _score(radius, len(stable), truth, _matches(distance_m, agree, truth, radius)[1])
            for radius in sorted({*SWEPT_RADII_M, radius_m})
        ),
        matched=tuple(
            _matched(stable[row], truth.objects[column], distance_m[row, column]) for row, column in sorted(pairs, key=lambda p: p[1])
        ),
        missing=tuple(
            _missing(item, stable, distance_m[:, column]) for column, item in enumerate(truth.objects) if column not in matched_objects
        ),
        extra=extra,
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
    return tuple(word for word in (landmark.label, getattr(landmark, "category", None)) if word)


def _matches(distance_m: FloatArray, agree: BoolArray, truth: Truth, radius_m: float) -> tuple[BoolArray, list[tuple[int, int]]]:
    reach_m = np.array([max(radius_m, item.half_extent_m) for item in truth.objects])
    allowed = np.asarray((distance_m <= reach_m) & agree, dtype=np.bool_)
    return allowed, assign(distance_m, allowed)


def _score(radius_m: float, landmarks: int, truth: Truth, pairs: list[tuple[int, int]]) -> RadiusScore:
    seen = [item.visible_keyframes for item in truth.objects]
    visible = None
    if all(count is not None for count in seen):
        visible = frozenset(column for column, count in enumerate(seen) if (count or 0) >= _ENOUGH_KEYFRAMES)
    return RadiusScore(
        radius_m=radius_m,
        landmarks=landmarks,
        objects=len(truth.objects),
        matched=len(pairs),
        visible_objects=None if visible is None else len(visible),
        visible_matched=None if visible is None else sum(column in visible for _, column in pairs),
    )


def _still_there(place: FormerPlace, objects: Sequence[TruthObject], radius_m: float) -> bool:
    """Whether the place named by an event is where that object is at the end."""
    point = place.center_m.reshape(1, 3)
    return any(float(distances(point, [item])[0, 0]) <= max(radius_m, item.half_extent_m) for item in objects if item.id == place.id)


def _extra(
    landmark: Landmark,
    words: tuple[str, ...],
    truth: Truth,
    former: Sequence[FormerPlace],
    distance_m: FloatArray,
    allowed: BoolArray,
    rule: LabelRule,
    radius_m: float,
) -> ExtraLandmark:
    nearest = int(np.argmin(distance_m))
    kind, of = "false", None
    if allowed.any():
        # Were one of these objects free, the assignment would have taken it: all are matched already.
        kind, of = "duplicate", truth.objects[int(np.argmin(np.where(allowed, distance_m, np.inf)))].id
    else:
        for place in former:
            near = float(np.linalg.norm(landmark.position_m - place.center_m)) <= max(radius_m, place.half_extent_m)
            if near and (not place.labels or rule.agree(words, place.labels)):
                kind, of = "ghost", place.id
                break
    return ExtraLandmark(
        landmark_id=landmark.id,
        label=landmark.label,
        position_m=(float(landmark.position_m[0]), float(landmark.position_m[1]), float(landmark.position_m[2])),
        kind=kind,
        of=of,
        nearest_object_id=truth.objects[nearest].id,
        nearest_m=float(distance_m[nearest]),
    )


def _matched(landmark: Landmark, item: TruthObject, distance_m: float) -> MatchedLandmark:
    return MatchedLandmark(landmark.id, landmark.label, item.id, item.labels[0], float(distance_m))


def _missing(item: TruthObject, stable: Sequence[Landmark], distance_m: FloatArray) -> MissingObject:
    if not stable:
        return MissingObject(item.id, item.labels[0])
    row = int(np.argmin(distance_m))
    return MissingObject(item.id, item.labels[0], stable[row].id, stable[row].label, float(distance_m[row]))
