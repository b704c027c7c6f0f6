"""The command line of the benchmarks on simulated rooms: from words to jobs, or to a clear error before anything is drawn."""

import argparse
import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path

from simulated_models import ModelKnobs
from simulated_runs import KNOBS, VARIANTS, Job

from seo_slam.config import Config
from seo_slam.errors import ConfigError, SeoSlamError
from seo_slam.simulation.inventories import ROOMS
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.sensors import require_level
from seo_slam.simulation.simulated_recording import simulated_camera

LEVEL_FILE = Path(__file__).with_name("detector_level.json")
"""How imperfect detector and sensors are: chosen once by ``calibrate_level.py``, so that RG does as well as in the paper."""


def add_options(parser: argparse.ArgumentParser, variants: str) -> None:
    """Add the options that all benchmarks on rooms take."""
    parser.add_argument("--rooms", default="all", help=f"all, or some of {','.join(ROOMS)}")
    parser.add_argument("--seeds", default="0-4", help="like 0-4 or 0,3,7")
    parser.add_argument("--meshes", metavar="DIR", help="folder of meshes; without: primitives of like size")
    parser.add_argument("--variants", default=variants, help=f"some of {','.join(VARIANTS)}")
    parser.add_argument(
        "--add", action="append", default=[], metavar="NAME=FILE", help="one more variant: a TOML or YAML file of settings; may be repeated"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help="a setting, for all variants; may be repeated"
    )
    parser.add_argument("--level", type=float, help=f"of the detector's and sensors' errors; default: that of {LEVEL_FILE.name}")
    parser.add_argument(
        "--knob", action="append", default=[], metavar="KEY=VALUE", help="like detector.relabel=0 or sensor.drift_m=0; may be repeated"
    )
    parser.add_argument("--no-changes", action="store_true", help="the scene stays as it is")
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size", default="320x240", metavar="WxH", help="of the images")
    parser.add_argument("--renderer", default="auto", choices=("auto", "embree", "primitive"))
    parser.add_argument("--radius", type=float, default=0.2, help="of a match, metres")
    parser.add_argument("--accuracy", type=float, help="of all simulated models; default: those of the protocol")
    parser.add_argument("--latency", type=float, default=1.0, help="of the simulated models, recorded seconds")
    parser.add_argument("--in-flight", type=int, default=8, help="questions to the simulated models at once")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for the result's files")
    parser.add_argument("--cache", metavar="DIR", type=Path, help="folder of drawn frames; default: renders in --out")


def jobs_from(given: argparse.Namespace) -> list[Job]:
    """Return a job for each room and seed, rooms first.

    Raises:
        ConfigError: an unknown room, variant, knob or setting, a wrong number, or no level.
        DatasetError: no meshes in the folder that is named.
    """
    level = require_level(frozen_level() if given.level is None else given.level)
    for name, value, least in (("jobs", given.jobs, 1), ("frames", given.frames, 2), ("in-flight", given.in_flight, 1)):
        if value < least:
            raise ConfigError(f"--{name}: got {value}, wanted at least {least}")
    if not (math.isfinite(given.radius) and given.radius > 0):
        raise ConfigError(f"--radius: got {given.radius}, wanted a distance above 0, in metres")
    if given.accuracy is not None and not 0 <= given.accuracy <= 1:
        raise ConfigError(f"--accuracy: got {given.accuracy}, wanted 0 to 1")
    if not (math.isfinite(given.latency) and given.latency >= 0):
        raise ConfigError(f"--latency: got {given.latency}, wanted seconds")
    if given.meshes:
        MeshLibrary(given.meshes)
    cache = given.cache or (given.out / "renders" if given.out else None)
    variants = {name: config.with_settings(given.settings) for name, config in variants_from(given.variants, given.add).items()}
    knobs = tuple(knob_from(text) for text in given.knob)
    return [
        Job(
            room=room,
            seed=seed,
            level=level,
            variants=variants,
            meshes=given.meshes,
            frames=given.frames,
            size_px=size_from(given.size),
            changes=not given.no_changes,
            knobs=knobs,
            renderer=given.renderer,
            cache=None if cache is None else str(cache),
            radius_m=given.radius,
            models=ModelKnobs(given.accuracy, given.latency, given.in_flight),
        )
        for room in rooms_from(given.rooms)
        for seed in seeds_from(given.seeds)
    ]


