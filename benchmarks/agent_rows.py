"""One row of the agents' throughput: a pipeline that is shown a long walk as time goes by, with agents that ask over sockets."""

import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from long_walk import LongWalk
from model_process import ModelProcess
from simulated_runs import embedder_of

from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Config, chat_agents
from seo_slam.pipeline import Pipeline
from seo_slam.testing.chat_limits import Seen, most_requests, most_tokens
from seo_slam.types import Frame

MINUTE_S = 60.0
LOOK_EVERY = 12  # frames


@dataclass(frozen=True, slots=True)
class Model:
    """A simulated model as its user sees it.

    Attributes:
        name: of it.
        latency_s: from question to answer, seconds before scaling.
        requests, tokens: limits a minute; None: none.
    """

    name: str
    latency_s: float
    requests: int | None = None
    tokens: int | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return what a result states."""
        return {"name": self.name, "latency_s": self.latency_s, "requests_per_minute": self.requests, "tokens_per_minute": self.tokens}


@dataclass(frozen=True, slots=True)
class Row:
    """What is measured.

    Attributes:
        name: for people.
        verifying: the model of the verification agent.
        others: that of description and merging; the same object: one model.
        in_flight: questions at once; 1: each waits for the one before.
    """

    name: str
    verifying: Model
    others: Model
    in_flight: int

    @property
    def models(self) -> tuple[Model, ...]:
        """Each once."""
        return (self.verifying,) if self.verifying == self.others else (self.verifying, self.others)


@dataclass(frozen=True, slots=True)
class Stage:
    """Where rows are played.

    Attributes:
        walk, frames: what is seen.
        models: serves the simulated models.
        base: settings without agents.
        scale: wall seconds a second of the walk.
        patience_s: 0: a window ends when its time is up; else the walk goes to its end, however late, and the last answers are waited
            for, at most so long.
    """

    walk: LongWalk
    frames: Sequence[Frame]
    models: ModelProcess
    base: Config
    scale: float
    patience_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Passed:
    """How a window went by: its wall seconds, by how many the loop was late at worst, and (wall seconds, landmarks done) now and then."""

    wall_s: float
    behind_s: float
    done: tuple[tuple[float, int], ...]

    def seconds_to(self, landmarks: int) -> float | None:
        """Return when so many landmarks were done, between two looks; None: never."""
        before = (0.0, 0)
        for at in self.done:
            if at[1] >= landmarks:
                share = (landmarks - before[1]) / max(at[1] - before[1], 1)
                return before[0] + share * (at[0] - before[0])
            before = at
        return None


@dataclass(frozen=True, slots=True)
class Played:
    """What one window came to.

    Attributes:
        row: what was played.
        passed: how its window went by.
        agents: counts of runner and host, as in ``run.json``.
        logs: model -> what its server saw.
        ended_s: model -> when the window ended, seconds since its server was started.
        keyframes, stable: of the loop; landmarks in the map at the end.
    """

    row: Row
    passed: Passed
    agents: Mapping[str, Any]
    logs: Mapping[str, tuple[Seen, ...]]
    ended_s: Mapping[str, float]
    keyframes: int
    stable: int


def play(stage: Stage, row: Row) -> Played:
    """Show the walk at its pace until its end, and count what agents did meanwhile."""
    window_s = MINUTE_S * stage.scale
    urls, started_s = {}, {}
    for model in row.models:
        urls[model.name] = stage.models.serve(**server_options(model, stage.scale))
        started_s[model.name] = time.monotonic()
    try:
        pipeline = Pipeline(
            asking(stage.base, row, urls, window_s, stage.scale),
            detector=stage.walk.detector,
            odometry=RecordedOdometry(stage.walk.odometry),
            embedder=embedder_of(stage.base.embedder.model_dump_json()),
        )
        with pipeline:
            passed = pass_by(pipeline, stage.frames, stage.scale, stage.patience_s)
            ended_s = {name: time.monotonic() - began_s for name, began_s in started_s.items()}
            result = pipeline.result()
    finally:
        logs = {name: stage.models.end(url) for name, url in urls.items()}
    return Played(row, passed, result.agents, logs, ended_s, result.keyframes, len(result.map.landmarks))


def pass_by(pipeline: Pipeline, frames: Sequence[Frame], scale: float, patience_s: float = 0.0) -> Passed:
    """Step each frame when its time has come, until the time of the last one; a loop that cannot keep up leaves out the end of the walk."""
    first_s, began_s, behind_s = frames[0].timestamp_s, time.monotonic(), 0.0
    window_s = scale * (frames[-1].timestamp_s - first_s)
    done: list[tuple[float, int]] = []
    for number, frame in enumerate(frames, start=1):
        ahead_s = began_s + scale * (frame.timestamp_s - first_s) - time.monotonic()
        behind_s = max(behind_s, -ahead_s)
        if ahead_s > 0:
            time.sleep(ahead_s)
        pipeline.step(frame)
        if number % LOOK_EVERY == 0:
            done.append(_done_by_now(pipeline, began_s))
        if time.monotonic() - began_s >= window_s and not patience_s:
            break
    pipeline.drain(patience_s)
    done.append(_done_by_now(pipeline, began_s))
    return Passed(done[-1][0], behind_s, tuple(done))


def _done_by_now(pipeline: Pipeline, began_s: float) -> tuple[float, int]:
    return time.monotonic() - began_s, int(pipeline.result().agents["landmarks_done"])


def server_options(model: Model, scale: float) -> dict[str, Any]:
    """Return the options of a model's server, in scaled time."""
    return {
        "latency_s": scale * model.latency_s,
        "model": model.name,
        "requests_per_minute": model.requests,
        "tokens_per_minute": model.tokens,
        "window_s": MINUTE_S * scale,
    }


