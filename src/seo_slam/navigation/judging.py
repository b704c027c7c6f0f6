"""Which matches a search trusts (DualMap IV-C)."""

from collections.abc import Sequence

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor
from seo_slam.abstraction.room_finding import room_of
from seo_slam.geometry import FloatArray
from seo_slam.navigation.local_match import Match, center_of, is_at, ranked, stood_beside
from seo_slam.navigation.outcomes import Candidate
from seo_slam.navigation.query import Query, room_ids
from seo_slam.navigation.senses import Senses
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.types import Landmark

_BESIDE_M = 0.1  # a footprint's edge is not known better
_NEXT_TO_M = 0.5  # what stood next to an anchor is looked for beside it
_SAME_THING_M = 0.3
_SAME_PLACE_M = 0.1


class Judge:
    """Weighs what was seen in a search against what was asked for.

    A match is confident if it was seen often enough, is at the anchor that was gone to, and scores at least what the first candidate did
    less the margin; the first candidate's score stays the measure through all attempts (the paper), so that a search does not
    settle for less and less. Nothing below ``least_score`` is a match, and ``enough_score`` is always enough.

    A match elsewhere is clear if it scores so too and at least ``clear_score``, has a word, was seen more often and from near, and is in
    the room that was named, if one was. The
    thing is likeliest where the map has it, and a look-alike met on the way is not: so by default clear matches count only after
    the first candidate has turned out wrong.

    Attributes:
        required: score of a match.
        is_known: the map has, and trusts, something like what was asked for.
        rejected: landmarks that need not be gone to again.
    """

    def __init__(
        self, query: Query, feature: FloatArray, first_score: float, senses: Senses, settings: NavigationSettings, trusted: bool = True
    ) -> None:
        """Take the query with its feature (D,), the first candidate's score, and whether that is of something the map trusts."""
        self.required = max(min(first_score - settings.margin, settings.enough_score), settings.least_score)
        self.is_known = trusted and first_score >= settings.least_score
        self.rejected: set[int] = set()
        self._refuted: list[FloatArray] = []
        self._query = query
        self._feature = feature
        self._senses = senses
        self._settings = settings

    def best_at(self, anchor: Anchor, candidate: Candidate | None = None) -> Match | None:
        """Return what is most like the query at an anchor, confident or not; None if nothing was seen there."""
        at = [row for row in self._senses.landmarks if self._is_at(row, anchor, candidate)]
        rows = ranked(self._open(at), self._feature)
        often = [row for row in rows if self._senses.observations(row.landmark) >= self._settings.local_observations]
        return next(iter(often or rows), None)

    def confident_at(self, anchor: Anchor, candidate: Candidate | None = None) -> Match | None:
        """Return the confident match at an anchor, if there is one."""
        for row in ranked(self._open(self._senses.landmarks), self._feature):
            if row.score < self.required:
                break
            if self._holds(row, self._settings.local_observations) and self._is_at(row.landmark, anchor, candidate):
                return row
        return None

    def clear(self, abstract_map: AbstractMap) -> Match | None:
        """Return the best clear match anywhere, if there is one."""
        for row in ranked(self._open(self._senses.landmarks), self._feature):
            near = self._senses.nearest_m(row.landmark) <= self._settings.clear_range_m
            if near and self._holds(row, self._settings.clear_observations) and self._is_wanted(row, abstract_map):
                return row
        return None

    def glimpse(self, abstract_map: AbstractMap) -> Match | None:
        """Return what would be a clear match, had it been seen more often, from nearer, or not been dropped since; if there is one."""
        forgotten = [row for row in self._senses.forgotten if not self._is_where_one_was_rejected(row)]
        rows = ranked(self._open((*self._senses.landmarks, *forgotten)), self._feature)
        return next((row for row in rows if self._holds(row, 1) and self._is_wanted(row, abstract_map)), None)

    def best(self) -> Match | None:
        """Return what is most like the query of all that was seen."""
        return next(iter(ranked((*self._senses.landmarks, *self._senses.forgotten), self._feature)), None)

    def again(self, match: Match, in_view: bool = True) -> Match | None:
        """Return a match as the map has it by now: the same landmark, or the one in its place that fits best; None if it fits no more.

        A score that only wobbles about ``required`` with the last few looks does not undo a match: half the margin is allowed for it. What
        the mapper has dropped is no match any more, unless it is not ``in_view`` from where the robot stopped.
        """
        least = max(self.required - 0.5 * self._settings.margin, self._settings.least_score)
        place = center_of(match.landmark)
        rows = ranked(self._senses.landmarks, self._feature)
        here = [row for row in rows if row.landmark.id == match.landmark.id]
        if not here:
            near = [row for row in rows if np.linalg.norm(center_of(row.landmark) - place) <= _SAME_THING_M]
            dropped = [] if in_view else ranked([row for row in self._senses.forgotten if row.id == match.landmark.id], self._feature)
            here = [*near, *dropped]
        return next((row for row in here if row.score >= least), None)

    def _is_at(self, landmark: Landmark, anchor: Anchor, candidate: Candidate | None) -> bool:
        beside_m = _NEXT_TO_M if candidate is not None and stood_beside(anchor, candidate) else _BESIDE_M
        return is_at(landmark, anchor, self._settings.box_growth, beside_m)

    def refute(self, match: Match) -> None:
        """Take it that a match is something else, seen from right before it: also when the mapper drops it, and finds it again."""
        self.rejected.add(match.landmark.id)
        self._refuted.append(center_of(match.landmark))

    def _open(self, landmarks: Sequence[Landmark]) -> list[Landmark]:
        """Those that may still be what was asked for."""
        rows = [row for row in landmarks if row.id not in self.rejected]
        return [row for row in rows if all(np.linalg.norm(center_of(row) - place) > _SAME_PLACE_M for place in self._refuted)]

    def _is_where_one_was_rejected(self, landmark: Landmark) -> bool:
        """Whether a closer look was taken at its place already: a mapper that drops and finds again gives new ids."""
        rejected = [row for row in (*self._senses.landmarks, *self._senses.forgotten) if row.id in self.rejected]
        return any(np.linalg.norm(center_of(row) - center_of(landmark)) <= _SAME_THING_M for row in rejected)

    def _holds(self, match: Match, observations: int) -> bool:
        return match.score >= self.required and self._senses.observations(match.landmark) >= observations

    def _is_wanted(self, match: Match, abstract_map: AbstractMap) -> bool:
        """Whether something elsewhere than at a candidate is named and scores well enough, and is in the room that was named."""
        if match.score < self._settings.clear_score or not match.landmark.label:
            return False
        if self._query.room is None or abstract_map.layout is None:
            return True
        xy_world = center_of(match.landmark)[None, :2]
        return room_of(abstract_map.layout, xy_world) in room_ids(abstract_map.rooms, self._query.room)
