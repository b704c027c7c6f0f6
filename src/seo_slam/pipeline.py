"""SEO-SLAM's main loop: one frame in, one result out, nothing else happens (paper III-A, III-B)."""

import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from seo_slam.abstraction_host import Abstraction, NoAbstraction
from seo_slam.agent_host import AgentHost
from seo_slam.agents.message_tally import MessageTally
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.composition import Parts, compose
from seo_slam.config import Config
from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.keeping import Keeper
from seo_slam.map import Map
from seo_slam.map_document import Gravity
from seo_slam.mapping.duplicates import duplicate_pairs
from seo_slam.mapping.edit_desk import Judged
from seo_slam.mapping.edits import merge_landmarks
from seo_slam.mapping.keyframes import is_keyframe
from seo_slam.mapping.lifecycle import LifeCycle, SightingsOnly
from seo_slam.mapping.motion_chain import MotionChain
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView
from seo_slam.mapping.status_checks import StatusChecks
from seo_slam.mapping.watch import Watch
from seo_slam.measuring import Measuring
from seo_slam.perception.cut_boxes import completed
from seo_slam.records import EditRecord, MapEvent, StepResult, Trajectory
from seo_slam.run_result import RunResult
from seo_slam.stages import StageClock
from seo_slam.types import NEW, REJECTED, Association, Detections, Estimate, Frame, IntArray, Landmarks, Motion, Observations

