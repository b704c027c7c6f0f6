"""Navigation in simulated homes: DualMap's Table II (static, in-anchor, cross-anchor) and Table V (where the next candidate comes from).

python benchmarks/navigation.py --homes house,0,1 --meshes DIR --maps DIR --out DIR --jobs 8
Prints one JSON object; with --out also navigation.json and navigation.jsonl (every drive with its attempts), with --pictures an SVG each.
Homes are mapped first, or their maps taken from --maps; then every trial is a job of its own. A drive that raises is a row, "failed".
A run that was ended goes on with --resume: drives whose rows are in --out, made with the same settings, are not driven again.
"""

import argparse
import dataclasses
import functools
import hashlib
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from run_options import frozen_level, size_from
from simulated_runs import Failure, commit, embedder_of, in_parallel, report_failures

from seo_slam.config import Component
from seo_slam.driving.home_map import MappingSettings, map_home
from seo_slam.driving.homes import home_named, parsed_home
from seo_slam.driving.mappers import MAPPERS, mapper_named
from seo_slam.driving.pictures import write_picture
from seo_slam.driving.run_trial import DriveOptions, run_trial
from seo_slam.driving.trials import Trial, make_trials
from seo_slam.errors import ConfigError, SeoSlamError
from seo_slam.evaluation.navigation import Drive, score_drives, statement
from seo_slam.map import MAP_FILE, Map
from seo_slam.run_files import versions
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.sensors import require_level

COUNTS = {"static": (26,), "in_anchor": (18,), "cross_anchor": (18, 18, 17)}
"""Trials of each kind in the first home, the second, …; the last number holds for all others (the paper: 78, 54 and 53 in three)."""

STRATEGIES = ("updated", "original", "random")
EMBEDDERS = ("minilm", "hashed")
TOLD = ("home", "kind", "strategy", "number", "query", "failure", "ending", "reason", "distance_m", "believed_m", "mapped", "error")
"""What the result says of a drive that did not succeed; navigation.jsonl has the rest."""
_DRIVES_A_KIND = 1000
NO_MATTER = ("maps", "cache", "counts")
"""Of a home: where things are kept, and how many trials there are, change no drive."""
ROW_FORMAT = 1
"""Of the rows in --out/drives; raised when what a row holds, or what makes it, is another."""


@dataclasses.dataclass(frozen=True, slots=True)
class HomeJob:
    """One home, and how it is mapped.

    Attributes:
        room, seed: kind of the home and its seed.
        level, meshes, size_px, cache: of its recording.
        mapper, embedder: by name.
        maps: folder of maps that are kept, or None.
        every: which frames of the tour are mapped.
        trials_seed: of the draws of its trials.
        counts: (kind, how many).
    """

    room: str
    seed: int
    level: float
    meshes: str | None
    size_px: tuple[int, int]
    cache: str | None
    mapper: str
    embedder: str
    maps: str
    every: int
    trials_seed: int
    counts: tuple[tuple[str, int], ...]

    @property
    def home(self) -> str:
        """As ``home_named`` calls it."""
        return f"{self.room}:{self.seed}"

    @property
    def name(self) -> str:
        """For people."""
        return "house" if self.home == "house:0" else f"{self.room} {self.seed}"

    @property
    def folder(self) -> Path:
        """Where its map is kept: another one for everything that changes it."""
        shapes = "meshes" if self.meshes else "primitives"
        size = "x".join(map(str, self.size_px))
        return Path(self.maps) / f"{self.room}-{self.seed}-{shapes}-{size}-level{self.level:g}-{self.mapper}-{self.embedder}-{self.every}"