def asking(base: Config, row: Row, urls: Mapping[str, str], window_s: float, scale: float) -> Config:
    """Return the settings of a row: its agents ask these servers, in the background, and keep their limits."""

    def options(model: Model) -> dict[str, Any]:
        return {
            "model": model.name,
            "base_url": urls[model.name],
            "reply_format": "json_schema",
            "requests_per_minute": model.requests,
            "tokens_per_minute": model.tokens,
            "window_s": window_s,
            "timeout_s": max(30.0 * scale, 5.0),
            "cache": False,
        }

    agents = chat_agents(options(row.verifying), options(row.others))
    return base.updated({"agents": agents, "runner": {"mode": "background", "in_flight": row.in_flight}}, "agent throughput")


def figures_of(played: Sequence[Played], scale: float) -> dict[str, Any]:
    """Return the figures of a row, of all its windows together. Seconds are those of the walk: wall seconds over the scale."""
    row, wall_s = played[0].row, sum(one.passed.wall_s for one in played)
    done = sum(one.agents["landmarks_done"] for one in played)
    seen = [request for one in played for log in one.logs.values() for request in log]
    answered = [request for request in seen if request.status == 200]
    return {
        "in_flight": row.in_flight,
        "verification": row.verifying.as_dict(),
        "description_and_merging": row.others.as_dict(),
        "landmarks": done,
        "wall_s": round(wall_s, 3),
        "landmarks_per_wall_s": round(done / wall_s, 3),
        "landmarks_per_180_s": round(180.0 * done * scale / wall_s, 1),
        "seconds_per_landmark": round(wall_s / scale / done, 4) if done else None,
        "questions": {role: sum(request.role == role for request in answered) for role in ("verification", "description", "merging")},
        "refused_429": sum(request.status == 429 for request in seen),
        "failed": sum(agent["failed"] for one in played for agent in one.agents["agents"]),
        "tokens": sum(request.tokens for request in answered),
        "tokens_per_landmark": round(sum(request.tokens for request in answered) / done, 1) if done else None,
        "mean_in_flight": round(sum(request.seconds for request in answered) / wall_s, 2),
        "superseded": sum(one.agents["superseded"] for one in played),
        "dropped": sum(one.agents["dropped"] for one in played),
        "verdicts": verdicts_of(played),
        "age_s": {
            "p50": round(statistics.median(one.agents["age_s"]["p50"] for one in played), 3),
            "max": round(max(one.agents["age_s"]["max"] for one in played), 3),
        },
        "loop_behind_s": round(max(one.passed.behind_s for one in played) / scale, 3),
        "keyframes": sum(one.keyframes for one in played),
        "landmarks_in_map": [one.stable for one in played],
    }


def verdicts_of(played: Sequence[Played]) -> dict[str, Any]:
    """Return how many verdicts came to the map, and what became of them."""
    outcomes: dict[str, int] = {}
    for one in played:
        for entry in one.agents["edits"]:
            outcomes[entry["outcome"]] = outcomes.get(entry["outcome"], 0) + entry["number"]
    total = sum(outcomes.values())
    return {"number": total, **outcomes, "share_stale": round(outcomes.get("stale", 0) / total, 4) if total else None}


def use_of_limits(played: Played, scale: float) -> dict[str, Any]:
    """Return how much of its one model's limits a row used, by the server's log, from the first question to the end of the window.

    ``most_in_a_minute`` is of any sliding minute (scaled), ``allowed`` the limit times the minutes that went by.
    """
    (model,) = played.row.models
    log, window_s = played.logs[model.name], MINUTE_S * scale
    let_in = [request for request in log if request.status != 429]
    minutes = (played.ended_s[model.name] - let_in[0].time_s) / window_s if let_in else 0.0
    out: dict[str, Any] = {"minutes": round(minutes, 3), "refused_429": len(log) - len(let_in)}
    sides = {
        "requests": (model.requests, len(let_in), most_requests(log, window_s)),
        "tokens": (model.tokens, sum(request.tokens for request in let_in), most_tokens(log, window_s)),
    }
    for name, (limit, used, most) in sides.items():
        if limit is not None:
            allowed = limit * minutes
            out[name] = {
                "limit_a_minute": limit,
                "most_in_a_minute": most,
                "never_over": most <= limit,
                "used": used,
                "allowed": round(allowed, 1),
                "ratio": round(used / allowed, 4) if allowed else None,
            }
    return out
