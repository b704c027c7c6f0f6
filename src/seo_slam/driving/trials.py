"""Trials of navigation in a simulated home (DualMap V-A1): what is asked for, from where, and what was moved since it was mapped."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal, Self, get_args

import numpy as np

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.evaluation.navigation import SUCCESS_M
from seo_slam.geometry import FloatArray
from seo_slam.simulation.draws import generator
from seo_slam.simulation.free_space import ROBOT_RADIUS_M
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.relocation import relocated
from seo_slam.simulation.shortest import ShortestWays
from seo_slam.simulation.world import Thing, World
from seo_slam.types import BoolArray

TrialKind = Literal["static", "in_anchor", "cross_anchor"]

START_CLEARANCE_M = 0.3
START_AWAY_M = 2.0
"""Where a robot starts: with so much room around it, and so far from what it is sent to."""

MOST_MOVED = 3
_TRIES = 60  # draws without a trial that will do, one after the other


@dataclass(frozen=True, slots=True)
class Trial:
    """One errand; plain numbers and words, all that is needed to do it again.

    Attributes:
        kind: "static": nothing moved; "in_anchor", "cross_anchor": what is asked for, and maybe more, moved on its piece of furniture, or
            to another.
        number: 0, 1, … in its home and kind.
        query: what is asked for, in words.
        target_ids: things that are meant; any of them counts.
        start_xy, start_yaw_rad: of the robot, world frame, metres.
        moved: (id, 16 numbers of ``T_world_thing``) of what is elsewhere than when the home was mapped.
    """

    kind: TrialKind
    number: int
    query: str
    target_ids: tuple[int, ...]
    start_xy: tuple[float, float]
    start_yaw_rad: float
    moved: tuple[tuple[int, tuple[float, ...]], ...] = ()

    @property
    def name(self) -> str:
        """For people and files."""
        return f"{self.kind}-{self.number:02d}"

    def world(self, home: World) -> World:
        """Return the home as it is in this trial."""
        for thing_id, numbers in self.moved:
            home = home.with_thing(home.thing(thing_id).at(np.array(numbers).reshape(4, 4)))
        return home

    def as_dict(self) -> dict[str, Any]:
        """Return it for a JSON file."""
        return asdict(self)

    @classmethod
    def from_dict(cls, row: Mapping[str, Any]) -> Self:
        """Read what ``as_dict`` wrote.

        Raises:
            DatasetError: something is missing, or is not what it should be.
        """
        try:
            if row["kind"] not in get_args(TrialKind):
                raise ValueError(f"kind: got {row['kind']!r}, wanted one of {', '.join(get_args(TrialKind))}")
            x, y = row["start_xy"]
            moved = tuple((int(i), tuple(float(v) for v in T)) for i, T in row["moved"])
            if any(len(T) != 16 for _, T in moved):
                raise ValueError(f"moved: got poses of {[len(T) for _, T in moved]} numbers, wanted 16")
            ids = tuple(int(i) for i in row["target_ids"])
            start = (float(x), float(y))
            return cls(row["kind"], int(row["number"]), str(row["query"]), ids, start, float(row["start_yaw_rad"]), moved)
        except (KeyError, TypeError, ValueError) as error:
            raise DatasetError(f"trial: got {row!r:.200}: {error}") from error


def make_trials(home: SimulatedHome, kind: TrialKind, count: int, seed: int = 0) -> tuple[Trial, ...]:
    """Return trials in a home; the first of more are the same as of fewer.

    What is asked for can be reached: from the start a robot can come within ``SUCCESS_M`` of its middle. Words go round: none is asked
    for a second time before all were. What was moved is asked for by a word that nothing else in the home has.

    Args:
        home: as it was mapped; its changes during the tour are not heeded.
        kind: see ``Trial``.
        count: how many.
        seed: of all draws.

    Raises:
        ConfigError: an unknown kind, a count below 0, or a home that has not so many.
    """
    if kind not in get_args(TrialKind) or count < 0:
        raise ConfigError(f"trials: got {count} of kind {kind!r}, wanted 0 or more of {', '.join(get_args(TrialKind))}")
    desk = _TrialDesk(home, seed)
    return tuple(desk.static(count) if kind == "static" else desk.moved(kind, count))


class _TrialDesk:
    """Draws trials for one home."""

    def __init__(self, home: SimulatedHome, seed: int) -> None:
        self._home, self._seed = home, seed
        self._ways = ShortestWays(home.free)

    def static(self, count: int) -> Iterable[Trial]:
        """Every word of a small thing or a piece of furniture, in a drawn order, again and again."""
        world = self._home.world
        words = sorted({thing.label for thing in world.things if thing.kind != "fixed"})
        words = [word for word in words if self._can_be_reached(bearing(world, word))]
        if count and not words:
            raise ConfigError(f"trials: {self._home.name} has nothing that a robot can come near to")
        order = generator(self._seed, "static trials").permutation(len(words)) if words else np.zeros(0, dtype=np.int64)
        for number in range(count):
            word = words[int(order[number % len(words)])]
            yield self._trial("static", number, word, bearing(world, word), ())

    def moved(self, kind: Literal["in_anchor", "cross_anchor"], count: int) -> Iterable[Trial]:
        """Moves of one to three things; of those with a word of their own, the one asked for least often is asked for."""
        asked: Counter[int] = Counter()
        draw = stuck = 0
        number = 0
        while number < count:
            if stuck == _TRIES:
                raise ConfigError(f"trials: {self._home.name} has {number} of kind {kind}, wanted {count}")
            moves = self._moves(kind, draw)
            draw += 1
            unique = [thing for thing in moves if len(bearing(self._home.world, thing.label)) == 1 and self._can_be_reached([thing])]
            if not unique or (stuck < _TRIES // 2 and min(asked[t.id] for t in unique) > min(asked.values(), default=0) + 1):
                stuck += 1
                continue
            thing = min(unique, key=lambda t: asked[t.id])
            asked[thing.id] += 1
            stuck = 0
            yield self._trial(kind, number, thing.label, [thing], moves)
            number += 1

    def _moves(self, kind: Literal["in_anchor", "cross_anchor"], draw: int) -> list[Thing]:
        """What is moved in a draw: fewer things where so many find no place."""
        draws = generator(self._seed, "moved trials", kind, draw)
        most = 1 + int(draws.integers(MOST_MOVED))
        for number in range(most, 0, -1):
            try:
                changes = relocated(self._home.world, kind, number, int(draws.integers(2**31)), 0.0, self._home.free)
            except ConfigError:
                continue
            return [change.thing for change in changes]
        return []

    def _trial(self, kind: TrialKind, number: int, word: str, targets: list[Thing], moves: Iterable[Thing]) -> Trial:
        draws = generator(self._seed, "trial", kind, number)
        ids = tuple(sorted(thing.id for thing in targets))
        start = drawn_start(self._starts, targets, draws)
        moved = tuple((thing.id, tuple(thing.T_world_thing.ravel().tolist())) for thing in moves)
        query = phrase(word, int(draws.integers(3)))
        return Trial(kind, number, query, ids, (float(start[0]), float(start[1])), float(draws.uniform(-np.pi, np.pi)), moved)

    def _can_be_reached(self, targets: list[Thing]) -> bool:
        return any((self._ways.within(thing.p_world, SUCCESS_M) & self._main).any() for thing in targets)

    @cached_property
    def _main(self) -> BoolArray:
        return self._home.free.main_part(ROBOT_RADIUS_M)

    @cached_property
    def _starts(self) -> FloatArray:
        return starts(self._home)


def starts(home: SimulatedHome) -> FloatArray:
    """Return (N, 2) where a robot may start: with ``START_CLEARANCE_M`` of room, all in one connected part of the floor.

    Raises:
        ConfigError: nowhere.
    """
    cells = np.argwhere(home.free.standing(START_CLEARANCE_M) & home.free.main_part(ROBOT_RADIUS_M))
    if not len(cells):
        raise ConfigError(f"trials: {home.name} has no place where a robot with {START_CLEARANCE_M} m around it could start")
    return home.free.middles(cells)


def drawn_start(xy_world: FloatArray, targets: Sequence[Thing], draws: np.random.Generator) -> FloatArray:
    """Return one of some places (N, 2), at least ``START_AWAY_M`` from all that is meant, or as far as there is."""
    away = np.full(len(xy_world), np.inf)
    for thing in targets:
        away = np.minimum(away, np.linalg.norm(xy_world - thing.p_world[:2], axis=1))
    far = xy_world[away >= min(START_AWAY_M, float(away.max()))]
    return np.asarray(far[int(draws.integers(len(far)))])


def bearing(world: World, word: str) -> list[Thing]:
    """Return the things that a word is right for."""
    wanted = word.casefold()
    return [thing for thing in world.things if wanted in (w.casefold() for w in (thing.label, *thing.accepted_labels))]


def phrase(word: str, form: int) -> str:
    """Return a word as people ask for it: bare (0), with "the" (1), with "a" or "an" (2; a plural such as "scissors" has none)."""
    if form == 0:
        return word
    if form == 1 or (word.endswith("s") and not word.endswith("ss")):
        return f"the {word}"
    return f"{'an' if word[:1].casefold() in 'aeiou' else 'a'} {word}"