@dataclasses.dataclass(frozen=True, slots=True)
class TrialJob:
    """One trial of a home, under one strategy.

    Attributes:
        of: the home.
        trial, settings, options: what is driven, and how.
        picture: file for a picture, or None.
        kept: file for its row, or None.
        resume: the row is taken from there if one of the same settings is there.
    """

    of: HomeJob
    trial: Trial
    settings: NavigationSettings
    options: DriveOptions
    picture: str | None
    kept: str | None = None
    resume: bool = False

    @property
    def room(self) -> str:
        """As of the home."""
        return self.of.room

    @property
    def seed(self) -> int:
        """As of the home."""
        return self.of.seed

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.of.name} {self.trial.name} {self.settings.strategy}"

    @property
    def made_with(self) -> dict[str, Any]:
        """What tells whether a row that is kept is one of this job: the format, and a hash of everything the drive is made with."""
        given = {
            "map": _map_hash(self.of.folder / MAP_FILE),
            "home": {key: value for key, value in dataclasses.asdict(self.of).items() if key not in NO_MATTER},
            "trial": self.trial.as_dict(),
            "navigation": self.settings.model_dump(mode="json"),
            "options": dataclasses.asdict(self.options),
        }
        return {
            "format": ROW_FORMAT,
            "settings": hashlib.sha256(json.dumps(given, sort_keys=True, default=BaseModel.model_dump).encode()).hexdigest()[:16],
        }


@functools.lru_cache(maxsize=8)
def _map_hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@functools.lru_cache(maxsize=1)
def home_of(job: HomeJob) -> SimulatedHome:
    """Return the home of a job; jobs come home by home."""
    return home_named(job.home, job.level, job.meshes, job.size_px, job.cache)


@functools.lru_cache(maxsize=1)
def map_of(job: HomeJob) -> Map:
    """Return the map of a home that was mapped."""
    return Map.load(job.folder)


def prepare(job: HomeJob) -> dict[str, Any]:
    """Map a home, and draw its trials."""
    started_s = time.perf_counter()
    home = home_of(job)
    trials = [trial for kind, count in job.counts for trial in make_trials(home, kind, count, job.trials_seed)]
    model = embedder_of(Component(name=job.embedder).model_dump_json())
    mapped = map_home(home, mapper_named(job.mapper), model, MappingSettings(every=job.every), job.folder)
    abstract = mapped.abstract
    return {
        "trials": [trial.as_dict() for trial in trials],
        "things": len(home.world.things),
        "landmarks": len(mapped),
        "anchors": 0 if abstract is None else len(abstract.anchors),
        "volatiles": 0 if abstract is None else sum(len(anchor.volatiles) for anchor in abstract.anchors),
        "frames": len(range(0, len(home), job.every)),
        "seconds": round(time.perf_counter() - started_s, 1),
    }


def drive(job: TrialJob) -> dict[str, Any]:
    """Drive one trial, or take its row where it was driven before; an error becomes a row."""
    if job.resume and job.kept and (row := kept_row(Path(job.kept), job.made_with)) is not None:
        return row
    row = {**driven(job), "made_with": job.made_with}
    if job.kept:
        part = Path(f"{job.kept}.part")
        part.write_text(json.dumps(row, sort_keys=True), encoding="utf-8")
        part.replace(job.kept)
    return row


def kept_row(path: Path, made_with: dict[str, Any]) -> dict[str, Any] | None:
    """Return the row in a file; None where there is none, a broken one, or one made with something else."""
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return row if isinstance(row, dict) and row.get("made_with") == made_with else None


def driven(job: TrialJob) -> dict[str, Any]:
    """Drive one trial; an error becomes a row."""
    number = list(COUNTS).index(job.trial.kind) * _DRIVES_A_KIND + job.trial.number  # the same noise under every strategy
    try:
        result = run_trial(
            home_of(job.of),
            map_of(job.of),
            job.trial,
            make_mapper=mapper_named(job.of.mapper),
            embedder=embedder_of(Component(name=job.of.embedder).model_dump_json()),
            settings=job.settings,
            options=job.options,
            name=job.of.name,
            drive=number,
        )
        if job.picture:
            write_picture(map_of(job.of), result, job.picture, f"{job.name}: {job.trial.query}")
        return result.as_dict()
    except Exception as error:  # noqa: BLE001  # a part under test may raise anything
        failure = Failure.of(job, error)
        return {**failed(job, failure.error).as_dict(), "success": False, "failure": "failed", "traceback": failure.traceback, "log": []}


