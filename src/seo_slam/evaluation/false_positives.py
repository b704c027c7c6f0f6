"""What a landmark without an object is: a duplicate, a ghost or simply false; and under which class it is counted."""

from collections.abc import Sequence

import numpy as np

from seo_slam.evaluation.labels import LabelRule, normal
from seo_slam.evaluation.scores import ExtraLandmark
from seo_slam.evaluation.true_objects import FormerPlace, Truth, reach_m
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, Landmark


class FalsePositives:
    """Sorts landmarks without an object by what they are."""

    def __init__(self, truth: Truth, rule: LabelRule, radius_m: float) -> None:
        """Find the places that objects have left.

        Args:
            truth: what is there at the end.
            rule: when labels agree.
            radius_m: as for ``evaluate_landmarks``.
        """
        self._truth = truth
        self._rule = rule
        self._radius_m = radius_m
        self._left = truth.left_places(radius_m)
        # Without labels every word would name every class: the table then goes by exact words.
        self._naming = LabelRule.exact() if rule.name == "geometry" else rule
        named = {item.labels for item in truth.objects} | {place.labels for place in truth.places}
        self._classes = {labels[0]: labels for labels in sorted(named) if labels}

    def sort(self, landmark: Landmark, words: Sequence[str], distance_m: FloatArray, allowed: BoolArray) -> ExtraLandmark:
        """Say what a landmark is.

        Args:
            landmark: one without an object.
            words: what it is called.
            distance_m: (M,) to each object.
            allowed: (M,) which objects it may match. All of them have a landmark, or the assignment would have given it one.
        """
        nearest = int(np.argmin(distance_m))
        category = (landmark.category,) if landmark.category else ()
        kind, of, label = "false", None, self._class_of(category) or self._class_of(words)
        doubled = int(np.argmin(np.where(allowed, distance_m, np.inf))) if allowed.any() else None
        ghost = self._left_place(landmark, words)
        # Like things stand close together, so that both may be possible: then the nearer place decides.
        if ghost is not None and (doubled is None or ghost[0] < distance_m[doubled]):
            place = ghost[1]
            kind, of, label = "ghost", place.id, place.labels[0] if place.labels else label
        elif doubled is not None:
            item = self._truth.objects[doubled]
            kind, of, label = "duplicate", item.id, item.labels[0]
        return ExtraLandmark(
            landmark_id=landmark.id,
            label=landmark.label,
            position_m=(float(landmark.position_m[0]), float(landmark.position_m[1]), float(landmark.position_m[2])),
            kind=kind,
            of=of,
            nearest_object_id=self._truth.objects[nearest].id,
            nearest_m=float(distance_m[nearest]),
            object_label=label,
        )

    def _left_place(self, landmark: Landmark, words: Sequence[str]) -> tuple[float, FormerPlace] | None:
        """The nearest place that an object left which the landmark may be the ghost of, and the metres to it."""
        best: tuple[float, FormerPlace] | None = None
        for place in self._left:
            gap_m = float(np.linalg.norm(landmark.position_m - place.center_m))
            agree = not place.labels or self._rule.agree(words, place.labels)
            if gap_m <= reach_m(place, self._radius_m) and agree and (best is None or gap_m < best[0]):
                best = (gap_m, place)
        return best

    def _class_of(self, words: Sequence[str]) -> str | None:
        """The class that words name: one of that very name before one that merely accepts them."""
        own = {normal(word) for word in words}
        agreeing = [name for name, labels in self._classes.items() if self._naming.agree(words, labels)]
        return min(agreeing, key=lambda name: (normal(name) not in own, name), default=None)
