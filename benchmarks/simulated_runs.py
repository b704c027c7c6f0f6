"""What the benchmarks on simulated rooms share: recordings, variants, many processes, and what a result states.

A job is one room and one seed. Its variants run side by side on the very same frames and detections, with the drifting odometry; the
true poses only score. Nothing but keyframes is looked at by a pipeline whose odometry is recorded, so nothing else is drawn.
"""

import dataclasses
import functools
import multiprocessing
import os
import statistics
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from simulated_models import ModelKnobs, asks_models, models_for

from seo_slam import registry
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.cli.progress import with_progress
from seo_slam.config import Component, Config, KeyframeSettings
from seo_slam.interfaces import Embedder
from seo_slam.mapping.keyframes import is_keyframe
from seo_slam.mapping.motion_chain import MotionChain
from seo_slam.pipeline import Pipeline
from seo_slam.records import StepResult, Trajectory
from seo_slam.run_files import versions
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.rooms import SimulatedRoom
from seo_slam.simulation.sensors import SensorKnobs
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.types import Frame

VARIANTS = {
    "RG": "rg",
    "RG+D": "rg_d",
    "RG+D(cosine)": "rg_d_cosine",
    "RG+A": "rg_a",
    "RG+D+A": "rg_d_a",
    "RG+D+L": "seo_slam_no_agents",
    "RG+D+L+A": "seo_slam_chat",
    "RG+D+L+local": "seo_slam",
}
"""Name in the paper's way -> preset. R: the detector's words, G: geometry, D: two-stage gate and assignment, A: agents, taken at their
word; L: the life cycle, with agents behind rails; local: agents that ask no model."""

DRAIN_S = 60.0
"""Recorded seconds that the last answers have, at the end of a recording."""

KNOBS = {"detector": DetectorKnobs, "sensor": SensorKnobs}

Result = TypeVar("Result")
OnKeyframe = Callable[[str, Pipeline, Frame, StepResult], None]


@dataclass(frozen=True, slots=True)
class Job:
    """One room and seed, and what to do with it.

    Attributes:
        room, seed, level: which recording, and how imperfect.
        variants: name -> settings of its pipeline.
        meshes: folder of meshes; None: primitives of like size.
        frames, size_px: how many, and (width, height).
        changes: whether the scene changes halfway.
        knobs: (detector or sensor, name, value): instead of those of the level.
        renderer: "auto", "embree" or "primitive".
        cache: folder of drawn frames, or None.
        radius_m: of the match.
        models: the simulated ones that agents ask.
    """

    room: str
    seed: int
    level: float
    variants: Mapping[str, Config] = field(repr=False)
    meshes: str | None = None
    frames: int = 200
    size_px: tuple[int, int] = (320, 240)
    changes: bool = True
    knobs: tuple[tuple[str, str, float], ...] = ()
    renderer: str = "auto"
    cache: str | None = None
    radius_m: float = 0.2
    models: ModelKnobs = field(default_factory=ModelKnobs)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.room} seed {self.seed}"


@dataclass(frozen=True, slots=True)
class Failure:
    """A job, or one variant of it, that ended in an exception."""

    room: str
    seed: int
    variant: str | None
    error: str
    traceback: str

    @classmethod
    def of(cls, job: Job, error: BaseException, variant: str | None = None) -> "Failure":
        """Keep what is known of an exception."""
        told = (
            str(error.__cause__) if hasattr(error.__cause__, "tb") else "".join(traceback.format_exception(error))
        )  # a worker's own words
        return cls(job.room, job.seed, variant, f"{type(error).__name__}: {error}", told.strip('\n"'))


def make_recording(job: Job) -> SimulatedRecording:
    """Return the recording of a job; nothing is drawn yet."""
    width, height = job.size_px
    return SimulatedRoom(
        job.room,
        job.seed,
        job.level,
        job.meshes,
        job.frames,
        width,
        height,
        changes=job.changes,
        sensor_knobs=knobs_of(job, "sensor"),
        detector_knobs=knobs_of(job, "detector"),
        renderer=job.renderer,
        cache=job.cache,
    )


