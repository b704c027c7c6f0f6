"""What the concrete map costs: milliseconds of its update, memory lap after lap, and DualMap's Tables I and IV (efficiency).

python benchmarks/mapping_cost.py [--worlds hall,house,apartment] [--variants all] [--meshes DIR] [--cache DIR] [--out FILE]
Prints one JSON object. What is seen in the frames is worked out once and put on a tape; then every variant maps it in a process of its own,
one after the other, on one thread. The hall is a simulated one with more than 100 things, and laps around it.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from crowded_hall import crowded_hall
from frame_tape import FrameTape, require_made_with
from run_options import LEVEL_FILE, frozen_level, size_from
from segmentation_runs import WORLDS, SegmentationJob, recording_of
from simulated_runs import commit, embedder_of, keyframes_of

from seo_slam.backends.no_detector import NoDetector
from seo_slam.config import Config
from seo_slam.errors import ConfigError, SeoSlamError
from seo_slam.perception.hybrid import HybridDetector
from seo_slam.run_files import versions
from seo_slam.simulation.image_encoder import SimulatedImageEncoder
from seo_slam.simulation.segments import SimulatedSegmenter
from seo_slam.simulation.sensors import require_level
from seo_slam.simulation.simulated_recording import SimulatedRecording

HALL = "hall"
MERGED, UNCHECKED = ("status.merge=true",), ("status.observations=1", "status.majority=0")
VARIANTS: dict[str, tuple[str, ...]] = {
    "full": (),
    "no stability check": UNCHECKED,
    "no split": ("status.split=false",),
    "no checks": (*UNCHECKED, "status.split=false", "status.fold=false"),
    "3D merge": MERGED,
    "3D merge, no stability check": (*MERGED, *UNCHECKED),
    "3D merge, no stability check, segments only": (*MERGED, *UNCHECKED),
}
"""Rows 4, 3, 2 and 1 of Table IV are "full" and the three with merging."""
SEGMENTS_ONLY = "segments only"
"""Variants with these words in their name have no detector of named things."""

UPDATE = ("associate", "smooth", "map", "life")
"""Stages of the map update: matching, positions of given poses, folding observations in, status checks."""
BESIDE = ("observe", "clouds", "scene", "store")
"""Stages of a keyframe that are not: lifting and features, masks to clouds, layout, history."""
OBJECTS, IN_VIEW, MOST_IN_VIEW, WANTED_MS = 100, 18, 22, 60.0
"""Keyframes count with so many objects in the map, and so many of them seen in it: the aim is a median for 100 and about 20."""


def options() -> argparse.ArgumentParser:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", default="hall,house,apartment", help=f"some of {HALL},{','.join(WORLDS)}")
    parser.add_argument("--variants", default="all", help=f"all, or names separated by semicolons: {'; '.join(VARIANTS)}")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tables", type=int, default=10, help="in the hall, each with about a dozen things")
    parser.add_argument("--laps", type=int, default=3, help="around the hall")
    parser.add_argument("--lap-frames", type=int, help="frames of one lap; default: six a second")
    parser.add_argument("--hall-size", default="640x480", metavar="WxH")
    parser.add_argument("--frames", type=int, help="of the other worlds; default: six a second")
    parser.add_argument("--size", default="320x240", metavar="WxH", help="of the other worlds")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help="for all variants")
    parser.add_argument("--least-objects", type=int, default=OBJECTS, help="keyframes count with so many objects in the map")
    parser.add_argument("--least-in-view", type=int, default=IN_VIEW, help="… and so many of them seen")
    parser.add_argument("--most-in-view", type=int, default=MOST_IN_VIEW, help="… and, for update_cost_at_aim, at most so many")
    parser.add_argument("--meshes", metavar="DIR", help="folder of meshes (the house needs it)")
    parser.add_argument("--level", type=float, help=f"of detector's and sensors' errors; default: that of {LEVEL_FILE.name}")
    parser.add_argument("--cache", metavar="DIR", type=Path, help="folder of drawn frames")
    parser.add_argument("--tapes", metavar="DIR", type=Path, help="folder that keeps what was seen, and is played again; default: none")
    parser.add_argument("--out", metavar="FILE", type=Path, help="also write the result there, with every keyframe")
    return parser


def recording(world: str, given: argparse.Namespace) -> SimulatedRecording:
    """Return the recording of a world, in which nothing changes; nothing is drawn yet."""
    level, cache = require_level(frozen_level() if given.level is None else given.level), given.cache and str(given.cache)
    if world == HALL:
        return crowded_hall(given.seed, level, given.tables, given.laps, size_from(given.hall_size), given.lap_frames, cache)
    return recording_of(SegmentationJob(world, given.seed, level, {}, given.meshes, given.frames, size_from(given.size), cache))


def record(world: str, given: argparse.Namespace, config: Config, folder: Path, named: bool) -> None:
    """Put on tape what a front end sees in a world."""
    seen = recording(world, given)
    segmenter = SimulatedSegmenter.of(seen)
    encoder = SimulatedImageEncoder.of(seen, embedder_of(config.embedder.model_dump_json()))
    hybrid = HybridDetector(seen.detector if named else NoDetector(), segmenter, image_encoder=encoder)
    wanted = keyframes_of(seen.trajectory, config.keyframes)
    FrameTape.record(folder, seen, hybrid, encoder, wanted, given.laps if world == HALL else 1, made_with(world, given, config))


def made_with(world: str, given: argparse.Namespace, config: Config) -> dict[str, Any]:
    """Return all that makes a tape what it is, as JSON has it: one made otherwise must not be played in its place."""
    own = (
        {"size_px": list(size_from(given.hall_size)), "tables": given.tables, "laps": given.laps, "lap_frames": given.lap_frames}
        if world == HALL
        else {"size_px": list(size_from(given.size)), "frames": given.frames, "shapes": "meshes" if given.meshes else "primitives"}
    )
    level = frozen_level() if given.level is None else given.level
    seen_by = {"keyframes": config.keyframes.model_dump(mode="json"), "embedder": config.embedder.model_dump(mode="json")}
    return {"world": world, "seed": given.seed, "level": level, **own, **seen_by}


def tape_of(tapes: Path, world: str, variant: str) -> Path:
    """The folder of a world's tape: variants without a detector of named things have one of their own."""
    return tapes / f"{world}{f' {SEGMENTS_ONLY}' if SEGMENTS_ONLY in variant else ''}"


