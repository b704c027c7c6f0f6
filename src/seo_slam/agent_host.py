"""Between the pipeline and its agents: makes views, lets them be asked about, and has the answers judged."""

import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from seo_slam.agents.answers import Answer
from seo_slam.agents.background import BackgroundRunner
from seo_slam.agents.projection import visible_boxes
from seo_slam.agents.runner import AgentRunner, InlineRunner, VirtualTimeRunner
from seo_slam.config import Config, RunnerSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Agent, AgentView, Embedder, Evidence, Smoother
from seo_slam.mapping.edit_desk import EditDesk, Judged
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.perception.labels import clean_label
from seo_slam.records import MapEvent, Relabel
from seo_slam.types import Frame, IntArray, Landmarks

_RUNNERS: dict[str, Callable[[Sequence[Agent], RunnerSettings], AgentRunner]] = {"inline": InlineRunner, "virtual": VirtualTimeRunner}


MOST_AGES = 10_000
"""Ages of verdicts, of the newest ones, that are kept for the counts."""


class AgentHost:
    """All that a pipeline has to do with agents."""

    def __init__(self, agents: Sequence[Agent], config: Config, objects: ObjectMap, smoother: Smoother, embedder: Embedder) -> None:
        """Take the agents, and what they may change."""
        self._agents = tuple(agents)
        self._lifting = config.lifting
        self._objects = objects
        self._smoother = smoother
        self._embedder = embedder
        self._runner: AgentRunner = make_runner(agents, config.runner, self._learn_labels)
        self._desk = EditDesk(config.edits, objects, smoother, embedder)
        self._outcomes: Counter[tuple[str, str, str]] = Counter()
        self._ages_s: deque[float] = deque(maxlen=MOST_AGES)

    def step(self, frame: Frame, T_world_camera: FloatArray, keyframe_id: int, events: Sequence[MapEvent] = ()) -> Judged:
        """Judge what has come, hand out a new view if it is wanted, and judge what came of that at once.

        A view is also handed out, whatever their pace, when ``events`` say that a landmark became stable: it is to be seen here, and
        perhaps not in the next view.
        """
        self._desk.follow(events)
        judged = self.poll(keyframe_id, frame.timestamp_s)
        anything_new = any(event.kind in ("stable", "found") for event in events)
        if frame.has_depth and (anything_new or self._runner.wants_view(frame.timestamp_s)):
            self._runner.show(self._view(frame, T_world_camera, keyframe_id))
            later = self.poll(keyframe_id, frame.timestamp_s)
            judged.add(later)
        return judged

    def poll(self, keyframe_id: int, now_s: float) -> Judged:
        """Judge what has come since the last time; waits for nothing."""
        return self._judge(self._runner.poll(now_s), keyframe_id, now_s)

    def drain(self, timeout_s: float, keyframe_id: int, now_s: float, stop: threading.Event | None = None) -> Judged:
        """Wait for the answers still out, at most so long, and judge them, quota or not."""
        judged = self._judge(self._runner.drain(timeout_s, stop), keyframe_id, now_s, heed_quota=False)
        out = self._runner.out
        if out and not (stop is not None and stop.is_set()):
            judged.warnings.append(f"agents: no answer to {out} question{'s' * (out > 1)} within {timeout_s:g} s of the last frame")
        return judged

    def close(self) -> bool:
        """Cancel what is out and end the thread; True if it has ended."""
        return self._runner.close()

    def counts(self) -> dict[str, Any]:
        """Return how often agents were asked, with what result, and what became of their proposals; empty if there are none."""
        if not self._agents:
            return {}
        outcomes = [
            {"agent": agent, "kind": kind, "outcome": outcome, "number": number}
            for (agent, kind, outcome), number in sorted(self._outcomes.items())
        ]
        ages = np.array(self._ages_s) if self._ages_s else np.zeros(1)
        age = {"p50": round(float(np.median(ages)), 6), "max": round(float(ages.max()), 6)}
        return {**self._runner.counts(), "edits": outcomes, "age_s": age}

    def _judge(self, answers: Sequence[Answer], keyframe_id: int, now_s: float, *, heed_quota: bool = True) -> Judged:
        proposals = [proposal for answer in answers for proposal in answer.proposals]
        judged = self._desk.judge(proposals, keyframe_id, now_s, heed_quota=heed_quota)
        judged.warnings[:0] = [answer.problem for answer in answers if answer.problem]
        for record in judged.records:
            self._outcomes[record.agent, record.kind, record.outcome] += 1
            self._ages_s.append(record.timestamp_s - record.view_s)
        return judged

    def _learn_labels(self, answer: Answer) -> None:
        """Embed new labels in the agents' thread: a text model takes milliseconds a label, and remembers it for the robot's loop."""
        for edit in answer.edits:
            if isinstance(edit, Relabel) and (label := clean_label(edit.label)) is not None:
                self._embedder.embed_text([label])

    def _view(self, frame: Frame, T_world_camera: FloatArray, keyframe_id: int) -> AgentView:
        every = self._objects.landmarks(self._smoother)
        stable = every[np.array([state == "stable" for state in every.states], dtype=np.bool_)]
        surfaces = self._surfaces(stable, T_world_camera)
        lifting = self._lifting
        boxes_px = visible_boxes(
            stable,
            frame,
            T_world_camera,
            surfaces,
            max_depth_m=lifting.max_depth_m,
            depth_noise_at_1m_m=lifting.depth_noise_at_1m_m,
        )
        evidence = {i: self._evidence(i, surfaces.get(i, np.zeros((0, 3))), list(boxes_px)) for i in boxes_px}
        return AgentView(frame, T_world_camera, stable, boxes_px, keyframe_id, evidence=evidence)

    def _surfaces(self, landmarks: Landmarks, T_world_camera: FloatArray) -> dict[int, FloatArray]:
        """Points of the surface of those near enough to be looked at."""
        away_m = np.linalg.norm(landmarks.p_world - T_world_camera[:3, 3], axis=1)
        near: IntArray = np.flatnonzero(away_m <= 2.0 * self._lifting.max_depth_m)
        things = [(int(landmarks.ids[row]), landmarks.p_world[row]) for row in near]
        return {i: p_world + self._objects[i].surface() for i, p_world in things if self._objects[i].surface_views}

    def _evidence(self, landmark_id: int, surface_world: FloatArray, shown: Sequence[int]) -> Evidence:
        thing = self._objects[landmark_id]
        sightings = thing.sightings
        apart = {other: self._objects.times_apart(landmark_id, other) for other in shown if other != landmark_id}
        return Evidence(
            existence=thing.existence,
            hits=sightings.hits,
            misses=sightings.misses + sightings.tail,
            weights=dict(thing.weights),
            surface_world=surface_world,
            seen_apart={other: times for other, times in apart.items() if times},
            is_new=self._desk.is_new(landmark_id),
        )


def make_runner(agents: Sequence[Agent], settings: RunnerSettings, think_ahead: Callable[[Answer], None] | None = None) -> AgentRunner:
    """Return the runner of a mode; in the background, ``think_ahead`` is called in its thread with each answer."""
    if settings.mode == "background":
        return BackgroundRunner(agents, settings, think_ahead)
    return _RUNNERS[settings.mode](agents, settings)