def knobs_of(job: Job, part: str) -> Any:
    """Return the knobs of a part: those of the level, but for the ones that the job sets."""
    changed: dict[str, Any] = {}
    at_level = KNOBS[part].at_level(job.level)
    for name, value in ((name, value) for owner, name, value in job.knobs if owner == part):
        changed[name] = int(value) if isinstance(getattr(at_level, name), int) else value
    return dataclasses.replace(at_level, **changed)


def keyframes_of(odometry: Trajectory, settings: KeyframeSettings) -> set[int]:
    """Return which frames a pipeline on this recorded odometry makes keyframes of; the same arithmetic as the pipeline's."""
    source, since, chosen, last_s = RecordedOdometry(odometry), MotionChain(), {0}, float(odometry.timestamps_s[0])
    for index, stamp_s in enumerate(odometry.timestamps_s.tolist()):
        motion = source.update(_Stamp(stamp_s))  # type: ignore[arg-type]  # only the stamp of a frame is read
        if index == 0:
            since.restart(motion)
            continue
        since.add(motion)
        if is_keyframe(since.T_keyframe_frame, stamp_s - last_s, settings):
            chosen.add(index)
            last_s = stamp_s
            since.restart(motion)
    return chosen


@dataclass(frozen=True, slots=True)
class _Stamp:
    timestamp_s: float


def frames_for(recording: SimulatedRecording, configs: Iterable[Config]) -> Iterator[Frame]:
    """Yield a frame for every stamp; black ones without depth where no pipeline will look.

    Should a pipeline look all the same, the simulated detector refuses: it was never shown that frame.
    """
    wanted: set[int] = set()
    for settings in {config.keyframes for config in configs}:
        wanted |= keyframes_of(recording.odometry, settings)
    size = (recording.camera.height, recording.camera.width)
    black, no_depth = np.zeros((*size, 3), dtype=np.uint8), np.zeros(size, dtype=np.float32)
    for index, stamp_s in enumerate(recording.trajectory.timestamps_s.tolist()):
        yield recording.frame(index) if index in wanted else Frame(stamp_s, black, no_depth, recording.camera, index)


def run_variants(
    recording: SimulatedRecording, job: Job, on_keyframe: OnKeyframe | None = None
) -> tuple[dict[str, Pipeline], list[Failure]]:
    """Step all variants of a job through its recording, frame by frame side by side.

    Args:
        recording: of the job.
        job: with its variants.
        on_keyframe: called with name, pipeline, frame and step after each keyframe of each variant.

    Returns:
        The pipelines that came to the end, and a failure for each one that did not.
    """
    failures: list[Failure] = []
    with models_for(recording, job.variants, job.models) as variants:
        running = {
            name: Pipeline(
                config,
                detector=recording.detector,
                odometry=RecordedOdometry(recording.odometry),
                embedder=embedder_of(config.embedder.model_dump_json()),
            )
            for name, config in variants.items()
        }
        for frame in frames_for(recording, variants.values()):
            for name in list(running):
                with failing(running, name, job, failures):
                    step = running[name].step(frame)
                    if on_keyframe and step.is_keyframe:
                        on_keyframe(name, running[name], frame, step)
        for name in list(running):
            with failing(running, name, job, failures):
                running[name].drain(DRAIN_S)
        for pipeline in running.values():
            pipeline.close()
    return running, failures


@contextmanager
def failing(running: dict[str, Pipeline], name: str, job: Job, failures: list[Failure]) -> Iterator[None]:
    """Let a variant that raises drop out; the others go on."""
    try:
        yield
    except Exception as error:  # noqa: BLE001  # a part under test may raise anything
        failures.append(Failure.of(job, error, name))
        running.pop(name).close()


@functools.cache
def embedder_of(component: str) -> Embedder:
    """Return the embedder of a component (as JSON), loaded once a process and warm."""
    embedder: Embedder = registry.create("embedder", Component.model_validate_json(component))
    embedder.embed_text(["thing"])
    return embedder


def seconds_per_keyframe(pipeline: Pipeline) -> float:
    """Return what a keyframe cost on the mean, all stages but drawing and loading of models."""
    result = pipeline.result()
    total = sum(stage["total"] for name, stage in result.seconds.items() if name not in ("read", "warm up"))
    return total / max(result.keyframes, 1)


