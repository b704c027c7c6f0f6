"""One trial: a navigator drives the simulated robot until it stops, and the truth judges where."""

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.driving.judging import distance_m, is_mapped, judged_stop, shortest_m
from seo_slam.driving.mappers import MakeMapper
from seo_slam.driving.robot import SimulatedRobot
from seo_slam.driving.trials import Trial
from seo_slam.errors import MapError
from seo_slam.evaluation.navigation import Drive
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.map import Map
from seo_slam.navigation.motion import path_length_m
from seo_slam.navigation.navigator import Navigator
from seo_slam.navigation.outcomes import Attempt, Command, Outcome
from seo_slam.navigation.query import candidates, parsed
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.settings.planning import LayoutSettings, PlannerSettings
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.shortest import ShortestWays
from seo_slam.simulation.tour import RATE_HZ
from seo_slam.simulation.world import Thing
from seo_slam.types import Frame

Watcher = Callable[[SimulatedRobot, Frame, Command], None]


@dataclass(frozen=True, slots=True)
class DriveOptions:
    """How the robot drives and sees.

    Attributes:
        rate_hz: frames a second.
        drifts: the robot's odometry drifts as the level says; else its poses are given.
        size_px: width and height of the images; None: as the home's.
        planner, abstraction, layout: settings of the navigator beside those of the search: how ways are found, how what it maps becomes
            anchors, and how floor is found on the way.
    """

    rate_hz: float = RATE_HZ
    drifts: bool = False
    size_px: tuple[int, int] | None = None
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    abstraction: AbstractionSettings = field(default_factory=AbstractionSettings)
    layout: LayoutSettings = field(default_factory=LayoutSettings)


@dataclass(frozen=True, slots=True, eq=False)
class TrialResult:
    """How a trial went.

    Attributes:
        trial: what was asked for.
        drive: the facts that are scored.
        outcome: what the navigator says.
        xy_world: (N, 2) where the robot was at each frame.
        target_world: (3,) middle of the thing that was meant, the nearest one to where the robot stopped; None if nothing was.
    """

    trial: Trial
    drive: Drive
    outcome: Outcome
    xy_world: FloatArray
    target_world: FloatArray | None

    def as_dict(self) -> dict[str, Any]:
        """Return it for a JSON file: what was asked for, how it ended, and what was tried."""
        outcome = self.outcome
        return {
            **self.drive.as_dict(),
            "success": self.drive.is_success,
            "failure": self.drive.failure,
            "reason": outcome.reason,
            "believed_world": None if outcome.target_world is None else _metres(outcome.target_world),
            "target_world": None if self.target_world is None else _metres(self.target_world),
            "stopped_world": _metres(self.xy_world[-1]),
            "log": [attempt_fields(attempt) for attempt in outcome.attempts],
            "trial": self.trial.as_dict(),
        }


