"""Protocol ``navigation/1``: how often a robot that was sent for something stopped before it (DualMap V-A2), and why not."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, Self

import numpy as np

from seo_slam.errors import EvaluationError

PROTOCOL = "navigation/1"
SUCCESS_M = 1.0
MOST_ATTEMPTS = 3
"""DualMap's rule: within 1 m, and where things were moved at the third place at the latest."""

FailureClass = Literal["false match", "stopped short", "not mapped", "attempts exhausted", "planning error", "gave up", "failed"]
"""false match: it stopped before something else. stopped short: it believed the right place, and stopped too far from it. not mapped: the
thing was not in the abstract map where it stood, so that the map failed and not the search; not told of things that went to another piece
of furniture. attempts exhausted: it looked in the wrong places. planning error: no path, or a start outside the free floor. gave up: out of
steps. failed: the program raised an error."""

_PLANNING = ("no_path", "bad_start")
_WILSON_Z = 1.959964  # 95 %


@dataclass(frozen=True, slots=True)
class Drive:
    """What is known of a drive when it is over. Distances are metres in the plane, to the nearest of the things that were meant.

    Attributes:
        home, kind, strategy, number, query: which trial it was.
        ending: see ``navigation.outcomes.Ending``, or "failed".
        attempts: places that were gone to.
        distance_m: from the robot to the thing's middle.
        surface_m: to the edge of its box, seen from above.
        in_sight: whether the robot can see it from where it stopped.
        believed_m: from the place of the match to the thing's middle; None where there was no match.
        collisions: how often the robot touched something.
        driven_m: length of its way.
        shortest_m: of the shortest way from the start to a place within ``SUCCESS_M`` of the thing; infinity where none was found.
        mapped: whether the abstract map had the thing where it stood when the home was mapped.
        retrieved_object_m: from the thing in the concrete map that the words fit best to the thing's middle; None without such a map.
        retrieved_anchor_m: the same of the piece of furniture that scores best in the abstract map.
        steps: frames.
        seconds: of computing.
        error: what was raised.
    """

    home: str
    kind: str
    strategy: str
    number: int
    query: str
    ending: str
    attempts: int = 0
    distance_m: float = np.inf
    surface_m: float = np.inf
    in_sight: bool = False
    believed_m: float | None = None
    collisions: int = 0
    driven_m: float = 0.0
    shortest_m: float = 0.0
    mapped: bool = True
    retrieved_object_m: float | None = None
    retrieved_anchor_m: float | None = None
    steps: int = 0
    seconds: float = 0.0
    error: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return it for a JSON file; what is infinite becomes None."""
        return {key: _rounded(value) for key, value in asdict(self).items()}

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Self:
        """Read what ``as_dict`` wrote; other keys are passed over.

        Raises:
            EvaluationError: the home, kind, strategy, number, query or ending is missing.
        """
        known = {key: value for key, value in row.items() if key in cls.__slots__}
        for key in ("distance_m", "surface_m", "shortest_m"):
            if key in known and known[key] is None:
                known[key] = np.inf
        try:
            return cls(**known)
        except TypeError as error:
            raise EvaluationError(f"drive: got {sorted(row)}: {error}") from error

    @property
    def is_success(self) -> bool:
        """Whether it stopped before a match, near enough to the thing, and in time."""
        in_time = self.kind == "static" or self.attempts <= MOST_ATTEMPTS
        return self.ending == "found" and self.distance_m <= SUCCESS_M and in_time

    @property
    def path_share(self) -> float:
        """Its part of SPL (Anderson and others 2018): 0 where it failed, else shortest way by the way made.

        A way that is no longer than the shortest counts as that, also where none was found: 1.
        """
        if not self.is_success:
            return 0.0
        return 1.0 if self.driven_m <= self.shortest_m else self.shortest_m / self.driven_m

    @property
    def failure(self) -> FailureClass | None:
        """Why it is no success; None if it is one."""
        if self.is_success:
            return None
        if self.ending == "failed":
            return "failed"
        if self.ending == "found" and self.believed_m is not None and self.believed_m <= SUCCESS_M and self.distance_m > SUCCESS_M:
            return "stopped short"
        if self.ending == "empty_map" or (not self.mapped and self.kind != "cross_anchor"):
            return "not mapped"
        if self.ending in _PLANNING:
            return "planning error"
        if self.ending == "gave_up":
            return "gave up"
        return "false match" if self.ending == "found" and self.distance_m > SUCCESS_M else "attempts exhausted"


def score_drives(drives: Iterable[Drive]) -> list[dict[str, Any]]:
    """Return a table, a row for every kind and strategy in the order in which they come, with a row for each home in it.

    A row holds ``trials``, ``successes``, ``success_rate`` with its 95 % interval (Wilson), ``success_in_sight``: of all trials those that
    succeeded with the thing in sight, ``spl``, ``failures`` by class, ``collided``: share of trials with a collision, and
    ``retrieval_object`` and ``retrieval_anchor``: share of trials in which the place that the words fit best lies within ``SUCCESS_M`` of
    the thing, without any driving: so "navigation" of the published baselines was scored. A trial without such a place counts as one in
    which it does not; None where no trial has one.
    """
    rows = list(drives)
    groups = dict.fromkeys((row.kind, row.strategy) for row in rows)
    table = []
    for kind, strategy in groups:
        own = [row for row in rows if (row.kind, row.strategy) == (kind, strategy)]
        homes = {name: _scores([row for row in own if row.home == name]) for name in dict.fromkeys(row.home for row in own)}
        mean = sum(scores["success_rate"] for scores in homes.values()) / len(homes)
        table.append({"kind": kind, "strategy": strategy, **_scores(own), "mean_over_homes": round(mean, 4), "homes": homes})
    return table


def statement(seeds: Mapping[str, int], level: float, versions: Mapping[str, str]) -> dict[str, Any]:
    """Return what every result states of how it was scored."""
    return {
        "protocol": PROTOCOL,
        "success": f"the robot stops before a match, at most {SUCCESS_M:g} m from the middle of the thing in the plane; where things were "
        f"moved, at the third place at the latest",
        "radius_m": SUCCESS_M,
        "most_attempts": MOST_ATTEMPTS,
        "distance": "plane, to the middle of the true box of the nearest thing that was meant",
        "aggregation": "over trials; mean_over_homes beside it",
        "seeds": dict(seeds),
        "level": level,
        "versions": dict(versions),
    }


def _scores(rows: Sequence[Drive]) -> dict[str, Any]:
    won = sum(row.is_success for row in rows)
    low, high = wilson(won, len(rows))
    failures = Counter(row.failure for row in rows if row.failure is not None)
    return {
        "trials": len(rows),
        "successes": won,
        "success_rate": round(won / len(rows), 4),
        "interval_95": [round(low, 4), round(high, 4)],
        "success_in_sight": _share([row.is_success and row.in_sight for row in rows]),
        "spl": round(float(np.mean([row.path_share for row in rows])), 4),
        "failures": dict(sorted(failures.items(), key=lambda item: (-item[1], item[0]))),
        "collided": _share([row.collisions > 0 for row in rows]),
        "retrieval_object": _within([row.retrieved_object_m for row in rows]),
        "retrieval_anchor": _within([row.retrieved_anchor_m for row in rows]),
        "mean_attempts": round(float(np.mean([row.attempts for row in rows])), 3),
        "mean_driven_m": round(float(np.mean([row.driven_m for row in rows])), 3),
    }


def wilson(won: int, trials: int) -> tuple[float, float]:
    """Return the 95 % interval (Wilson 1927) of a share.

    Raises:
        EvaluationError: no trials, or more won than there were.
    """
    if not 0 <= won <= trials or not trials:
        raise EvaluationError(f"share: got {won} of {trials}, wanted 0 or more of at least 1")
    share, z2 = won / trials, _WILSON_Z**2
    middle = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = _WILSON_Z / (1 + z2 / trials) * np.sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    return max(float(middle - half), 0.0), min(float(middle + half), 1.0)


def _share(flags: Sequence[bool]) -> float:
    return round(sum(flags) / len(flags), 4)


def _within(distances_m: Sequence[float | None]) -> float | None:
    if all(d is None for d in distances_m):
        return None
    return _share([d is not None and d <= SUCCESS_M for d in distances_m])


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4) if np.isfinite(value) else None
    return value
