"""One search for one thing, from the first look around to the outcome (DualMap IV-C)."""

from collections.abc import Callable, Generator

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor
from seo_slam.errors import NoPathError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.judging import Judge
from seo_slam.navigation.local_match import Match, box_of, center_of, is_at, look_at_z_m, place_of
from seo_slam.navigation.looking import all_around, heading_to, headings_over, in_sight, legs_to_look, nearest_turn
from seo_slam.navigation.memory import Memory
from seo_slam.navigation.moves import Moves, Walked
from seo_slam.navigation.outcomes import Attempt, Candidate, Command, Ending
from seo_slam.navigation.query import Query, candidates
from seo_slam.navigation.selection import Selection
from seo_slam.navigation.senses import Senses
from seo_slam.navigation.telling import in_another_room, looked_in_vain, stopped_before, taken_for
from seo_slam.navigation.ways import Ways
from seo_slam.settings.navigation import NavigationSettings

NOWHERE = -1
"""``Candidate.anchor_id`` of a match that is on no anchor."""

_APPROACHES = 2
_BLIND = 2.0  # a robot sees no floor before its feet: what it saw from where it stands begins so much farther off
_MOVED_M = 0.25  # a match whose place the map corrected by more is gone to again


class Search:
    """Goes to candidates until the thing is found or the attempts are used up.

    An attempt is a place that the robot came to: a candidate, looked at from one or more sides, or a clear match elsewhere that was gone
    to. What was not come to is logged as well and does not count: no way led there, the way was blocked, or a clear match was met on it.
    When the attempts are used up no more candidates are guessed, but a clear match that is known by then is still gone to.

    Attributes:
        attempts: so far.
        found: the match that the robot stopped at.
    """

    def __init__(
        self,
        query: Query,
        feature: FloatArray,
        judge: Judge,
        memory: Memory,
        selection: Selection,
        senses: Senses,
        ways: Ways,
        settings: NavigationSettings,
        log: Callable[[str], None],
        grow_floor: Callable[[], None] = lambda: None,
    ) -> None:
        """Take the parts of a search; ``grow_floor`` is called before the last stretch, so that it knows all floor that was seen."""
        self.attempts: list[Attempt] = []
        self.found: Match | None = None
        self.moves = Moves(senses, ways, settings)
        self._query = query
        self._feature = feature
        self._judge = judge
        self._memory = memory
        self._selection = selection
        self._senses = senses
        self._ways = ways
        self._settings = settings
        self._grow_floor = grow_floor
        self._log = log

    def commands(self) -> Generator[Command, None, tuple[Ending, str]]:
        """Yield a command a frame; return how it ended, and why. The first frame must have been taken."""
        escaped = yield from self._escape()
        if not escaped:
            xy = self._senses.stance.xy_world
            return "bad_start", f"the robot stands at ({xy[0]:.2f}, {xy[1]:.2f}), from where no free floor can be come to"
        if self._settings.look_first:
            yield from self._look_around()
        while True:
            clear = self._clear()
            if clear is not None:
                yield from self._go_to(clear)
            elif self._places_gone_to < self._most_places and (glimpse := self._glimpse()) is not None:
                yield from self._follow_up(glimpse)
            elif self._places_gone_to < self._most_places and (candidate := self._selection.next()) is not None:
                yield from self._try(candidate)
            else:
                return self._in_vain()
            if self.found is not None:
                return "found", stopped_before(self._query, self.found, self._memory.map)
            self.learn()

    def learn(self) -> None:
        """Bring what was seen into the abstract map, if the strategy does."""
        if self._settings.strategy == "updated":
            self._memory.learn(self._feature, self._judge.required)

    def _escape(self) -> Generator[Command, None, bool]:
        """Come onto the free floor; where the map knows none around, look around for some first."""
        reach_m = self._settings.escape_m
        xy = self._senses.stance.xy_world
        free = self._ways.grid.way_in(xy, reach_m)
        if free is None and self._settings.grow_floor:
            self._log("the robot stands where the map knows no floor, and looks around for some")
            for heading in all_around(self._senses.stance.yaw_rad, self._senses.eye):
                yield from self.moves.turn(heading)
            self._grow_floor()
            xy = self._senses.stance.xy_world
            free = self._ways.grid.way_in(xy, _BLIND * reach_m)
        if free is None:
            return False
        if np.linalg.norm(free - xy) > self._settings.reach_m:
            self._log("the robot stands outside the free floor and goes to the nearest of it")
            walked = yield from self.moves.walk(np.stack([xy, free]))
            return walked == "there"
        return True

    def _try(self, candidate: Candidate) -> Generator[Command, None, None]:
        anchor = self._memory.anchor(candidate.anchor_id)
        self._log(f"to the {anchor.label} {anchor.id} because of the {candidate.because} ({candidate.score:.2f})")
        try:
            path = self._ways.to_see(
                anchor,
                self._senses.eye,
                self._senses.stance.xy_world,
                z_m=look_at_z_m(anchor, candidate),
                last_seen=place_of(anchor, candidate),
            )
        except NoPathError as error:
            self._memory.done_with(anchor, looked_at=False)
            self._note(candidate, False, None, f"no path: {error}")
            return
        walked = yield from self._walk_looking(path, anchor)
        if walked == "diverted":
            self._note(candidate, False, None, "left on the way for a clear match", path)
            return
        if walked == "blocked":
            self._memory.done_with(anchor, looked_at=False)
            self._note(candidate, False, None, "no path: the way is blocked", path)
            return
        yield from self._inspect(anchor, candidate)
        reason = ""
        while (match := self._judge.confident_at(anchor, candidate)) is not None:
            _, reason = yield from self._approach(match)
            if self.found is not None:
                break
        self._memory.done_with(anchor, looked_at=self.found is None)
        self._note(candidate, True, self._judge.best_at(anchor, candidate), reason or "nothing there is what was asked for", path)

    def _walk_looking(self, path_world: FloatArray, goal: Anchor) -> Generator[Command, None, Walked]:
        """Walk to an anchor. Once it is open where the thing is, look in passing at furniture that was not seen well yet."""

        def is_over() -> bool:
            return self._clear() is not None

        if not self._settings.look_in_passing or not self._first_is_over or self._settings.strategy != "updated":
            return (yield from self.moves.walk(path_world, is_over))
        seen, senses = self._settings.seen_share, self._senses
        left = candidates(self._memory.map, self._feature, {*self._memory.tried_ids, goal.id}, self._query.room)
        anchors = [self._memory.anchor(row.anchor_id) for row in left if senses.coverage.seen_share(row.anchor_id) < seen]
        *legs, last = legs_to_look(path_world, anchors, senses.eye, self._settings.look_range_m, self._ways.layout)
        for leg in legs:
            walked = yield from self.moves.walk(leg, is_over)
            if walked != "there":
                return walked
            yield from self._look_around()
        return (yield from self.moves.walk(last, is_over))

    def _inspect(self, anchor: Anchor, candidate: Candidate) -> Generator[Command, None, None]:
        """Look at an anchor from one or more sides, then around, until there is a match on it, or a clear one elsewhere."""

        def enough() -> bool:
            return self._judge.confident_at(anchor, candidate) is not None

        before: list[FloatArray] = []
        for _ in range(self._settings.views):
            here = self._senses.stance.xy_world
            if before:
                try:
                    path = self._ways.to_see(anchor, self._senses.eye, here, before, look_at_z_m(anchor, candidate))
                except NoPathError:
                    break
                walked = yield from self.moves.walk(path, enough)
                here = self._senses.stance.xy_world
                if walked == "blocked":
                    break
            before.append(here)
            yield from self.moves.look(headings_over(anchor, here, self._senses.eye), enough)
            if enough() or self._clear() is not None:
                return
        yield from self._look_around()

    def _look_around(self) -> Generator[Command, None, None]:
        """Turn to the anchors that are in sight from here and were not seen well yet, the nearest turn first."""
        xy = self._senses.stance.xy_world
        left = {a.id: a for a in in_sight(self._memory.map.anchors, xy, self._senses.eye, self._settings.look_range_m, self._ways.layout)}
        while left := {id: a for id, a in left.items() if self._senses.coverage.seen_share(id) < self._settings.seen_share}:
            headings = {id: heading_to(anchor.xy_world, xy) for id, anchor in left.items()}
            heading = nearest_turn(list(headings.values()), self._senses.stance.yaw_rad)
            yield from self.moves.turn(heading)
            yield from self.moves.dwell()
            if self._clear() is not None:
                return
            left = {id: anchor for id, anchor in left.items() if headings[id] != heading}

    def _go_to(self, match: Match) -> Generator[Command, None, None]:
        candidate = self._place_of(match)
        self._log(f"to a {match.label} ({match.score:.2f}) that was seen on the way")
        reached, reason = yield from self._approach(match)
        self._note(candidate, reached, match, reason, self.moves.path_world)

    def _follow_up(self, match: Match) -> Generator[Command, None, None]:
        """Go to what was glimpsed: as a candidate if it is on an anchor that was not tried, else by itself."""
        candidate = self._place_of(match)
        if candidate.anchor_id == NOWHERE or candidate.anchor_id in self._memory.tried_ids:
            yield from self._look_closer(match)
            return
        before = len(self.attempts)
        yield from self._try(candidate)
        if self.found is None and self.attempts[before].reached:
            self._judge.rejected.add(match.landmark.id)

    def _look_closer(self, match: Match) -> Generator[Command, None, None]:
        """Go where something is seen well that was too seldom seen, or from too far off, to be a match."""
        candidate = self._place_of(match)
        self._log(f"to look closer at a {match.label} ({match.score:.2f})")
        try:
            path = self._ways.to_see(_as_anchor(match), self._senses.eye, self._senses.stance.xy_world)
        except NoPathError as error:
            self._judge.rejected.add(match.landmark.id)
            self._note(candidate, False, match, f"no path to the {match.label}: {error}")
            return
        walked = yield from self.moves.walk(path, lambda: self._clear() is not None)
        if walked == "there":
            heading = heading_to(center_of(match.landmark)[:2], self._senses.stance.xy_world)
            yield from self.moves.look([heading], lambda: self._clear() is not None)
        if self._clear() is None:
            self._judge.rejected.add(match.landmark.id)
            self._note(candidate, walked == "there", match, f"the {match.label} was not seen well enough, or not again", path)

    def _approach(self, match: Match) -> Generator[Command, None, tuple[bool, str]]:
        """Go right before a match and face it; it is ``found`` if it still is one then. Returns whether it was come to, and what it was."""
        self._judge.rejected.add(match.landmark.id)
        for _ in range(_APPROACHES):
            self._grow_floor()
            target = center_of(match.landmark)
            try:
                path = self._ways.to_stop(target[:2], self._senses.stance.xy_world, self._settings.approach_m, box_of(match.landmark))
            except NoPathError as error:
                return False, f"no path to the {match.label}: {error}"
            walked = yield from self.moves.walk(path)
            if walked == "blocked" and np.linalg.norm(target[:2] - self._senses.stance.xy_world) > self._settings.approach_m:
                return False, f"no path to the {match.label}: the way is blocked"
            in_view = yield from self._face(target)
            still = self._judge.again(match, in_view) if self._settings.verify else match
            if still is None and in_view:  # detectors miss things now and then: a second look before it is taken for something else
                yield from self.moves.dwell()
                still = self._judge.again(match, in_view)
            if still is None:
                self._judge.refute(match)
                return True, f"the {match.label} turned out to be something else"
            match = still
            if np.linalg.norm(center_of(match.landmark)[:2] - target[:2]) <= _MOVED_M:
                break
        self._judge.rejected.discard(match.landmark.id)
        self.found = match
        return True, taken_for(self._query, match)

    def _face(self, target: FloatArray) -> Generator[Command, None, bool]:
        """Turn to a place (3,), and look at it once more if it is in view from here. Returns whether it is."""
        xy = self._senses.stance.xy_world
        yield from self.moves.turn(heading_to(target[:2], xy))
        in_view = bool(np.linalg.norm(target[:2] - xy) >= self._senses.eye.nearest_m(float(target[2])))
        if self._settings.verify and in_view:
            yield from self.moves.dwell()
        return in_view

    def _clear(self) -> Match | None:
        """A clear match anywhere, if such are taken by now."""
        settings = self._settings
        taken = settings.opportunistic == "always" or (settings.opportunistic == "after_first" and self._first_is_over)
        return self._judge.clear(self._memory.map) if taken and settings.strategy == "updated" else None

    def _glimpse(self) -> Match | None:
        """Something worth a closer look, once the first candidate was gone to."""
        taken = self._settings.opportunistic != "never" and self._settings.strategy == "updated" and self._first_is_over
        return self._judge.glimpse(self._memory.map) if taken else None

    @property
    def _first_is_over(self) -> bool:
        """The thing is not where the map had it, or the map never had it: it may be anywhere."""
        return self._places_gone_to > 0 or not self._judge.is_known

    @property
    def _most_places(self) -> int:
        """After so many places the search ends: more where the map does not say with which to begin."""
        settings = self._settings
        return settings.attempts if self._judge.is_known else max(settings.attempts, settings.unknown_attempts)

    @property
    def _places_gone_to(self) -> int:
        return sum(attempt.reached for attempt in self.attempts)

    def _place_of(self, match: Match) -> Candidate:
        """The anchor that a match is at, as a candidate."""
        xy = center_of(match.landmark)[:2]
        at = [anchor for anchor in self._memory.map.anchors if is_at(match.landmark, anchor, self._settings.box_growth)]
        nearest = min(at, key=lambda anchor: (float(np.linalg.norm(anchor.xy_world - xy)), anchor.id), default=None)
        return Candidate(NOWHERE if nearest is None else nearest.id, match.score, match.label, volatile=True)

    def _note(self, candidate: Candidate, reached: bool, match: Match | None, reason: str, path_world: FloatArray | None = None) -> None:
        """Log an attempt; ``match`` is the best that was no match, unless the thing was found."""
        found = self.found
        match = match if found is None else found
        score, label = (float("nan"), "") if match is None else (match.score, match.label)
        path = np.zeros((0, 2)) if path_world is None else path_world
        word = next((anchor.label for anchor in self._memory.map.anchors if anchor.id == candidate.anchor_id), None)
        found_id = None if found is None else found.landmark.id
        self.attempts.append(Attempt(candidate, reached, found_id, score, label, reason, path, word))
        self._log(reason)

    def _in_vain(self) -> tuple[Ending, str]:
        if not self._places_gone_to and self.attempts:
            return "no_path", self.attempts[0].reason
        used = "attempts are used up" if self._places_gone_to >= self._most_places else "there is no other candidate"
        reason = looked_in_vain(self._query, self.attempts, self._judge.best(), used)
        elsewhere = in_another_room(self._query, self._feature, self._judge.required, self._memory.map)
        return "not_found", f"{reason}; {elsewhere}" if elsewhere else reason


def _as_anchor(match: Match) -> Anchor:
    """A match as something to look at."""
    landmark = match.landmark
    cloud = landmark.cloud_world if len(landmark.cloud_world) else landmark.position_m[None]
    z_range = (float(cloud[:, 2].min()), float(cloud[:, 2].max()))
    return Anchor(NOWHERE, match.label, landmark.embedding, cloud[:, :2], len(cloud), z_range, float(landmark.position_m[2]))
