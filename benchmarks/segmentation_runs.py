"""Runs of DualMap's concrete map in simulated rooms and homes: worlds, variants, and one run scored under all protocols.

All variants of a world run side by side on the very same frames, detections and segments. Pictures are looked at by the simulated image
encoder, so that every figure made here is one of a simulated detector and a simulated encoder.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from simulated_runs import Failure, embedder_of, failing, keyframes_of, seconds_per_keyframe

from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Config
from seo_slam.evaluation.class_words import ClassWords
from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.evaluation.segmentation import evaluate_segmentation, objects_of
from seo_slam.evaluation.segmentation_protocols import PROTOCOLS
from seo_slam.evaluation.segmentation_scores import SegmentationResult
from seo_slam.evaluation.trajectory import ape
from seo_slam.perception.hybrid import HybridDetector
from seo_slam.pipeline import Pipeline
from seo_slam.records import Trajectory
from seo_slam.simulation.apartment import SimulatedApartment
from seo_slam.simulation.house import SimulatedHouse
from seo_slam.simulation.image_encoder import OBJECT_ANGLE_DEG, VIEW_ANGLE_DEG, SimulatedImageEncoder
from seo_slam.simulation.labelled_cloud import labelled_cloud
from seo_slam.simulation.rooms import ROOMS, SimulatedRoom
from seo_slam.simulation.segments import SimulatedSegmenter
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.types import Detections, Frame

HOMES = ("house", "apartment")
WORLDS = (*ROOMS, *HOMES)


@dataclass(frozen=True, slots=True)
class Variant:
    """A preset with something changed.

    Attributes:
        settings: as on a command line.
        segments: whether class-agnostic segments are added (the paper: FastSAM).
        refine: whether boxes of one thing are merged (the paper: YOLO refinement).
    """

    settings: tuple[str, ...] = ()
    segments: bool = True
    refine: bool = True


VARIANTS = {
    "full": Variant(),
    "no segments": Variant(segments=False),
    "no refinement": Variant(refine=False),
    "image only": Variant(("features.text_weight=0", "features.image_weight=1", "features.null_text=false")),
    "words only": Variant(("features.text_weight=1", "features.image_weight=0")),
    "no split": Variant(("status.split=false",)),
    "no stability check": Variant(("status.observations=1", "status.majority=0")),
    "no existence": Variant(("status.existence=false",)),
    "greedy": Variant(('overlap.assignment="greedy"',)),
    "greedy without split": Variant(('overlap.assignment="greedy"', "status.split=false")),
    "3D merge": Variant(("status.merge=true",)),
}
"""The paper's ablations (Tables III and IV), the paper's checks without existence, and greedy matching against one to one.

"image only" is its "w/o weighted feats".
"""


@dataclass(frozen=True, slots=True)
class SegmentationJob:
    """One world and seed, and what to do with it; ``room`` is the world, as in the other benchmarks' jobs."""

    room: str
    seed: int
    level: float
    variants: Mapping[str, tuple[Variant, Config]] = field(repr=False)
    meshes: str | None = None
    frames: int | None = None
    size_px: tuple[int, int] = (320, 240)
    cache: str | None = None
    odometry: str = "true"
    object_angle_deg: float = OBJECT_ANGLE_DEG
    view_angle_deg: float = VIEW_ANGLE_DEG
    voxel_m: float = 0.02

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.room} seed {self.seed}"


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """One variant of a job: its result a protocol, and a row of what else is known of the run."""

    job: SegmentationJob
    variant: str
    results: tuple[SegmentationResult, ...]
    row: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Done:
    """What a job brings back."""

    scored: list[Scored]
    failures: list[Failure]


class _OneLook:
    """A detector whose answer for a frame is kept until the next frame, for several pipelines that ask for the same."""

    def __init__(self, detector: Any) -> None:
        self._detector = detector
        self._last: tuple[float, Detections] | None = None
        self.notes: tuple[str, ...] = ()

    def detect(self, frame: Frame) -> Detections:
        if self._last is None or self._last[0] != frame.timestamp_s:
            self._last = frame.timestamp_s, self._detector.detect(frame)
            self.notes = getattr(self._detector, "notes", ())
        return self._last[1]


def recording_of(job: SegmentationJob) -> SimulatedRecording:
    """Return the recording of a job, in which nothing changes; nothing is drawn yet."""
    width, height = job.size_px
    options: dict[str, Any] = {"changes": False, "cache": job.cache}
    if job.room in HOMES:
        home = SimulatedHouse if job.room == "house" else SimulatedApartment
        return home(job.seed, job.level, job.meshes, job.frames, width, height, **options)
    options["tables_are_things"] = True  # every piece of furniture is an instance, as in scanned rooms
    return SimulatedRoom(job.room, job.seed, job.level, job.meshes, job.frames or 200, width, height, **options)