def failed(job: TrialJob, error: str) -> Drive:
    """Return the row of a drive that raised."""
    trial = job.trial
    return Drive(job.of.name, trial.kind, job.settings.strategy, trial.number, trial.query, "failed", error=error)


def home_jobs(given: argparse.Namespace) -> list[HomeJob]:
    """Return a job for each home.

    Raises:
        ConfigError: an unknown home, kind, mapper or embedder, a wrong number, or no level.
    """
    kinds = [word.strip() for word in given.kinds.split(",")]
    for name, words, known in (("kinds", kinds, COUNTS), ("mapper", [given.mapper], MAPPERS), ("embedder", [given.embedder], EMBEDDERS)):
        unknown = [word for word in words if word not in known]
        if unknown:
            raise ConfigError(f"--{name}: got {unknown[0]!r}, wanted {', '.join(known)}")
    for name, least in (("jobs", 1), ("every", 1), ("frames", 1), ("seed", 0), ("trials", 0)):
        value = getattr(given, name)
        if value is not None and value < least:
            raise ConfigError(f"--{name}: got {value}, wanted at least {least}")
    level = require_level(frozen_level() if given.level is None else given.level)
    jobs = []
    for position, word in enumerate(given.homes.split(",")):
        room, seed = parsed_home(f"apartment:{word.strip()}" if word.strip().isdigit() else word)
        counts = tuple((kind, _count(kind, position) if given.trials is None else given.trials) for kind in kinds)
        size_px = size_from(given.size)
        cache = str(given.cache) if given.cache else None
        shared = (level, given.meshes, size_px, cache, given.mapper, given.embedder, str(given.maps), given.every, given.seed, counts)
        jobs.append(HomeJob(room, seed, *shared))
    return jobs


def _count(kind: str, position: int) -> int:
    """How many trials of a kind the first home, the second, … has."""
    return COUNTS[kind][min(position, len(COUNTS[kind]) - 1)]


def trial_jobs(homes: Sequence[tuple[HomeJob, dict[str, Any]]], given: argparse.Namespace) -> list[TrialJob]:
    """Return a job for each trial and strategy; strategies other than "updated" are tried where things went to other furniture.

    Raises:
        ConfigError: an unknown strategy, or a setting that is wrong.
    """
    strategies = [word.strip() for word in given.strategies.split(",")]
    if set(strategies) - set(STRATEGIES):
        raise ConfigError(f"--strategies: got {given.strategies}, wanted some of {', '.join(STRATEGIES)}")
    options = DriveOptions(rate_hz=given.rate)
    jobs = []
    for home, prepared in homes:
        for trial in map(Trial.from_dict, prepared["trials"]):
            for strategy in strategies:
                if strategy == "updated" or trial.kind == "cross_anchor" or given.all_strategies:
                    name = f"{home.room}-{home.seed}-{trial.name}-{strategy}"
                    picture = str(given.pictures / f"{name}.svg") if given.pictures else None
                    kept = str(given.out / "drives" / f"{name}.json") if given.out else None
                    settings = NavigationSettings(strategy=strategy, max_steps=given.frames)
                    jobs.append(TrialJob(home, trial, settings, options, picture, kept, given.resume))
    return jobs


