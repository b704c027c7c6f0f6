"""What flows through navigation: candidates, commands to a robot, attempts, outcomes. World frame, metres, radians."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from seo_slam.abstraction.abstract_map import Volatile
from seo_slam.geometry import FloatArray

Ending = Literal["found", "not_found", "no_path", "bad_start", "bad_query", "empty_map", "gave_up"]
"""found: stopped before a confident match; not_found: attempts or candidates are used up; no_path: no way leads to any candidate;
bad_start: the robot stands outside the free floor; gave_up: out of steps."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """An anchor to go to (Eq 5, 6).

    Attributes:
        anchor_id: which.
        score: its score, Eq 5.
        because: the anchor's own word, or that of the volatile thing that scored: for people.
        volatile: the score is that of something on it.
        thing: which one of those that the map has there; None where it was only seen on the way.
    """

    anchor_id: int
    score: float
    because: str
    volatile: bool
    thing: Volatile | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """What a robot should do next.

    Attributes:
        kind: "go": drive to ``xy_world``; "turn": turn on the spot to ``yaw_rad``; "stop": it is over.
        xy_world: (2,) the next waypoint; where the robot is when it turns or stops.
        yaw_rad: heading to take there; None: whatever the way brings.
        forward_m_s, turn_rad_s: the same as a velocity for robots that are driven so.
    """

    kind: Literal["go", "turn", "stop"]
    xy_world: FloatArray
    yaw_rad: float | None = None
    forward_m_s: float = 0.0
    turn_rad_s: float = 0.0


def anchor_name(label: str, id: int) -> str:
    """Name an anchor for people."""
    return f"{label or 'thing without a name'} {id}"


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """One candidate that was gone to.

    Attributes:
        candidate: the anchor and why.
        reached: whether the robot came to it.
        found_id: landmark of the local map that matched with confidence, else None.
        found_score: cosine of the match, or of the best that was no match; NaN if nothing was seen.
        found_label: its word; "" if nothing was seen.
        reason: in words, for people and logs.
        path_world: (N, 2) planned to it.
        anchor_label: the anchor's own word then, "" if it had none; None: it was no anchor. Updates give new anchors their ids anew, so
            the same id may be other furniture later.
    """

    candidate: Candidate
    reached: bool
    found_id: int | None
    found_score: float
    found_label: str
    reason: str
    path_world: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    anchor_label: str | None = None

    @property
    def anchor_name(self) -> str | None:
        """The anchor's word and id, for people; None: it was no anchor."""
        return None if self.anchor_label is None else anchor_name(self.anchor_label, self.candidate.anchor_id)


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """How a navigation ended.

    Attributes:
        query: what was asked for.
        ending: see ``Ending``.
        reason: in words.
        attempts: in order, also those that came to nothing on the way; see ``places_gone_to``.
        target_world: (3,) the place of the confident match; None unless found.
        steps: frames that were stepped.
    """

    query: str
    ending: Ending
    reason: str
    attempts: tuple[Attempt, ...]
    target_world: FloatArray | None
    steps: int

    @property
    def places_gone_to(self) -> int:
        """How many of the attempts count: the robot came there. No path, or another match met on the way, cost none."""
        return sum(attempt.reached for attempt in self.attempts)

    @property
    def found(self) -> bool:
        """Whether the robot stopped before a match."""
        return self.ending == "found"