def is_recorded(tape: Path) -> bool:
    """Whether a tape is there, and whole."""
    return (tape / "path.npz").is_file()


def require_fitting(worlds: Sequence[str], variants: Mapping[str, Config], given: argparse.Namespace, tapes: Path) -> None:
    """Check the tapes that are there.

    Raises:
        ConfigError: one of them is of something else than what was asked for.
    """
    for world in worlds:
        for name, config in variants.items():
            tape = tape_of(tapes, world, name)
            if is_recorded(tape):
                require_made_with(tape, made_with(world, given, config))


def replayed(tape: Path, config: Config) -> dict[str, Any]:
    """Map the frames of a tape in a process of its own, on one thread; return what ``replay_tape.py`` prints.

    Raises:
        RuntimeError: it failed.
    """
    script = Path(__file__).with_name("replay_tape.py")
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    words = [sys.executable, str(script), str(tape)]
    ended = subprocess.run(words, input=config.model_dump_json(), capture_output=True, text=True, env={**os.environ, **one_thread})
    if ended.returncode:
        raise RuntimeError(f"{tape.name}: mapping ended with {ended.returncode}\n{ended.stderr}")
    out: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return out


def update_ms(row: Mapping[str, Any]) -> float:
    """What the map update of a keyframe took."""
    return sum(row["stages"].get(stage, 0.0) for stage in UPDATE)


