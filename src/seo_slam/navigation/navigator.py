"""Walking to a thing that a person names, also after it was moved (DualMap IV-B to IV-D)."""

import logging
from collections.abc import Generator
from dataclasses import replace

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Layout
from seo_slam.abstraction.from_words import is_of
from seo_slam.abstraction.scene_cloud import SceneCloud
from seo_slam.errors import ConfigError, MapError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.navigation.judging import Judge
from seo_slam.navigation.local_match import center_of
from seo_slam.navigation.looking import what_hides
from seo_slam.navigation.memory import Memory
from seo_slam.navigation.motion import stop
from seo_slam.navigation.outcomes import Candidate, Command, Ending, Outcome, anchor_name
from seo_slam.navigation.parts import Abstracting, Grid, Mapper, Planner, Updating
from seo_slam.navigation.query import Query, candidates, parsed, with_hints
from seo_slam.navigation.search import Search
from seo_slam.navigation.selection import Selection
from seo_slam.navigation.senses import Senses
from seo_slam.navigation.ways import Ways
from seo_slam.records import FeatureRecipe
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.settings.planning import LayoutSettings, PlannerSettings
from seo_slam.types import Frame

_LOG = logging.getLogger(__name__)


class Navigator:
    """Sits in any robot loop: ask once, then give it every frame and do what it commands.

        navigator = Navigator(abstract_map, pipeline, embedder)
        navigator.ask("the mug in the kitchen")
        while navigator.outcome is None:
            robot.drive(navigator.step(robot.frame()))
        print(navigator.outcome.reason)

    The world's failures never raise: no way, a thing that is not there, lost odometry, a start outside the free floor are outcomes, or
    entries of their ``attempts``. After an outcome another thing can be asked for; the map goes on with what was seen.

    Attributes:
        settings: how it searches.
        outcome: how the search ended; None while it goes on, or before the first.
    """

    def __init__(
        self,
        abstract_map: AbstractMap,
        mapper: Mapper,
        embedder: Embedder,
        settings: NavigationSettings | None = None,
        *,
        planning: PlannerSettings | None = None,
        abstraction: AbstractionSettings | None = None,
        scene: LayoutSettings | None = None,
        grid: Grid | None = None,
        far: Planner | None = None,
        near: Planner | None = None,
        abstracting: Abstracting | None = None,
        updating: Updating | None = None,
        seed: int = 0,
    ) -> None:
        """Take a map to search in and what sees the world.

        Args:
            abstract_map: with a layout, unless it is empty.
            mapper: builds the local concrete map, in the frame of the abstract map; a ``Pipeline``. It may hold landmarks already.
            embedder: the one that made the features of the map.
            settings: how to search.
            planning: the robot's radius, and how its ways are found.
            abstraction: how the local map becomes anchors.
            scene: how floor that the map does not know is found on the way.
            grid: the free floor; it, ``far`` and ``near`` are given all three, or none.
            far: a global planner instead of Voronoi.
            near: a local planner instead of RRT*.
            abstracting: instead of ``seo_slam.abstraction.abstracting.abstract``.
            updating: instead of ``seo_slam.abstraction.updating.updated``.
            seed: of the local planner, and of strategy "random".

        Raises:
            ConfigError: ``seed`` is below 0, or some of ``grid``, ``far`` and ``near`` are given and not all.
            MapError: the map has anchors and no layout, or features of another embedder or size.
            MissingBackendError: the global planner needs the extra ``nav``.
        """
        if seed < 0:
            raise ConfigError(f"navigator: got seed {seed}, wanted 0 or more")
        self.settings = settings or NavigationSettings()
        self.outcome: Outcome | None = None
        if abstract_map.anchors and abstract_map.layout is None:
            raise MapError(f"navigator: got {len(abstract_map.anchors)} anchors and no layout, wanted a map made with a scene cloud")
        if abstract_map.anchors and abstract_map.embedder and abstract_map.embedder != embedder.name:
            raise MapError(f"navigator: got embedder {embedder.name!r} for a map of {abstract_map.embedder!r}, wanted the same")
        if abstract_map.anchors and abstract_map.embedder and not is_of(abstract_map, embedder):
            raise MapError(f"navigator: got embedder {embedder.name!r} of size {embedder.size}, wanted the size of the map's features")
        self._map = abstract_map
        self._mapper = mapper
        self._embedder = embedder
        self._seed = seed
        self._ways = _ways(abstract_map, planning or PlannerSettings(), grid, far, near, seed)
        self._abstracting, self._updating = _map_keeping(embedder, abstraction or AbstractionSettings(), abstracting, updating)
        self._senses = Senses(mapper, self.settings)
        self._scene = SceneCloud(scene)
        self._query: Query | None = None
        self._search: Search | None = None
        self._memory: Memory | None = None
        self._commands: Generator[Command, None, tuple[Ending, str]] | None = None
        self._trusted: AbstractMap | None = None
        self._unknown = ""
        self._steps = 0
        self._lines: list[str] = []
        self._trace: list[FloatArray] = []

    @property
    def abstract_map(self) -> AbstractMap:
        """The map as updated by all searches so far."""
        return self._map if self._memory is None else self._memory.map

    @property
    def path_world(self) -> FloatArray:
        """(N, 2) the path that is walked, or was last; empty before the first."""
        return np.zeros((0, 2)) if self._search is None else self._search.moves.path_world

    @property
    def trace_world(self) -> FloatArray:
        """(N, 2) where the robot was at each frame of this search."""
        return np.array(self._trace).reshape(-1, 2)

    @property
    def log(self) -> tuple[str, ...]:
        """What happened in this search, for people; each line begins with the number of the frame."""
        return tuple(self._lines)

    def ask(self, text: str) -> Outcome | None:
        """Begin to search for something. A search that is going on ends, and the map keeps what it saw.

        An empty text, an empty map and a room without furniture are answered at once. What the map knows nothing like is searched for,
        unless ``settings.unknown`` says otherwise: things come into a home.

        Args:
            text: such as "mug", or "the mug in the kitchen" with a room that the map knows.

        Returns:
            The outcome, if there is one already.

        Raises:
            ConfigError: ``text`` is no string.
        """
        query = parsed(text, self.abstract_map.rooms)
        self._end_search()
        self._query = query
        self.outcome = None
        self._search = None
        self._commands = None
        self._steps = 0
        self._lines, self._trace = [], []
        self._begin(query)
        return self.outcome

    def step(self, frame: Frame) -> Command:
        """Take a frame, and say what to do until the next one.

        While odometry is lost the robot is to stop and ``outcome`` stays None. After the end the answer is "stop", and the frame is not
        looked at.

        Raises:
            ConfigError: nothing was asked for.
            FrameError: the frame cannot be taken, as of the mapper's ``step``.
        """
        if self._query is None:
            raise ConfigError("navigator: got a frame before a query, wanted ask(text) first")
        if self.outcome is not None or self._commands is None:
            return stop(self._senses.stance)
        self._senses.take(frame)
        self._steps += 1
        if self._steps > self.settings.max_steps:
            return self._finish("gave_up", f"no {self._query.words} was found in {self.settings.max_steps} frames")
        if self._senses.lost:
            self._note("odometry is lost")
            return stop(self._senses.stance)
        self._trace.append(self._senses.stance.xy_world)
        if self.settings.grow_floor and frame.has_depth:
            self._scene.add(frame.depth_m, frame.camera, self._senses.T_world_camera)
        try:
            return next(self._commands)
        except StopIteration as end:
            return self._finish(*end.value)

    def _begin(self, query: Query) -> None:
        abstract_map = self.abstract_map
        if not query.words:
            return self._answer("bad_query", f"got {query.text!r}, wanted the name of a thing, such as 'mug'")
        if not abstract_map.anchors or self._ways is None:
            return self._answer("empty_map", "the map has no anchors: nothing was mapped, or nothing in it rarely moves")
        feature = self._embedder.embed_text([query.words])[0]
        rows = candidates(abstract_map, feature, room=query.room)
        if not rows:
            return self._answer("not_found", f"the map has no furniture in the {query.room}")
        trusted = rows[0].score >= self.settings.least_score
        hinted = None if trusted else self._hinted(abstract_map, query, feature)
        self._unknown = "" if trusted or hinted is not None else _not_known(abstract_map, query, rows[0])
        self._trusted = None if hinted is None else abstract_map
        abstract_map, rows = hinted or (abstract_map, rows)
        if self._unknown and self.settings.unknown == "answer":
            return self._answer("not_found", self._unknown)
        settings, senses, ways = self.settings, self._senses, self._ways
        senses.restart(abstract_map.anchors)
        memory = Memory(abstract_map, senses, settings, self._abstracting, self._updating)
        judge = Judge(query, feature, rows[0].score, senses, settings, trusted)
        selection = Selection(query, feature, memory, judge, senses, ways, settings, self._seed)
        self._memory = memory
        self._search = Search(query, feature, judge, memory, selection, senses, ways, settings, self._note, self._grow_floor)
        self._commands = self._search.commands()
        return None

    def _hinted(self, abstract_map: AbstractMap, query: Query, feature: FloatArray) -> tuple[AbstractMap, tuple[Candidate, ...]] | None:
        """The map with those of its hints that are like the query, and the candidates; None if there is no such hint."""
        hinted = with_hints(abstract_map, feature, self.settings.least_score)
        rows = candidates(hinted, feature, room=query.room)
        if rows[0].score < self.settings.least_score:
            return None
        self._note(f"the map is not sure of a {rows[0].because} that was seen at the {_name(hinted, rows[0])} ({rows[0].score:.2f})")
        return hinted, rows

    def _finish(self, ending: Ending, reason: str) -> Command:
        unlike = _unlike(self.abstract_map, self._mapper)  # only now: before its first frame a mapper may not know how it makes features
        if unlike:
            self._note(unlike)
        notes = (self._unknown, unlike)
        self._answer(ending, reason + ("" if ending == "found" else "".join(f"; {note}" for note in notes if note)))
        self._end_search()
        return stop(self._senses.stance)

    def _answer(self, ending: Ending, reason: str) -> None:
        attempts = () if self._search is None else tuple(self._search.attempts)
        found = None if self._search is None else self._search.found
        target = center_of(found.landmark) if found is not None and ending == "found" else None
        self.outcome = Outcome("" if self._query is None else self._query.text, ending, reason, attempts, target, self._steps)
        self._note(f"{ending}: {reason}")

    def _end_search(self) -> None:
        """Keep what the search saw."""
        if self._commands is None or self._search is None or self._memory is None:
            return
        self._commands.close()
        self._commands = None
        if self._trusted is not None:
            self._memory.forget_hints(self._trusted)
        self._search.learn()
        if self._ways is not None and self._ways.floor is not None:
            self._memory.map = replace(self._memory.map, layout=self._ways.floor)

    def _grow_floor(self) -> None:
        """Let the ways know of floor that was seen on the way."""
        if self._ways is not None and self.settings.grow_floor and len(self._scene):
            self._ways.grow(self._scene.layout())

    def _note(self, line: str) -> None:
        text = f"{self._steps}: {line}"
        if not self._lines or self._lines[-1].partition(": ")[2] != line:  # what goes on for many frames is said once
            self._lines.append(text)
            _LOG.info("%s", text)


