"""The next candidate of a search, by the strategy that is set (DualMap IV-C, Table V)."""

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor
from seo_slam.errors import NoPathError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.choosing import Option, most_learned
from seo_slam.navigation.judging import Judge
from seo_slam.navigation.looking import shows_its_top
from seo_slam.navigation.memory import Memory
from seo_slam.navigation.motion import path_length_m
from seo_slam.navigation.outcomes import Candidate
from seo_slam.navigation.query import Query, candidates
from seo_slam.navigation.senses import Senses
from seo_slam.navigation.ways import Ways
from seo_slam.settings.navigation import NavigationSettings


class Selection:
    """Chooses where to go.

    Strategy "updated" takes the best anchor of the map as updated on the way, if it scores like the first candidate. If none does, the
    setting ``next_candidate`` says: "highest", the best all the same (the paper); "same_class", the best of the first candidate's word if
    there is one left (the public code); "learn", see ``choosing.most_learned``, and anchors seen well on the way without a match on
    them are left for the end, as are those that carried nothing and are so high that the robot sees nothing on them. So it is from the
    start with a thing that the map does not know. "original" takes the best left of the map as it was, "random" any; both learn nothing
    on the way.
    """

    def __init__(
        self,
        query: Query,
        feature: FloatArray,
        memory: Memory,
        judge: Judge,
        senses: Senses,
        ways: Ways,
        settings: NavigationSettings,
        seed: int,
    ) -> None:
        """Take what a search is made of."""
        self._query = query
        self._feature = feature
        self._memory = memory
        self._judge = judge
        self._senses = senses
        self._ways = ways
        self._settings = settings
        self._first = candidates(memory.original, feature, room=query.room)
        draws = np.random.default_rng([seed, *query.text.encode(errors="surrogatepass")])
        self._shuffled = tuple(self._first[int(k)] for k in draws.permutation(len(self._first)))

    def next(self) -> Candidate | None:
        """Return the next candidate; None if there is none left."""
        tried = self._memory.tried_ids
        if self._settings.strategy != "updated":
            order = self._first if self._settings.strategy == "original" else self._shuffled
            return next((candidate for candidate in order if candidate.anchor_id not in tried), None)
        left = candidates(self._memory.map, self._feature, tried, self._query.room)
        if not left or (not tried and self._judge.is_known):
            return next(iter(left), None)
        return self._after_the_first(left)

    def _after_the_first(self, left: tuple[Candidate, ...]) -> Candidate:
        rule = self._settings.next_candidate
        if rule == "learn":
            left = tuple(candidate for candidate in left if not self._was_seen_empty(candidate)) or left
        if rule == "highest" or left[0].score >= self._judge.required:
            return left[0]
        if rule == "same_class":
            word = self._word_of(self._first[0])
            return next((candidate for candidate in left if self._word_of(candidate) == word), left[0])
        shown = tuple(candidate for candidate in left if self._may_show_something(candidate)) or left
        options = [option for candidate in shown if (option := self._option(candidate)) is not None]
        if not options:
            return left[0]
        seen = {option.anchor.id: self._senses.coverage.seen_share(option.anchor.id) for option in options}
        return most_learned(options, seen, self._settings.look_range_m, self._settings.travel_m).candidate

    def _was_seen_empty(self, candidate: Candidate) -> bool:
        anchor = self._memory.anchor(candidate.anchor_id)
        seen = self._senses.coverage.seen_share(anchor.id) >= self._settings.seen_share
        return seen and self._judge.confident_at(anchor, candidate) is None

    def _may_show_something(self, candidate: Candidate) -> bool:
        """Whether there is something to be learned at it: it carried things, or the robot can see its top."""
        anchor = self._memory.anchor(candidate.anchor_id)
        return bool(anchor.volatiles) or shows_its_top(anchor, self._senses.eye)

    def _option(self, candidate: Candidate) -> Option | None:
        anchor: Anchor = self._memory.anchor(candidate.anchor_id)
        try:
            path = self._ways.to_see(anchor, self._senses.eye, self._senses.stance.xy_world)
        except NoPathError:
            return None
        return Option(candidate, anchor, path[-1], path_length_m(path))

    def _word_of(self, candidate: Candidate) -> str:
        return next((a.label for m in (self._memory.map, self._memory.original) for a in m.anchors if a.id == candidate.anchor_id), "")