def update_cost(run: Mapping[str, Any], least_objects: int, least_in_view: int, most_in_view: int | None = None) -> dict[str, Any]:
    """Return what the update cost in keyframes with so many objects in the map and in view, and each stage by itself."""
    most = math.inf if most_in_view is None else most_in_view
    counted = [row for row in run["keyframes"] if row["objects"] >= least_objects and least_in_view <= row["in_view"] <= most]
    seen = f"at least {least_in_view}" if most_in_view is None else f"{least_in_view} to {most_in_view}"
    out = {
        "counted": f"keyframes with at least {least_objects} objects in the map before it and {seen} of the map seen in it",
        "keyframes_counted": len(counted),
        "keyframes": len(run["keyframes"]),
    }
    if not counted:
        return {**out, "update_ms": None, "holds": None}
    whole = _spread(map(update_ms, counted))
    return {
        **out,
        "objects_in_map": _spread(row["objects"] for row in counted),
        "objects_in_view": _spread(row["in_view"] for row in counted),
        "update_ms": whole,
        "wanted_median_ms": WANTED_MS,
        "holds": whole["median"] <= WANTED_MS,
        "stages_ms": {stage: _spread(row["stages"].get(stage, 0.0) for row in counted) for stage in UPDATE},
        "beside_ms": {stage: _spread(row["stages"].get(stage, 0.0) for row in counted) for stage in BESIDE},
    }


def memory_growth(run: Mapping[str, Any]) -> dict[str, Any]:
    """Return what was held after each lap, the update's milliseconds in it, and the last lap against the first."""
    laps, first = [], 0
    for lap in run["laps"]:
        own = run["keyframes"][first : lap["keyframes"]]
        first = lap["keyframes"]
        laps.append({**{key: _rounded(value) for key, value in lap.items()}, "update_ms": _spread(map(update_ms, own))})
    start, end = run["laps"][0], run["laps"][-1]
    keys = ("objects", "points", "cloud_mb", "resident_mb")
    return {
        "laps": laps,
        "last_to_first_lap": {key: round(end[key] / start[key], 4) if start[key] else None for key in keys},
        "resident_grown_mb": {
            "first_lap": round(start["resident_mb"] - run["start_mb"], 1),
            "after": round(end["resident_mb"] - start["resident_mb"], 1),
        },
    }