def in_parallel(work: Callable[[Job], Result], jobs: Sequence[Job], processes: int, title: str) -> tuple[list[Result], list[Failure]]:
    """Do every job, and return the results in the order of the jobs, whatever order they end in.

    One process works in this one; more are started afresh, with one thread of linear algebra each.
    """
    done: dict[int, Result | Failure] = {}
    started = time.monotonic()
    finished = _one_by_one(work, jobs) if processes == 1 else _in_pool(work, jobs, processes)
    for index, result in with_progress(finished, len(jobs), title):
        done[index] = result
        if not sys.stderr.isatty():
            how = f"failed: {result.error}" if isinstance(result, Failure) else "done"
            print(f"{title}: {len(done)}/{len(jobs)}, {time.monotonic() - started:.0f} s: {jobs[index].name} {how}", file=sys.stderr)
    ordered = [done[index] for index in range(len(jobs))]
    return [r for r in ordered if not isinstance(r, Failure)], [r for r in ordered if isinstance(r, Failure)]


def _one_by_one(work: Callable[[Job], Result], jobs: Sequence[Job]) -> Iterator[tuple[int, Result | Failure]]:
    for index, job in enumerate(jobs):
        try:
            yield index, work(job)
        except Exception as error:  # noqa: BLE001  # one room that fails must not take the others along
            yield index, Failure.of(job, error)


def _in_pool(work: Callable[[Job], Result], jobs: Sequence[Job], processes: int) -> Iterator[tuple[int, Result | Failure]]:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"  # read by the workers when they load numpy
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting: dict[Future[Result], int] = {pool.submit(work, job): index for index, job in enumerate(jobs)}
        try:
            for future in as_completed(waiting):
                index = waiting[future]
                try:
                    yield index, future.result()
                except Exception as error:  # noqa: BLE001  # as above; also a worker that was killed
                    yield index, Failure.of(jobs[index], error)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def settings_of(jobs: Sequence[Job]) -> dict[str, Any]:
    """Return what a result states of how it was made."""
    job = jobs[0]
    return {
        "rooms": list(dict.fromkeys(job.room for job in jobs)),
        "seeds": list(dict.fromkeys(job.seed for job in jobs)),
        "level": job.level,
        "knobs": {
            "detector": dataclasses.asdict(knobs_of(job, "detector")),
            "sensor": dataclasses.asdict(knobs_of(job, "sensor")),
            "changed": [f"{part}.{name}={value:g}" for part, name, value in job.knobs],
        },
        "frames": job.frames,
        "size_px": list(job.size_px),
        "scene_changes": job.changes,
        "shapes": "meshes" if job.meshes else "primitives",
        "radius_m": job.radius_m,
        "models": job.models.as_dict() if any(map(asks_models, job.variants.values())) else None,
        "settings": {name: config.model_dump(mode="json") for name, config in job.variants.items()},
        "versions": versions(),
        "commit": commit(),
    }


def commit() -> str | None:
    """Return the commit of this checkout, with -dirty where a file of the library differs; None outside a checkout."""
    try:
        words = ["git", "describe", "--always", "--abbrev=12", "--dirty", "--exclude=*"]
        found = subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return found.stdout.strip() or None


def mean_and_std(values: Iterable[float]) -> dict[str, float]:
    """Return mean and sample standard deviation; 0 for a single value."""
    found = list(values)
    return {"mean": round(statistics.fmean(found), 6), "std": round(statistics.stdev(found) if len(found) > 1 else 0.0, 6)}


def share(part: int, whole: int) -> float | None:
    """Return part / whole; None of nothing."""
    return round(part / whole, 6) if whole else None


def report_failures(failures: Sequence[Failure]) -> None:
    """Print room, seed and traceback of what failed to standard error."""
    for failure in failures:
        variant = f", {failure.variant}" if failure.variant else ""
        print(f"\nfailed: {failure.room} seed {failure.seed}{variant}\n{failure.traceback}", file=sys.stderr)