LEVEL_FIRST_CAMERA = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""T_world_camera of a first camera of unknown pose: at the origin, looking along y, its image upright (z up if it is held level)."""


@dataclass(slots=True)
class _Counts:
    frames: int = 0
    lost_frames: int = 0
    detections: int = 0
    observations: int = 0
    warnings: MessageTally = field(default_factory=MessageTally)
    events: list[tuple[int, MapEvent]] = field(default_factory=list)


@dataclass(frozen=True, slots=True, eq=False)
class _KeyframeOutcome:
    detections: Detections
    observations: Observations
    association: Association
    landmark_ids: IntArray
    events: tuple[MapEvent, ...]
    edits: tuple[EditRecord, ...]


class Pipeline:
    """Odometry every frame; detection, lifting, association, smoothing and the object map on keyframes.

    Every part can be an object, a class (it is made with whatever of settings, solver and likelihood it takes), a registered name,
    "module:Class", or come from the configuration:

        with Pipeline(detector=my_detector, odometry=my_odometry) as pipeline:
            for result in pipeline.stream(frames):
                ...
            print(pipeline.result().map.landmarks)

    Args:
        config: a ``Config``, a nested mapping of its settings, or None for the defaults.
        detector: finds objects in the image; see ``interfaces.Detector`` for this one, and so on.
        odometry: says how the camera moved.
        associator: decides which landmark an observation belongs to.
        smoother: estimates poses and positions.
        embedder: turns labels into vectors.
        store: keeps every keyframe.
        agents: look at the map and propose edits, in the order of Fig 3; ``runner.mode`` says whether keyframes wait for them.
        map: an older map to continue; the first camera must be placed in its frame (recorded poses, or an initial pose).

    Raises:
        ConfigError, UnknownBackendError, MissingBackendError: a part cannot be made, or ``map`` is none.
    """

    def __init__(
        self,
        config: Config | Mapping[str, Any] | None = None,
        *,
        detector: Any = None,
        odometry: Any = None,
        associator: Any = None,
        smoother: Any = None,
        embedder: Any = None,
        store: Any = None,
        agents: Sequence[Any] | None = None,
        map: Map | None = None,
    ) -> None:
        self.config = config if isinstance(config, Config) else Config.from_dict(config or {})
        if not isinstance(map, Map | None):
            raise ConfigError(f"map: got {map!r:.60}, wanted a Map, as Map.load(folder) gives")
        given = {
            "detector": detector,
            "odometry": odometry,
            "associator": associator,
            "smoother": smoother,
            "embedder": embedder,
            "store": store,
        }
        self.parts: Parts = compose(self.config, given, agents)
        self._likelihood = LabelLikelihood(self.parts.embedder)
        self._old_map = None if map is None else map.with_embeddings(self.parts.embedder)
        next_id = max(self.parts.store.next_id(), 0 if map is None else map.next_id)
        self._objects = ObjectMap(self.config.map, self.parts.embedder.size, next_id, self.config.clouds)
        self._life: LifeCycle | SightingsOnly | StatusChecks = SightingsOnly(self._objects)
        if self.config.status.enabled:
            counts_misses = self.config.status.existence and self.config.life.enabled
            watch = Watch(self.config.lifting, self._objects, self.config.life.vanishing) if counts_misses else None
            self._life = StatusChecks(self.config.status, self._objects, self.parts.embedder, watch, self.config.life)
        elif self.config.life.enabled:
            self._life = LifeCycle(self.config.life, self.config.lifting, self._objects, self._likelihood)
        self._keeper = Keeper(self.parts, self._objects)
        self._agents = AgentHost(self.parts.agents, self.config, self._objects, self.parts.smoother, self.parts.embedder)
        self.clock = StageClock()
        self._abstraction: Abstraction | NoAbstraction = NoAbstraction()
        if self.config.layout.enabled:
            self._abstraction = Abstraction(self.config, self.parts.embedder)
        self._measuring = Measuring(self.config, self.parts, self.clock)
        self._counts = _Counts()
        self._since_keyframe = MotionChain()
        self._keyframe_stamp_s = 0.0
        self._last_stamp_s = -np.inf
        self._keyframes = 0
        self._closed = False
        kept = self.parts.store.keyframe_ids()
        self._first_keyframe_id = int(kept[-1]) + 1 if len(kept) else 0
        self._path: list[tuple[float, int, FloatArray]] = []  # stamp, keyframe, T_keyframe_frame
        self._gravity: Gravity = "unknown"

    @classmethod
    def from_preset(cls, name: str, **parts: Any) -> Self:
        """Compose a preset: "seo_slam" is the default, "seo_slam_paper_gate" the paper's fixed cosine, "nearest" the baseline, "dualmap"
        keeps clouds and an abstract map.
        """
        return cls(Config.preset(name), **parts)

    @classmethod
    def from_file(cls, path: str | Path, **parts: Any) -> Self:
        """Compose what a TOML or YAML file says."""
        return cls(Config.from_file(path), **parts)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Cancel questions that are still out, end the agents' thread, and release the store. The result can still be asked for."""
        self._closed = True
        try:
            self._agents.close()
            self._abstraction.close()
        finally:
            self.parts.store.close()

    def poll(self) -> tuple[EditRecord, ...]:
        """Apply what agents have answered since the last frame, when no frame comes; waits for nothing. Nothing comes once it is closed."""
        return self._amend(self._agents.poll(self._keyframe_id, self._last_stamp_s)) if self._is_open else ()

    def drain(self, timeout_s: float | None = None, stop: threading.Event | None = None) -> tuple[EditRecord, ...]:
        """Wait for the agents' last answers and apply them; to be called at the end of a recording, before ``result``.

        Args:
            timeout_s: at most so long (recorded seconds where time is virtual); None: ``runner.drain_s``.
            stop: ends the waiting when it is set, from another thread or a signal handler.
        """
        longest_s = self.config.runner.drain_s if timeout_s is None else timeout_s
        return self._amend(self._agents.drain(longest_s, self._keyframe_id, self._last_stamp_s, stop)) if self._is_open else ()

    @property
    def _is_open(self) -> bool:
        """Whether there is a keyframe, and a store, that an agent's edit could go to."""
        return bool(self._path) and not self._closed

    def _amend(self, judged: Judged) -> tuple[EditRecord, ...]:
        """Keep what agents changed between keyframes."""
        self._counts.warnings.add(judged.warnings)
        self._counts.events += [(self._keyframe_id, event) for event in judged.events]
        if judged.records:
            self._keeper.amend(self._keyframe_id, judged.events, judged.records)
        return tuple(judged.records)

    def stream(self, frames: Iterable[Frame]) -> Iterator[StepResult]:
        """Yield the result of each frame as it is done."""
        yield from map(self.step, frames)

    def step(self, frame: Frame) -> StepResult:
        """Process one frame.

        Raises:
            FrameError: time does not rise, or a detector returned what cannot be. The map has not changed then.
            OptimizationError: the factor graph has no solution.
        """
        if frame.timestamp_s <= self._last_stamp_s:
            raise FrameError(f"frame {frame.index}: time goes backwards, t={frame.timestamp_s} after t={self._last_stamp_s}")
        self._last_stamp_s = frame.timestamp_s
        clock = self.clock
        clock.start_frame()
        warnings: list[str] = []
        with clock.stage("odometry"):
            motion = self.parts.odometry.update(frame)
        if motion.status == "lost":
            self._counts.lost_frames += 1
            warnings.append(f"odometry is lost: {motion.message or 'no reason given'}")
        T_world_camera, outcome = LEVEL_FIRST_CAMERA, None
        if self._path or motion.status == "ok":
            T_world_camera, outcome = self._advance(frame, motion, warnings)
        else:
            warnings.append("left out: odometry has not found its first pose yet")
        self._counts.frames += 1
        self._counts.warnings.add(warnings)
        return StepResult(
            index=frame.index,
            timestamp_s=frame.timestamp_s,
            T_world_camera=T_world_camera,
            odometry_status=motion.status,
            keyframe_id=self._keyframe_id if outcome else None,
            detections=outcome.detections if outcome else None,
            observations=outcome.observations if outcome else None,
            association=outcome.association if outcome else None,
            landmark_ids=outcome.landmark_ids if outcome else None,
            events=outcome.events if outcome else (),
            edits=outcome.edits if outcome else (),
            warnings=tuple(warnings),
            seconds=clock.end_frame(),
        )

    def _advance(self, frame: Frame, motion: Motion, warnings: list[str]) -> tuple[FloatArray, _KeyframeOutcome | None]:
        """Move the camera, and map if the frame is a keyframe; return ``T_world_camera`` and what the keyframe did."""
        first, since = not self._path, self._since_keyframe
        if not first:
            since.add(motion)
        elapsed_s = frame.timestamp_s - self._keyframe_stamp_s
        if not first and not is_keyframe(since.T_keyframe_frame, elapsed_s, self.config.keyframes):
            self._path.append((frame.timestamp_s, self._keyframes - 1, since.T_keyframe_frame))
            return self._estimate.T_world_camera @ since.T_keyframe_frame, None
        detections, observations = self._measuring.measure(frame, warnings)
        if first:  # only now: a detector that fails on the first frame must leave no trace
            self._start(motion)
            self._placed(frame, motion)
            warnings += self._unlike_before()
        outcome = self._keyframe(frame, motion, detections, observations, warnings)
        return self._estimate.T_world_camera, outcome

    def _unlike_before(self) -> list[str]:
        """A warning where the map that is continued has features of another kind."""
        old, new = None if self._old_map is None else self._old_map.features, self._measuring.recipe
        if old is None or new is None or old.in_words == new.in_words:
            return []
        return [f"the map that is continued has features of {old.in_words}, new ones are of {new.in_words}: they hardly compare"]

    def _placed(self, frame: Frame, motion: Motion) -> None:
        """Go on from a keyframe that is in the graph now; from here on a part that raises cannot tear graph and path apart."""
        self._keyframes += 1
        self._keyframe_stamp_s = frame.timestamp_s
        self._path.append((frame.timestamp_s, self._keyframes - 1, np.eye(4)))
        self._since_keyframe.restart(motion)

    @property
    def _keyframe_id(self) -> int:
        return self._first_keyframe_id + self._keyframes - 1

    def result(self) -> RunResult:
        """Return the map and trajectory so far, the abstract map with it where a layout is kept; can be asked for at any time."""
        counts = self._counts
        poses = self.parts.smoother.poses() if self._path else np.zeros((0, 4, 4))
        concrete = self.snapshot()
        before = None if self._old_map is None else self._old_map.abstract
        abstract = self._abstraction.abstract(concrete.landmarks, poses, before, concrete.tentative) if self._path else before
        counts.warnings.add(self._abstraction.take_warnings())
        all_poses = [poses[keyframe] @ T for _, keyframe, T in self._path]
        return RunResult(
            map=concrete.with_abstract(abstract),
            trajectory=Trajectory(
                timestamps_s=np.array([stamp for stamp, _, _ in self._path], dtype=np.float64),
                T_world_camera=np.array(all_poses, dtype=np.float64).reshape(len(all_poses), 4, 4),
            ),
            frames=counts.frames,
            keyframes=self._keyframes,
            lost_frames=counts.lost_frames,
            detections=counts.detections,
            observations=counts.observations,
            warnings=counts.warnings.as_dict(),
            seconds=self.clock.summary(),
            events=tuple(counts.events),
            agents=self._agents.counts(),
        )

    def snapshot(self) -> Map:
        """Return an immutable copy of the map as it is now."""
        if not self._path and self._old_map is not None:
            return self._old_map
        rows = self._objects.rows(self.parts.smoother) if self._path else []
        return Map(rows, self._gravity, self.parts.embedder.name, self._objects.next_id, features=self._measuring.recipe)

    def _start(self, motion: Motion) -> None:
        """Place the first camera, and the landmarks of a map that is continued."""
        self._gravity = "unknown" if motion.T_world_camera is None else "poses"
        T_world_camera = LEVEL_FIRST_CAMERA if motion.T_world_camera is None else motion.T_world_camera
        sigmas = [np.radians(self.config.graph.first_pose_sigma_deg)] * 3 + [self.config.graph.first_pose_sigma_m] * 3
        old = None
        if self._old_map is not None:
            rows = [*self._old_map.landmarks, *self._old_map.tentative]
            for row in rows:
                self._objects.restore(row, T_world_camera)
            old = Landmarks.from_rows(rows)
        self._estimate: Estimate = self.parts.smoother.start(T_world_camera, np.diag(np.square(sigmas)), old)
        for key, value in (("gravity", self._gravity), ("embedder", self.parts.embedder.name), ("next_id", str(self._objects.next_id))):
            self.parts.store.set_meta(key, value)

    def _keyframe(
        self, frame: Frame, step: Motion, detections: Detections, observations: Observations, warnings: list[str]
    ) -> _KeyframeOutcome:
        """Associate, smooth, map, edit, keep; ``step`` is the frame's own motion."""
        clock, parts, motion = self.clock, self.parts, self._since_keyframe.motion
        with clock.stage("associate"):
            predicted = self._estimate if motion is None else parts.smoother.predict(motion)
            association = parts.associator.associate(observations, self._objects.landmarks(parts.smoother), predicted)
            landmark_ids = association.landmark_ids.copy()
            if motion is not None and motion.status == "lost":  # a guessed camera places nothing new
                landmark_ids[landmark_ids == NEW] = REJECTED
            landmark_ids[landmark_ids == NEW] = self._objects.new_ids(int((landmark_ids == NEW).sum()))
            used = landmark_ids != REJECTED
        with clock.stage("smooth"):
            whole = self._completed(observations[used], landmark_ids[used])
            self._estimate = parts.smoother.update(motion, whole, landmark_ids[used])
        if motion is not None:
            self._placed(frame, step)
        lost = motion is not None and motion.status == "lost"  # a guessed camera places and misses nothing
        with clock.stage("map"):
            events = self._integrate(frame, observations[used], landmark_ids[used], placed=not lost)
        if not lost:
            with clock.stage("scene"):
                warnings += self._abstraction.see(frame, self._estimate.T_world_camera, self._keyframes - 1)
        with clock.stage("life"):
            depth_m = np.zeros_like(frame.depth_m) if lost else frame.depth_m
            view = DepthView(frame.camera, depth_m, self._estimate.T_world_camera, frame.timestamp_s)
            events += self._life.step(view, _after_merges(landmark_ids[used], events), parts.smoother)
        edits: list[EditRecord] = []
        if parts.agents:
            with clock.stage("agents"):
                judged = self._agents.step(frame, self._estimate.T_world_camera, self._keyframe_id, events)
            events, edits = events + judged.events, judged.records
            warnings += judged.warnings
        with clock.stage("store"):
            self._keeper.keep(
                self._keyframe_id, frame.timestamp_s, self._estimate, motion, observations[used], landmark_ids[used], events, edits
            )
        self._counts.detections += len(detections)
        self._counts.observations += len(observations)
        self._counts.events += [(self._keyframe_id, event) for event in events]
        return _KeyframeOutcome(detections, observations, association, landmark_ids, tuple(events), tuple(edits))

    def _integrate(self, frame: Frame, observations: Observations, landmark_ids: IntArray, placed: bool) -> list[MapEvent]:
        """Fold the measurements into what is known of the things, and doubles into one."""
        ids, p_world = self.parts.smoother.positions()
        own = p_world[np.searchsorted(ids, landmark_ids)]
        poses = self.parts.smoother.poses() if self.config.clouds.enabled else None
        events = self._objects.integrate(observations, landmark_ids, self._estimate.T_world_camera, frame.timestamp_s, own, poses, placed)
        if self.config.map.merge_duplicates:
            events += self._merge_duplicates(frame, landmark_ids)
        return events

    def _completed(self, observations: Observations, landmark_ids: IntArray) -> Observations:
        """Measure the centre of the whole thing where the image border cuts a box."""
        across_m = self._objects.across_m(landmark_ids)
        p_camera, cov_camera = completed(
            observations.p_camera, observations.cov_camera, observations.size_m, observations.truncated, across_m
        )
        return replace(observations, p_camera=p_camera, cov_camera=self.config.graph.views_that_err_together * cov_camera)

    def _merge_duplicates(self, frame: Frame, seen_now: IntArray) -> list[MapEvent]:
        ids, p_world = self.parts.smoother.positions()
        pairs = duplicate_pairs(self._objects, ids, p_world, seen_now, self._likelihood, self._estimate.T_world_camera, frame.camera)
        return [merge_landmarks(keep_id, drop_id, self._objects, self.parts.smoother) for keep_id, drop_id in pairs]


def _after_merges(landmark_ids: IntArray, events: Sequence[MapEvent]) -> IntArray:
    """Which landmarks those are now: a half that was seen and merged into a whole is a sight of the whole."""
    became = {event.landmark_id: event.other_id for event in events if event.kind == "merged"}
    return np.array([became.get(int(i), int(i)) for i in landmark_ids], dtype=np.int64)
