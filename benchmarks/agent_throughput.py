"""Agents' throughput (SEO-SLAM, Table IV), protocol agents/1, and what they cost the robot's loop. Prints one JSON object.

python benchmarks/agent_throughput.py [--room LG1] [--seed 0] [--meshes DIR] [--window 36] [--parts rows,flight,limits,steps] [--out DIR]

Real time, real threads, real sockets; the models are simulated, in a process of their own. A window is the paper's 180 s, played faster:
latencies, "minutes" of rate limits and the robot's walk are all scaled alike, and figures are given in unscaled seconds. Step times are
not scaled.
"""

import argparse
import dataclasses
import json
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from agent_rows import Model, Played, Row, Stage, figures_of, play, use_of_limits
from long_walk import looked_at, walk_of
from model_process import model_process
from run_options import frozen_level, rooms_from, size_from
from simulated_models import ModelKnobs
from simulated_runs import Job, settings_of
from step_times import Pace, step_times

from seo_slam.config import Config
from seo_slam.errors import ConfigError, SeoSlamError
from seo_slam.simulation.mesh_library import MeshLibrary

PROTOCOL = "agents/1"
PAPER = {"sync, one model": 116, "sync, two models": 120, "async, two models": 290}
"""Landmarks in 180 s of LG1, Table IV."""
PAPER_WINDOW_S = 180.0
FRAME_RATE_HZ = 6.0
PARTS = ("rows", "flight", "limits", "steps")

Rows = dict[str, Row]


def table_rows(given: argparse.Namespace) -> Rows:
    """Return the three rows of Table IV: the heavy model alone; a light one verifies; and both with many questions at once."""
    heavy = Model("heavy", given.latency, given.rpm, given.tpm)
    light = Model("light", given.light_latency, given.rpm, given.tpm)
    rows = (
        Row("sync, one model", heavy, heavy, 1),
        Row("sync, two models", light, heavy, 1),
        Row("async, two models", light, heavy, given.in_flight),
    )
    return {row.name: row for row in rows}


def flight_rows(given: argparse.Namespace) -> Rows:
    """Return one model without limits, asked one by one and many at once."""
    model = Model("heavy", given.latency)
    return {row.name: row for row in (Row("sync", model, model, 1), Row("async", model, model, given.in_flight))}


def limit_rows(given: argparse.Namespace) -> Rows:
    """Return one model bound by its requests, and one bound by its tokens."""
    by_requests = Model("heavy", given.light_latency, given.bound_rpm)
    by_tokens = Model("heavy", given.light_latency, None, given.bound_tpm)
    rows = (
        Row("bound by requests", by_requests, by_requests, given.in_flight),
        Row("bound by tokens", by_tokens, by_tokens, given.in_flight),
    )
    return {row.name: row for row in rows}


def played_in_turn(stage: Stage, rows: Rows, rounds: int) -> dict[str, list[Played]]:
    """Play rows in turn, the other way round every other time."""
    played: dict[str, list[Played]] = {name: [] for name in rows}
    for number in range(rounds):
        for name in list(rows) if number % 2 == 0 else list(rows)[::-1]:
            played[name].append(play(stage, rows[name]))
            done = played[name][-1].agents["landmarks_done"]
            print(f"{name}, round {number + 1}/{rounds}: {done} landmarks", file=sys.stderr)
    return played


def table(stage: Stage, given: argparse.Namespace) -> dict[str, Any]:
    """Table IV."""
    rows = {name: figures_of(played, stage.scale) for name, played in played_in_turn(stage, table_rows(given), given.rounds).items()}
    one, two, many = (rows[name]["landmarks_per_180_s"] for name in PAPER)
    return {
        "rows": rows,
        "ratio": {"async_to_sync_two_models": quotient(many, two), "two_models_to_one": quotient(two, one)},
        "paper": {"landmarks": PAPER, "async_to_sync_two_models": round(290 / 120, 3), "two_models_to_one": round(120 / 116, 3)},
    }