def run_job(job: SegmentationJob) -> Done:
    """Run all variants of one world side by side, and score them under all protocols."""
    recording = recording_of(job)
    failures: list[Failure] = []
    pipelines = _run(recording, job, failures)
    truth = labelled_cloud(recording, job.voxel_m)
    words = ClassWords.of(truth.class_names, embedder_of(next(iter(job.variants.values()))[1].embedder.model_dump_json()))
    scored = []
    for name in list(pipelines):
        with failing(pipelines, name, job, failures):  # type: ignore[arg-type]  # of the job, only room and seed are read
            scored.append(_scored(name, pipelines[name], recording, truth, words, job))
    return Done(scored, failures)


def _run(recording: SimulatedRecording, job: SegmentationJob, failures: list[Failure]) -> dict[str, Pipeline]:
    path = recording.trajectory if job.odometry == "true" else recording.odometry
    segmenter = SimulatedSegmenter.of(recording)
    first = next(iter(job.variants.values()))[1]
    encoder = SimulatedImageEncoder.of(recording, embedder_of(first.embedder.model_dump_json()), job.object_angle_deg, job.view_angle_deg)
    front_ends: dict[tuple[bool, bool], _OneLook] = {}
    running: dict[str, Pipeline] = {}
    for name, (variant, config) in job.variants.items():
        key = variant.segments, variant.refine
        if key not in front_ends:
            hybrid = HybridDetector(
                recording.detector, segmenter if variant.segments else None, refine=variant.refine, image_encoder=encoder
            )
            front_ends[key] = _OneLook(hybrid)
        running[name] = Pipeline(config, detector=front_ends[key], odometry=RecordedOdometry(path), embedder=encoder)
    for frame in _frames(recording, path, [config for _, config in job.variants.values()]):
        for name in list(running):
            with failing(running, name, job, failures):  # type: ignore[arg-type]  # as above
                running[name].step(frame)
    for pipeline in running.values():
        pipeline.close()
    return running


def _frames(recording: SimulatedRecording, path: Trajectory, configs: Sequence[Config]) -> Iterator[Frame]:
    """A frame for every stamp; black ones where no pipeline will look."""
    wanted = set().union(*(keyframes_of(path, config.keyframes) for config in configs))
    size = (recording.camera.height, recording.camera.width)
    black, no_depth = np.zeros((*size, 3), dtype=np.uint8), np.zeros(size, dtype=np.float32)
    for index, stamp_s in enumerate(recording.trajectory.timestamps_s.tolist()):
        yield recording.frame(index) if index in wanted else Frame(stamp_s, black, no_depth, recording.camera, index)


def _scored(
    variant: str, pipeline: Pipeline, recording: SimulatedRecording, truth: LabelledCloud, words: ClassWords, job: SegmentationJob
) -> Scored:
    started = time.perf_counter()
    result = pipeline.result()
    landmarks = [row for row in result.map.landmarks if len(row.cloud_world)]
    results = evaluate_segmentation(objects_of(landmarks), truth, words, tuple(PROTOCOLS.values()))
    first = results[0]
    row = {
        "world": job.room,
        "seed": job.seed,
        "variant": variant,
        "protocols": {r.protocol.name: {key: value for key, value in r.as_dict().items() if key not in ("counted",)} for r in results},
        "landmarks": len(result.map.landmarks),
        "tentative": len(result.map.tentative),
        "without_cloud": len(result.map.landmarks) - len(landmarks),
        "keyframes": result.keyframes,
        "detections": result.detections,
        "ape_rmse_m": ape(result.trajectory, recording.trajectory).rmse_m,
        "seconds_per_keyframe": seconds_per_keyframe(pipeline),
        "stages": {name: stage["total"] for name, stage in result.seconds.items()},
        "warnings": dict(result.warnings),
        "events": _event_counts(result.events),
        "scoring_s": round(time.perf_counter() - started, 3),
        "objects": [
            {
                "id": landmark.id,
                "label": landmark.label,
                "called": called,
                "of": owner,
                "of_class": None if owner is None else truth.class_names[truth.instances[owner]],
                "points": len(landmark.cloud_world),
                "observations": landmark.observations,
                "position_m": [round(float(v), 3) for v in landmark.position_m],
            }
            for landmark, called, owner in zip(landmarks, first.called_by_name, first.owners, strict=True)
        ],
        "things": [
            {
                "id": number,
                "class": truth.class_names[class_id],
                "visible_keyframes": (truth.visible_keyframes or {}).get(number),
                "objects": [landmark.id for landmark, owner in zip(landmarks, first.owners, strict=True) if owner == number],
            }
            for number, class_id in truth.instances.items()
        ],
    }
    return Scored(job, variant, results, row)


def _event_counts(events: Sequence[tuple[int, Any]]) -> dict[str, int]:
    kinds = [event.kind for _, event in events]
    return {kind: kinds.count(kind) for kind in sorted(set(kinds))}
