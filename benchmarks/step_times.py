"""What agents cost the robot's loop: step times with agents on and off, frame by frame in turn, each in a process of its own.

In one process the background thread of the agents would slow the pipeline without agents too, and hide what it costs.
"""

import gc
import multiprocessing
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from agent_rows import Model, Row, asking, server_options
from long_walk import looked_at, walk_of
from model_process import START_S, model_process
from simulated_runs import Job, embedder_of

from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Config
from seo_slam.pipeline import Pipeline

LEFT_OUT = 12
"""Frames at the start that are not counted: models and libraries load."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How the two pipelines are stepped.

    Attributes:
        frames: how many.
        rate_hz: frames a second; 0: one after the other.
        latency_s: of the simulated model, seconds.
        in_flight: questions at once.
    """

    frames: int
    rate_hz: float
    latency_s: float
    in_flight: int


@dataclass(frozen=True, slots=True)
class Stepped:
    """One frame: wall seconds of its step, whether it was a keyframe, and seconds a stage."""

    seconds: float
    is_keyframe: bool
    stages: dict[str, float]


def step_times(job: Job, config: Config, pace: Pace) -> dict[str, Any]:
    """Step two pipelines through the same frames in turn, the order changing from frame to frame."""
    model = Model("heavy", pace.latency_s)
    row = Row("on", model, model, pace.in_flight)
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        models = stack.enter_context(model_process(job, pace.frames, config))
        url = models.serve(**server_options(model, 1.0))
        configs = {"on": asking(config, row, {model.name: url}, 60.0, 1.0), "off": config}
        connections: dict[str, Connection] = {}
        for name, of_side in configs.items():
            connections[name], there = context.Pipe()
            process = context.Process(target=_step_when_told, args=(there, job, of_side, pace.frames), name=name, daemon=True)
            process.start()
            there.close()
            stack.callback(_end, process)
        for connection in connections.values():
            if not connection.poll(START_S) or connection.recv() != "ready":
                raise RuntimeError("a pipeline did not come up")
        steps = _in_turn(connections, pace)
        agents = {name: _asked(connection, "end") for name, connection in connections.items()}
        models.end(url)
    return compared(steps, agents, pace)


def compared(steps: dict[str, list[Stepped]], agents: dict[str, Any], pace: Pace) -> dict[str, Any]:
    """Return percentiles of both sides and their ratios, of all frames and of keyframes alone."""
    counted = {name: side[LEFT_OUT:] if len(side) > 2 * LEFT_OUT else side for name, side in steps.items()}
    every = {name: [step.seconds for step in side] for name, side in counted.items()}
    keyframes = {name: [step.seconds for step in side if step.is_keyframe] for name, side in counted.items()}
    stages = {name: _percentiles([step.stages.get("agents", 0.0) for step in side if step.is_keyframe]) for name, side in counted.items()}
    return {
        "all_frames": _sides(every),
        "keyframes": _sides(keyframes),
        "agents_stage_ms": stages["on"],
        "frames": len(every["on"]),
        "keyframes_counted": len(keyframes["on"]),
        "rate_hz": pace.rate_hz,
        "latency_s": pace.latency_s,
        "in_flight": pace.in_flight,
        "wanted": {"p50": 1.05, "p99": 1.25},
        "agents": agents["on"],
    }


def _sides(seconds: dict[str, list[float]]) -> dict[str, Any]:
    on, off = _percentiles(seconds["on"]), _percentiles(seconds["off"])
    ratio = {name: round(on[name] / off[name], 3) if off[name] else None for name in on}
    holds = all(found is not None and found <= most for found, most in ((ratio["p50"], 1.05), (ratio["p99"], 1.25)))
    return {"on_ms": on, "off_ms": off, "ratio": ratio, "holds": holds}


def _percentiles(seconds: Sequence[float]) -> dict[str, float]:
    ms = 1e3 * np.array(seconds or [0.0])
    return {
        "p50": round(float(np.median(ms)), 4),
        "p90": round(float(np.percentile(ms, 90)), 4),
        "p99": round(float(np.percentile(ms, 99)), 4),
        "mean": round(float(ms.mean()), 4),
    }


def _in_turn(connections: dict[str, Connection], pace: Pace) -> dict[str, list[Stepped]]:
    steps: dict[str, list[Stepped]] = {name: [] for name in connections}
    began_s = time.monotonic()
    for index in range(pace.frames):
        if pace.rate_hz:
            time.sleep(max(began_s + index / pace.rate_hz - time.monotonic(), 0.0))
        for name in list(connections) if index % 2 == 0 else list(connections)[::-1]:
            steps[name].append(_asked(connections[name], index))
    return steps


def _end(process: Any) -> None:
    process.join(5.0)
    process.kill()
    process.join()


def _asked(connection: Connection, message: Any) -> Any:
    connection.send(message)
    return connection.recv()


def _step_when_told(connection: Connection, job: Job, config: Config, count: int) -> None:
    """In the process of one pipeline: draw all frames, then step each one when told."""
    walk = walk_of(job, count)
    frames = walk.frames(looked_at(walk, config))
    pipeline = Pipeline(
        config,
        detector=walk.detector,
        odometry=RecordedOdometry(walk.odometry),
        embedder=embedder_of(config.embedder.model_dump_json()),
    )
    gc.collect()
    gc.freeze()  # the frames that wait here are no part of a robot's memory
    connection.send("ready")
    while (message := connection.recv()) != "end":
        begin_s = time.perf_counter()
        step = pipeline.step(frames[message])
        connection.send(Stepped(time.perf_counter() - begin_s, step.is_keyframe, dict(step.seconds)))
    connection.send(pipeline.result().agents)
    pipeline.close()