def flight(stage: Stage, given: argparse.Namespace) -> dict[str, Any]:
    """Many questions at once against one by one, without limits."""
    played = played_in_turn(stage, flight_rows(given), given.rounds)
    sides = {name: figures_of(windows, stage.scale) for name, windows in played.items()}
    ratio = quotient(sides["async"]["landmarks_per_wall_s"], sides["sync"]["landmarks_per_wall_s"])
    questions = {name: sum(side["questions"].values()) / side["wall_s"] for name, side in sides.items()}
    same = same_work(played["sync"][0], played["async"][0], stage.scale)
    return {
        **sides,
        "ratio": ratio,
        "ratio_of_questions": quotient(questions["async"], questions["sync"]),
        "same_landmarks": same,
        "wanted": 5.0,
        "holds": all(found is not None and found >= 5.0 for found in (ratio, same["ratio"])),
    }


def same_work(one_by_one: Played, many: Played, scale: float) -> dict[str, Any]:
    """Return how long each took for as many landmarks as the slower one did in all."""
    landmarks = int(one_by_one.agents["landmarks_done"])
    slow_s, fast_s = one_by_one.passed.seconds_to(landmarks), many.passed.seconds_to(landmarks)
    if slow_s is None or fast_s is None:
        return {"landmarks": landmarks, "sync_s": None, "async_s": None, "ratio": None}
    return {
        "landmarks": landmarks,
        "sync_s": round(slow_s / scale, 2),
        "async_s": round(fast_s / scale, 2),
        "ratio": quotient(slow_s, fast_s),
    }


def limits(stage: Stage, given: argparse.Namespace) -> dict[str, Any]:
    """What is used of a limit, and whether it was ever passed."""
    out: dict[str, Any] = {}
    for (name, (played,)), bound in zip(played_in_turn(stage, limit_rows(given), 1).items(), ("requests", "tokens"), strict=True):
        use = use_of_limits(played, stage.scale)
        side = use[bound]
        holds = side["never_over"] and side["ratio"] is not None and side["ratio"] >= 0.95
        out[name] = {**use, "holds": holds, "row": figures_of([played], stage.scale)}
    return {**out, "wanted": 0.95}


def quotient(a: float, b: float) -> float | None:
    """Return a / b, None of nothing."""
    return round(a / b, 3) if b else None


def measured(job: Job, given: argparse.Namespace) -> dict[str, Any]:
    """Measure the parts that are asked for."""
    config = job.variants["RG+D+L"]
    result: dict[str, Any] = {}
    if {"rows", "flight", "limits"} & set(given.parts):
        frames = round(PAPER_WINDOW_S * FRAME_RATE_HZ)
        walk = walk_of(job, frames)
        wanted = looked_at(walk, config)
        with model_process(job, frames, config) as models:
            stage = Stage(walk, walk.frames(wanted), models, config, given.window / PAPER_WINDOW_S)
            for part, measure in (("rows", table), ("flight", flight), ("limits", limits)):
                if part in given.parts:
                    result["table_iv" if part == "rows" else part] = measure(stage, given)
    if "steps" in given.parts:
        pace = Pace(given.step_frames, given.step_rate, given.latency, given.in_flight)
        result["step_time"] = step_times(job, config, pace)
    return result