def rooms_from(text: str) -> list[str]:
    """Return the rooms that a text names."""
    if text == "all":
        return list(ROOMS)
    rooms = [room.strip() for room in text.split(",")]
    for room in rooms:
        if room not in ROOMS:
            raise ConfigError(f"--rooms: got {room!r}, wanted all, or some of {', '.join(ROOMS)}")
    return list(dict.fromkeys(rooms))


def seeds_from(text: str) -> list[int]:
    """Return the seeds that a text like 0-4 or 0,3,7 names."""
    seeds: list[int] = []
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdigit() or (dash and not last.isdigit()) or (dash and int(last) < int(first)):
            raise ConfigError(f"--seeds: got {text!r}, wanted like 0-4 or 0,3,7")
        seeds += range(int(first), int(last or first) + 1)
    return list(dict.fromkeys(seeds))


def variants_from(text: str, added: Sequence[str] = ()) -> dict[str, Config]:
    """Return name -> settings of the variants that a text names, and of those added as NAME=FILE."""
    variants = {}
    for name in (part.strip() for part in text.split(",") if part.strip()):
        if name not in VARIANTS:
            raise ConfigError(f"--variants: got {name!r}, wanted some of {', '.join(VARIANTS)} (one of your own: --add NAME=FILE)")
        variants[name] = Config.preset(VARIANTS[name])
    for item in added:
        name, equals, path = item.partition("=")
        if not (name and equals and path) or name in variants:
            raise ConfigError(f"--add: got {item!r}, wanted NAME=FILE with a name that is not taken")
        variants[name] = Config.from_file(path)
    if not variants:
        raise ConfigError(f"--variants: got none, wanted some of {', '.join(VARIANTS)}")
    return variants


def knob_from(text: str) -> tuple[str, str, float]:
    """Return part, name and value of a knob like detector.relabel=0."""
    key, _, raw = text.partition("=")
    part, _, name = key.strip().partition(".")
    known = [f"{owner}.{knob.name}" for owner, knobs in KNOBS.items() for knob in dataclasses.fields(knobs)]
    if key.strip() not in known:
        raise ConfigError(f"--knob: got {text!r}, wanted one of {', '.join(known)}, with =VALUE")
    try:
        value = float(raw)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0):
        raise ConfigError(f"--knob: got {text!r}, wanted a value of 0 or more")
    return part, name, value


def size_from(text: str) -> tuple[int, int]:
    """Return width and height of a text like 320x240."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise ConfigError(f"--size: got {text!r}, wanted like 320x240")
    camera = simulated_camera(int(width), int(height))
    return camera.width, camera.height


def frozen_level(path: Path = LEVEL_FILE) -> float:
    """Return the level that was chosen once.

    Raises:
        ConfigError: it was not chosen yet.
    """
    if not path.is_file():
        raise ConfigError(f"no level: {path.name} is not there yet (benchmarks/calibrate_level.py writes it); give --level")
    return float(json.loads(path.read_text(encoding="utf-8"))["level"])


def fail_early(parser: argparse.ArgumentParser, given: argparse.Namespace) -> list[Job]:
    """Return the jobs of a command line; end with usage and reason if it is wrong, before anything is drawn."""
    try:
        jobs = jobs_from(given)
        if given.out:
            given.out.mkdir(parents=True, exist_ok=True)
    except (SeoSlamError, OSError) as error:
        parser.error(str(error))
    return jobs
