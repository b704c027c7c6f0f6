"""What an evaluation of landmarks returns."""

from dataclasses import asdict, dataclass
from typing import Any

LANDMARKS_PROTOCOL = "landmarks/1"


@dataclass(frozen=True, slots=True)
class RadiusScore:
    """Counts at one matching radius.

    Attributes:
        radius_m: see ``evaluate_landmarks``.
        landmarks: stable landmarks of the map.
        objects: G, the objects present at the end.
        matched: true positives.
        visible_objects: G of the objects that were in view for at least five keyframes; None where the truth does not say.
        visible_matched: how many of those were matched.
    """

    radius_m: float
    landmarks: int
    objects: int
    matched: int
    visible_objects: int | None = None
    visible_matched: int | None = None

    @property
    def false_positives(self) -> int:
        """Landmarks without an object."""
        return self.landmarks - self.matched

    @property
    def precision(self) -> float:
        """Matched share of the landmarks; 0 for an empty map."""
        return self.matched / self.landmarks if self.landmarks else 0.0

    @property
    def recall(self) -> float:
        """Matched share of G."""
        return self.matched / self.objects

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall: ``2 TP / (landmarks + G)``."""
        return 2 * self.matched / (self.landmarks + self.objects)

    def as_dict(self) -> dict[str, Any]:
        """The counts and ratios as JSON types."""
        ratios = {"precision": self.precision, "recall": self.recall, "f1": self.f1, "false_positives": self.false_positives}
        return asdict(self) | ratios


@dataclass(frozen=True, slots=True)
class MatchedLandmark:
    """A landmark and the object it was given; distance in metres to the object's nearer centre."""

    landmark_id: int
    label: str
    object_id: str
    object_label: str
    distance_m: float


@dataclass(frozen=True, slots=True)
class MissingObject:
    """An object without a landmark, and the stable landmark nearest to it, whatever its label (None in an empty map)."""

    object_id: str
    object_label: str
    nearest_landmark_id: int | None = None
    nearest_label: str | None = None
    nearest_m: float | None = None


@dataclass(frozen=True, slots=True)
class ExtraLandmark:
    """A landmark without an object.

    Attributes:
        landmark_id, label, position_m: of the landmark, true world.
        kind: "duplicate" (its object has another landmark already), "ghost" (of an object that was removed or moved away) or
            "false" (neither; where the truth is not a full list, it may still be right).
        of: id of the object it doubles or is the ghost of; None for "false".
        nearest_object_id, nearest_m: the nearest true object, whatever its label.
    """

    landmark_id: int
    label: str
    position_m: tuple[float, float, float]
    kind: str
    of: str | None
    nearest_object_id: str
    nearest_m: float


@dataclass(frozen=True, slots=True)
class LandmarksResult:
    """The score of a map, protocol ``landmarks/1``.

    Attributes:
        protocol, radius_m, label_rule: how it was scored.
        score: counts at ``radius_m``.
        tentative: landmarks left out since they are not stable.
        sweep: counts at 0.1, 0.2, 0.3 and 0.5 m, and at ``radius_m``.
        matched, missing, extra: who, one by one.
    """

    protocol: str
    radius_m: float
    label_rule: str
    score: RadiusScore
    tentative: int
    sweep: tuple[RadiusScore, ...]
    matched: tuple[MatchedLandmark, ...]
    missing: tuple[MissingObject, ...]
    extra: tuple[ExtraLandmark, ...]

    @property
    def duplicates(self) -> int:
        """Further landmarks on objects that are matched already."""
        return sum(item.kind == "duplicate" for item in self.extra)

    @property
    def ghosts(self) -> int:
        """Landmarks of objects that were removed or moved away."""
        return sum(item.kind == "ghost" for item in self.extra)

    def as_dict(self) -> dict[str, Any]:
        """The result as JSON types."""
        score = self.score.as_dict()
        del score["radius_m"]
        return {
            "protocol": self.protocol,
            "radius_m": self.radius_m,
            "label_rule": self.label_rule,
            "G": self.score.objects,
            "G_counts": "objects present when the recording ends",
            "landmarks_count": "stable ones",
            **score,
            "duplicates": self.duplicates,
            "ghosts": self.ghosts,
            "tentative_left_out": self.tentative,
            "sweep": [item.as_dict() for item in self.sweep],
            "matched_list": [asdict(item) for item in self.matched],
            "missing_list": [asdict(item) for item in self.missing],
            "extra_list": [asdict(item) for item in self.extra],
        }