def efficiency(run: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of Tables I and IV: milliseconds a frame, mean and peak of resident memory."""
    rows = run["keyframes"]
    whole = [sum(row["stages"].get(stage, 0.0) for stage in (*UPDATE, *BESIDE)) for row in rows]
    return {
        "frames": run["frames"],
        "keyframes": len(rows),
        "objects": run["objects"],
        "landmarks": run["landmarks"],
        "objects_in_view": round(statistics.fmean(row["in_view"] for row in rows), 1),
        "update_ms_a_keyframe": _spread(map(update_ms, rows)),
        "all_stages_ms_a_keyframe": _spread(whole),
        "all_stages_ms_a_frame": round(sum(whole) / run["frames"], 3),
        "memory_mb": {
            "before_first_frame": round(run["start_mb"], 1),
            "mean": round(statistics.fmean(row["resident_mb"] for row in rows), 1),
            "peak": round(run["peak_mb"], 1),
        },
        "events": run["events"],
    }


def _spread(values: Iterable[float]) -> dict[str, float]:
    found = np.array(list(values), dtype=np.float64)
    figures = {"mean": found.mean(), "median": np.median(found), "p90": np.percentile(found, 90), "max": found.max()}
    return {name: round(float(value), 3) for name, value in figures.items()}


def _rounded(value: float) -> float:
    return round(value, 3) if isinstance(value, float) else value


def measure(worlds: Sequence[str], variants: Mapping[str, Config], given: argparse.Namespace, tapes: Path) -> dict[str, dict[str, Any]]:
    """Record and map; return world -> variant -> run."""
    runs: dict[str, dict[str, Any]] = {}
    started = time.monotonic()
    for world in worlds:
        runs[world] = {}
        for name, config in variants.items():
            tape = tape_of(tapes, world, name)
            if not is_recorded(tape):
                record(world, given, config, tape, named=SEGMENTS_ONLY not in name)
                _tell(started, f"{tape.name} is on tape")
            runs[world][name] = replayed(tape, config)
            _tell(started, f"{world}, {name} done")
    return runs


def _tell(started: float, what: str) -> None:
    print(f"mapping_cost: {time.monotonic() - started:.0f} s: {what}", file=sys.stderr)


def summary(runs: Mapping[str, Mapping[str, Any]], variants: Mapping[str, Config], given: argparse.Namespace) -> dict[str, Any]:
    """Return the JSON object."""
    hall = next(iter(runs.get(HALL, {}).values()), None)
    return {
        "benchmark": "mapping_cost",
        "what": "DualMap's concrete map, poses as given; detector, segmenter and image encoder are simulated and not counted",
        "update": "stages " + ", ".join(UPDATE),
        "beside": "stages " + ", ".join(BESIDE),
        "seed": given.seed,
        "level": frozen_level() if given.level is None else given.level,
        "hall": {"tables": given.tables, "laps": given.laps, "size_px": list(size_from(given.hall_size))},
        "size_px": list(size_from(given.size)),
        "shapes": "meshes; the hall primitives" if given.meshes else "primitives",
        "update_cost": None if hall is None else update_cost(hall, given.least_objects, given.least_in_view),
        "update_cost_at_aim": None if hall is None else update_cost(hall, given.least_objects, given.least_in_view, given.most_in_view),
        "memory_growth": None if hall is None else memory_growth(hall),
        "efficiency": {world: {name: efficiency(run) for name, run in of_world.items()} for world, of_world in runs.items()},
        "variants": {name: list(VARIANTS[name]) for name in variants},
        "settings": next(iter(variants.values())).model_dump(mode="json"),
        "threads": 1,
        "store": "sqlite, on disk",
        "versions": versions(),
        "commit": commit(),
    }


def chosen(given: argparse.Namespace) -> tuple[list[str], dict[str, Config]]:
    """Return the worlds and variants that were asked for.

    Raises:
        ConfigError: one that is not known, or a number that cannot be.
    """
    worlds = _named("worlds", given.worlds.split(","), (HALL, *WORLDS))
    names = list(VARIANTS) if given.variants.strip() == "all" else _named("variants", given.variants.split(";"), tuple(VARIANTS))
    if "house" in worlds and not given.meshes:
        raise ConfigError("--worlds: the house needs --meshes DIR")
    if given.tables < 1 or given.laps < 1 or (given.lap_frames is not None and given.lap_frames < 2):
        raise ConfigError(f"--tables, --laps, --lap-frames: got {given.tables}, {given.laps}, {given.lap_frames}, wanted 1, 1, 2 at least")
    base = Config.preset("dualmap")
    return worlds, {name: base.with_settings([*VARIANTS[name], *given.settings]) for name in names}


def _named(option: str, words: Iterable[str], known: Sequence[str]) -> list[str]:
    found = list(dict.fromkeys(word.strip() for word in words if word.strip()))
    unknown = [word for word in found if word not in known]
    if unknown or not found:
        raise ConfigError(f"--{option}: got {unknown[0] if unknown else 'none'!r}, wanted some of {', '.join(known)}")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and write; return the exit status."""
    parser = options()
    given = parser.parse_args(arguments)
    try:
        worlds, variants = chosen(given)
        for text in (given.size, given.hall_size):
            size_from(text)
        if given.tapes:
            require_fitting(worlds, variants, given, given.tapes)
    except (SeoSlamError, OSError) as error:
        parser.error(str(error))
    with tempfile.TemporaryDirectory() as folder:
        runs = measure(worlds, variants, given, given.tapes or Path(folder))
    result = summary(runs, variants, given)
    if given.out:
        given.out.write_text(json.dumps({**result, "runs": runs}) + "\n", encoding="utf-8")
    print(json.dumps(result, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