def summary(
    homes: Sequence[tuple[HomeJob, dict[str, Any]]], rows: Sequence[dict[str, Any]], failures: Sequence[Failure], given: argparse.Namespace
) -> dict[str, Any]:
    """Return the JSON object."""
    jobs = [job for job, _ in homes]
    drives = [Drive.from_dict(row) for row in rows]
    seeds = {"trials": given.seed, **{job.name: job.seed for job in jobs}}
    return {
        **statement(seeds, jobs[0].level if jobs else float("nan"), versions()),
        "homes": {job.name: {key: value for key, value in prepared.items() if key != "trials"} for job, prepared in homes},
        "shapes": "meshes" if given.meshes else "primitives",
        "mapper": given.mapper,
        "image_encoder": "simulated encoder" if given.mapper == "dualmap" else None,
        "embedder": given.embedder,
        "poses": "given",
        "rate_hz": given.rate,
        "size_px": given.size,
        "every": given.every,
        "navigation": NavigationSettings(max_steps=given.frames).model_dump(mode="json"),
        "table": score_drives(drives),
        "not_successful": [{key: row.get(key) for key in TOLD} for row in rows if not row["success"]],
        "seconds_per_trial": round(sum(d.seconds for d in drives) / len(drives), 2) if drives else None,
        "failures": [dataclasses.asdict(failure) for failure in failures],
        "commit": commit(),
    }


def main(words: Sequence[str] | None = None) -> int:
    """Run the benchmark; 1 if something failed that has no row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--homes", default="house,0,1", help="house, or seeds of apartments; tune on 10 to 13 only")
    parser.add_argument("--kinds", default=",".join(COUNTS), help=f"some of {','.join(COUNTS)}")
    parser.add_argument("--strategies", default="updated", help=f"some of {','.join(STRATEGIES)}; the others for cross_anchor only")
    parser.add_argument("--all-strategies", action="store_true", help="all strategies for all kinds")
    parser.add_argument("--trials", type=int, help="of each kind and home; default: 26, 18 and 18, 18, 17 as in the paper")
    parser.add_argument("--seed", type=int, default=0, help="of the trials")
    parser.add_argument("--level", type=float, help="of the detector's and sensors' errors; default: the frozen one")
    parser.add_argument("--meshes", metavar="DIR", help="folder of meshes; the house needs it")
    parser.add_argument("--mapper", default="dualmap", help=f"one of {','.join(MAPPERS)}")
    parser.add_argument("--embedder", default="minilm", help=f"one of {','.join(EMBEDDERS)}")
    parser.add_argument("--size", default="320x240", metavar="WxH", help="of the images")
    parser.add_argument("--rate", type=float, default=6.0, help="frames a second of the robot")
    parser.add_argument("--frames", type=int, default=NavigationSettings().max_steps, help="of a drive, at most")
    parser.add_argument("--every", type=int, default=1, help="map each nth frame of the tour only")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--maps", metavar="DIR", type=Path, default=Path("navigation-maps"), help="folder in which maps are kept")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for the result's files")
    parser.add_argument("--resume", action="store_true", help="take drives from --out that are there; give the same words otherwise")
    parser.add_argument("--pictures", metavar="DIR", type=Path, help="folder for a picture of every drive")
    parser.add_argument("--cache", metavar="DIR", type=Path, help="folder of drawn frames of the tours")
    given = parser.parse_args(words)
    try:
        jobs = home_jobs(given)
        trial_jobs([], given)
    except SeoSlamError as error:
        parser.error(str(error))
    for folder in (given.out and given.out / "drives", given.pictures):
        if folder:
            folder.mkdir(parents=True, exist_ok=True)
    prepared, failures = in_parallel(_prepared, jobs, min(given.jobs, len(jobs)), "mapping")
    homes = [(job, done) for job, done in prepared]
    rows, more = in_parallel(drive, trial_jobs(homes, given), given.jobs, "driving")
    failures = [*failures, *more]
    result = summary(homes, rows, failures, given)
    if given.out:
        (given.out / "navigation.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
        lines = (json.dumps(row, sort_keys=True) for row in rows)
        (given.out / "navigation.jsonl").write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    print(json.dumps(result, indent=1))
    report_failures(failures)
    return 1 if failures else 0


def _prepared(job: HomeJob) -> tuple[HomeJob, dict[str, Any]]:
    return job, prepare(job)


if __name__ == "__main__":
    sys.exit(main())