def run_trial(
    home: SimulatedHome,
    mapped: Map,
    trial: Trial,
    *,
    make_mapper: MakeMapper,
    embedder: Embedder,
    settings: NavigationSettings | None = None,
    options: DriveOptions | None = None,
    name: str = "",
    drive: int = 0,
    watch: Watcher | None = None,
) -> TrialResult:
    """Drive one trial to its end.

    Args:
        home: as it was mapped.
        mapped: its map, as ``map_home`` makes it.
        trial: one of ``make_trials`` of this home.
        make_mapper: makes what maps the robot's frames.
        embedder: the one of the map.
        settings: of the navigator; its strategy is that of Table V, and a drive is over after its ``max_steps`` frames.
        options: how the robot drives.
        name: of the home, for tables; "": that of the recording.
        drive: number of the drive: key of the noise and of the navigator's draws.
        watch: called with robot, frame and command before each step.

    Raises:
        ConfigError: the trial is not of this home.
        MapError: the map has no abstract map.
    """
    started_s = time.perf_counter()
    settings, options = settings or NavigationSettings(), options or DriveOptions()
    abstract = mapped.abstract
    if abstract is None:
        raise MapError("trial: got a map without an abstract map, wanted one as map_home makes it")
    world = trial.world(home.world)
    targets = [world.thing(i) for i in trial.target_ids]
    robot = SimulatedRobot(
        home,
        np.array(trial.start_xy),
        trial.start_yaw_rad,
        world=world,
        drive=drive,
        rate_hz=options.rate_hz,
        drifts=options.drifts,
        size_px=options.size_px,
    )
    mapper = make_mapper(robot, robot.odometry, embedder)
    with closing(mapper):
        navigator = Navigator(
            abstract,
            mapper,
            embedder,
            settings,
            planning=options.planner,
            abstraction=options.abstraction,
            scene=options.layout,
            seed=drive,
        )
        outcome = _driven(robot, navigator, trial.query, watch)
    facts = Drive(
        home=name or home.name,
        kind=trial.kind,
        strategy=settings.strategy,
        number=trial.number,
        query=trial.query,
        ending=outcome.ending,
        attempts=outcome.places_gone_to,
        collisions=robot.collisions,
        driven_m=robot.driven_m,
        steps=outcome.steps,
        seconds=time.perf_counter() - started_s,
    )
    target_world = None
    if targets:
        stop = judged_stop(world, home.free, targets, robot.xy_world)
        target_world = world.thing(stop.thing_id).p_world
        guesses = _first_guesses(mapped, abstract, trial.query, embedder)
        object_m, anchor_m, believed_m = (_nearest_m(targets, p) for p in (*guesses, outcome.target_world))
        facts = replace(
            facts,
            distance_m=stop.distance_m,
            surface_m=stop.surface_m,
            in_sight=stop.in_sight,
            believed_m=believed_m,
            shortest_m=shortest_m(ShortestWays(home.free), np.array(trial.start_xy), targets),
            mapped=is_mapped(home.world, trial, abstract),
            retrieved_object_m=object_m,
            retrieved_anchor_m=anchor_m,
        )
    xy_world = np.concatenate([robot.trajectory.T_world_camera[:, :2, 3], robot.xy_world[None]])
    return TrialResult(trial, facts, outcome, xy_world, target_world)


def _driven(robot: SimulatedRobot, navigator: Navigator, query: str, watch: Watcher | None) -> Outcome:
    outcome = navigator.ask(query)
    while outcome is None:  # the navigator gives up by itself, after ``max_steps`` frames
        frame = robot.frame()
        command = navigator.step(frame)
        if watch is not None:
            watch(robot, frame, command)
        robot.drive(command)
        outcome = navigator.outcome
    return outcome


def _first_guesses(mapped: Map, abstract: AbstractMap, query: str, embedder: Embedder) -> tuple[FloatArray | None, FloatArray | None]:
    """Where the words alone lead: to the best thing of the concrete map, and to the best anchor."""
    words = parsed(query, abstract.rooms).words
    hits = mapped.query(words, 1, embedder) if words and len(mapped) else ()
    ranked = candidates(abstract, embedder.embed_text([words])[0]) if words else ()
    anchors = {anchor.id: anchor for anchor in abstract.anchors}
    return (
        hits[0].landmark.position_m if hits else None,
        anchors[ranked[0].anchor_id].xy_world if ranked else None,
    )


def _nearest_m(targets: Sequence[Thing], p_world: FloatArray | None) -> float | None:
    return None if p_world is None else min(distance_m(thing, p_world) for thing in targets)


def attempt_fields(attempt: Attempt) -> dict[str, Any]:
    """Return an attempt for a JSON file."""
    found = {"found_id": attempt.found_id, "found_label": attempt.found_label}
    score = None if np.isnan(attempt.found_score) else round(float(attempt.found_score), 4)
    return {
        "anchor_id": attempt.candidate.anchor_id,
        "score": round(float(attempt.candidate.score), 4),
        "because": attempt.candidate.because,
        "volatile": attempt.candidate.volatile,
        "reached": attempt.reached,
        **found,
        "found_score": score,
        "reason": attempt.reason,
        "planned_m": round(path_length_m(attempt.path_world), 3),
    }


def _metres(p_world: FloatArray) -> list[float]:
    return [round(float(v), 4) for v in p_world]