def options() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--room", default="LG1")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--meshes", metavar="DIR", help="folder of meshes; without: primitives of like size")
    parser.add_argument("--level", type=float, help="of the detector's and sensors' errors; default: the frozen one")
    parser.add_argument("--size", default="320x240", metavar="WxH", help="of the images")
    parser.add_argument("--parts", default=",".join(PARTS), help="some of " + ",".join(PARTS))
    parser.add_argument("--window", type=float, default=36.0, help="seconds that the paper's 180 are played in")
    parser.add_argument("--rounds", type=int, default=1, help="windows of each row, in turn")
    parser.add_argument("--latency", type=float, default=2.0, help="of the heavy model, seconds before scaling")
    parser.add_argument("--light-latency", type=float, default=1.0, help="of the light model, which verifies")
    parser.add_argument("--in-flight", type=int, default=8, help="questions at once where asking is asynchronous")
    parser.add_argument("--rpm", type=int, default=500, help="requests a minute of each model of Table IV")
    parser.add_argument("--tpm", type=int, default=60_000, help="tokens a minute of each model of Table IV")
    parser.add_argument("--bound-rpm", type=int, default=120, help="requests a minute of the model that is bound by them")
    parser.add_argument("--bound-tpm", type=int, default=60_000, help="tokens a minute of the model that is bound by them")
    parser.add_argument("--step-frames", type=int, default=600, help="frames of the comparison of step times")
    parser.add_argument("--step-rate", type=float, default=FRAME_RATE_HZ, help="frames a second there; 0: one after the other")
    parser.add_argument("--accuracy", type=float, help="of all simulated models; default: those of the protocol")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for agent_throughput.json")
    parser.add_argument("--cache", metavar="DIR", help="folder of drawn frames")
    return parser


def job_from(given: argparse.Namespace, cache: str) -> Job:
    """Return the job of a command line.

    Raises:
        ConfigError: a wrong room, part or number.
    """
    given.parts = [part.strip() for part in given.parts.split(",")]
    for part in given.parts:
        if part not in PARTS:
            raise ConfigError(f"--parts: got {part!r}, wanted some of {', '.join(PARTS)}")
    for name in ("window", "latency", "light_latency", "rounds", "in_flight", "rpm", "tpm", "bound_rpm", "bound_tpm", "step_frames"):
        if not getattr(given, name) > 0:
            raise ConfigError(f"--{name.replace('_', '-')}: got {getattr(given, name)}, wanted a number above 0")
    (room, *more) = rooms_from(given.room)
    if more:
        raise ConfigError(f"--room: got {given.room!r}, wanted one room")
    if given.meshes:
        MeshLibrary(given.meshes)
    return Job(
        room=room,
        seed=given.seed,
        level=frozen_level() if given.level is None else given.level,
        variants={"RG+D+L": Config.preset("seo_slam_no_agents")},
        meshes=given.meshes,
        size_px=size_from(given.size),
        changes=False,
        cache=cache,
        models=ModelKnobs(given.accuracy, given.latency, given.in_flight),
    )


def stated(job: Job, given: argparse.Namespace, load_before: Sequence[float]) -> dict[str, Any]:
    """Return how it was measured."""
    return {
        **settings_of([job]),
        "models": {**dataclasses.replace(job.models).as_dict(), "light_latency_s": given.light_latency},
        "window_s": given.window,
        "scale": round(given.window / PAPER_WINDOW_S, 6),
        "processors": len(os.sched_getaffinity(0)),
        "load_average": {"before": list(load_before), "after": list(os.getloadavg())},
        "definitions": {
            "landmarks": "verified, described if that was due, and merging considered, each time a landmark got that far; "
            "the same landmarks come again in new views",
            "synchronous": "one question at a time, each waits for the one before; the robot's loop does not",
            "seconds": "of the walk: wall seconds over scale; step times are wall milliseconds",
            "ratio of limits": "let in by the server, over limit times minutes from the first question to the end of the window",
        },
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print."""
    parser = options()
    given = parser.parse_args(arguments)
    load_before = os.getloadavg()
    with tempfile.TemporaryDirectory() as folder:
        try:
            job = job_from(given, given.cache or folder)
            if given.out:
                given.out.mkdir(parents=True, exist_ok=True)
        except (SeoSlamError, OSError) as error:
            parser.error(str(error))
        found = measured(job, given)
    result: Mapping[str, Any] = {"protocol": PROTOCOL, **found, **stated(job, given, load_before)}
    text = json.dumps(result, indent=1)
    if given.out:
        (given.out / "agent_throughput.json").write_text(text + "\n", encoding="utf-8")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