def _not_known(abstract_map: AbstractMap, query: Query, best: Candidate) -> str:
    where = _name(abstract_map, best)
    thing = f"{best.because or 'thing without a name'} at the {where}" if best.volatile else where
    return f"the map knows nothing like {query.words!r}; the best it has is the {thing} ({best.score:.2f})"


def _name(abstract_map: AbstractMap, candidate: Candidate) -> str:
    return next(anchor_name(anchor.label, anchor.id) for anchor in abstract_map.anchors if anchor.id == candidate.anchor_id)


def _unlike(abstract_map: AbstractMap, mapper: Mapper) -> str:
    """What to say where what is seen has features of another kind than the map: a match then scores lower, or higher, than expected."""
    seen: FeatureRecipe | None = getattr(mapper.snapshot(), "features", None)
    known = abstract_map.features
    if known is None or seen is None or known.in_words == seen.in_words:
        return ""
    return f"the map's features are of {known.in_words}, those of what is seen are of {seen.in_words}: their scores do not compare"


def _ways(
    abstract_map: AbstractMap, planning: PlannerSettings, grid: Grid | None, far: Planner | None, near: Planner | None, seed: int
) -> Ways | None:
    """The planners; loaded here, since they bring networkx and skimage."""
    layout = abstract_map.layout
    if layout is None:
        return None
    hiding = what_hides(layout, abstract_map.anchors)
    if grid is not None and far is not None and near is not None:
        return Ways(hiding, grid, far, near)
    if not (grid is None and far is None and near is None):
        raise ConfigError("navigator: got some of grid, far and near, wanted all three or none")
    from seo_slam.navigation.global_planner import VoronoiPlanner
    from seo_slam.navigation.grid import NavigationGrid
    from seo_slam.navigation.local_planner import RrtStar

    def plan(floor: Layout) -> tuple[Grid, Planner, Planner]:
        own = NavigationGrid(floor, planning.radius_m)
        return own, VoronoiPlanner(own, planning), RrtStar(own, planning, seed)

    return Ways(hiding, *plan(layout), floor=layout, plan=plan)


def _map_keeping(
    embedder: Embedder, settings: AbstractionSettings, abstracting: Abstracting | None, updating: Updating | None
) -> tuple[Abstracting, Updating]:
    """How a local map changes the abstract one."""
    from seo_slam.abstraction.abstracting import abstract
    from seo_slam.abstraction.updating import updated

    return (
        abstracting or (lambda landmarks: abstract(landmarks, embedder, settings)),
        updating or (lambda old, new: updated(old, new, settings)),
    )
