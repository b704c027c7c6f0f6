"""What an evaluation of landmarks returns."""

from dataclasses import asdict, dataclass
from typing import Any

LANDMARKS_PROTOCOL = "landmarks/1"
ENOUGH_KEYFRAMES = 5
"""An object seen in fewer keyframes does not belong to those in view."""


@dataclass(frozen=True, slots=True)
class Score:
    """Counts of one matching against one G.

    Attributes:
        landmarks: those that count.
        objects: G, the objects that count.
        matched: true positives.
    """

    landmarks: int
    objects: int
    matched: int

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
        """Matched share of G; 0 where G is."""
        return self.matched / self.objects if self.objects else 0.0

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall: ``2 TP / (landmarks + G)``; 0 where there is nothing at all."""
        return 2 * self.matched / (self.landmarks + self.objects) if self.landmarks + self.objects else 0.0

    def as_dict(self) -> dict[str, Any]:
        """The counts and ratios as JSON types."""
        counts = {"landmarks": self.landmarks, "objects": self.objects, "matched": self.matched}
        ratios = {"precision": self.precision, "recall": self.recall, "f1": self.f1}
        return counts | ratios | {"false_positives": self.false_positives}


@dataclass(frozen=True, slots=True)
class RadiusScore(Score):
    """Counts at one matching radius; ``landmarks``, ``objects`` and ``matched`` are those of all objects present at the end.

    Attributes:
        radius_m: see ``evaluate_landmarks``.
        visible_objects: how many objects were in view for at least five keyframes; None where the truth does not say.
        visible_matched: how many of those were matched.
        given_objects: G as the caller gave it; None where he gave none.
    """

    radius_m: float
    visible_objects: int | None = None
    visible_matched: int | None = None
    given_objects: int | None = None

    @property
    def visible(self) -> Score | None:
        """The score of the objects in view for at least five keyframes; None where the truth does not say.

        A landmark matched with an object seen less often is neither right nor wrong: it is left out of ``landmarks``. A second landmark on
        such an object still counts as false.
        """
        if self.visible_objects is None or self.visible_matched is None:
            return None
        set_aside = self.matched - self.visible_matched
        return Score(self.landmarks - set_aside, self.visible_objects, self.visible_matched)

    @property
    def given(self) -> Score | None:
        """The score against the G that the caller gave; None where he gave none."""
        return None if self.given_objects is None else Score(self.landmarks, self.given_objects, self.matched)

    def as_dict(self) -> dict[str, Any]:
        """The counts and ratios as JSON types, for each G."""
        return {
            "radius_m": self.radius_m,
            **Score.as_dict(self),
            "visible_objects": self.visible_objects,
            "visible_matched": self.visible_matched,
            "visible": self.visible.as_dict() if self.visible else None,
            "given": self.given.as_dict() if self.given else None,
        }


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
        object_label: the class it is counted under: that of the object ``of``; for "false" the class that its own label names; None
            if it names none.
    """

    landmark_id: int
    label: str
    position_m: tuple[float, float, float]
    kind: str
    of: str | None
    nearest_object_id: str
    nearest_m: float
    object_label: str | None = None


@dataclass(frozen=True, slots=True)
class ClassScore:
    """What became of one class of objects.

    Attributes:
        label: the class, first of its objects' labels; None for landmarks whose label names no class of the truth.
        objects: present at the end.
        matched, missing: with and without a landmark.
        duplicates, ghosts, false: landmarks without an object, see ``ExtraLandmark``.
    """

    label: str | None
    objects: int
    matched: int
    missing: int
    duplicates: int
    ghosts: int
    false: int

    @property
    def landmarks(self) -> int:
        """All landmarks counted under this class."""
        return self.matched + self.duplicates + self.ghosts + self.false


@dataclass(frozen=True, slots=True)
class LandmarksResult:
    """The score of a map, protocol ``landmarks/1``.

    Attributes:
        protocol, radius_m, label_rule: how it was scored.
        score: counts at ``radius_m``.
        tentative: landmarks left out since they are not stable (tentative or lost).
        sweep: counts at 0.1, 0.2, 0.3 and 0.5 m, and at ``radius_m``.
        matched, missing, extra: who, one by one.
        per_class: what became of each class; the sums of its columns are those of the score.
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
    per_class: tuple[ClassScore, ...] = ()

    @property
    def duplicates(self) -> int:
        """Further landmarks on objects that are matched already."""
        return sum(item.kind == "duplicate" for item in self.extra)

    @property
    def ghosts(self) -> int:
        """Landmarks of objects that were removed or moved away."""
        return sum(item.kind == "ghost" for item in self.extra)

    @property
    def false(self) -> int:
        """Landmarks without an object that are neither duplicate nor ghost."""
        return len(self.extra) - self.duplicates - self.ghosts

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
            "visible_counts": f"objects in view for {ENOUGH_KEYFRAMES} keyframes or more",
            **score,
            "duplicates": self.duplicates,
            "ghosts": self.ghosts,
            "false": self.false,
            "tentative_left_out": self.tentative,
            "sweep": [item.as_dict() for item in self.sweep],
            "per_class": [asdict(item) | {"landmarks": item.landmarks} for item in self.per_class],
            "matched_list": [asdict(item) for item in self.matched],
            "missing_list": [asdict(item) for item in self.missing],
            "extra_list": [asdict(item) for item in self.extra],
        }
