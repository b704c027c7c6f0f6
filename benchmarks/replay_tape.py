"""Maps the frames of a tape and prints what every keyframe cost, as JSON: run by ``mapping_cost.py``, a process for each run.

python benchmarks/replay_tape.py TAPE < settings.json

The process holds the library, the embedder and one frame at a time, so that its resident memory is a robot's. The history of the map
goes to a file, as in ``seo-slam run``. Needs /proc (Linux).
"""

import gc
import json
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from frame_tape import FrameTape, TapeDetector

from seo_slam import registry
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.config import Component, Config
from seo_slam.interfaces import Embedder
from seo_slam.pipeline import Pipeline
from seo_slam.records import MapEvent, StepResult

MB = 2**20
BYTES_A_POINT = 20
"""What a cloud keeps of a point: keyframe, place, count."""


def replay(folder: Path, config: Config) -> dict[str, Any]:
    """Map the frames of a tape; return a row a keyframe, what the map held after each lap, and resident memory, MiB."""
    tape = FrameTape.open(folder)
    detector = TapeDetector()
    embedder: Embedder = registry.create("embedder", config.embedder)
    embedder.embed_text(["thing"])
    with tempfile.TemporaryDirectory() as kept:
        store = Component(name="sqlite", options={"path": Path(kept) / "map.db"})
        with Pipeline(config, detector=detector, odometry=RecordedOdometry(tape.path), embedder=embedder, store=store) as pipeline:
            return _run(pipeline, tape, detector)


def _run(pipeline: Pipeline, tape: FrameTape, detector: TapeDetector) -> dict[str, Any]:
    keyframes: list[dict[str, Any]] = []
    laps: list[dict[str, Any]] = []
    objects = 0
    start_mb = resident_mb()
    forget_peak()
    for frame, detector.found in tape.play():
        step = pipeline.step(frame)
        if step.is_keyframe:
            keyframes.append(_row(step, objects))
            objects += change_of_number(step.events)
        if frame.index in tape.lap_ends:
            laps.append({"lap": len(laps) + 1, "keyframes": len(keyframes), **_held(pipeline)})
    peak_mb = peak_resident_mb()
    result = pipeline.result()
    return {
        "keyframes": keyframes,
        "laps": laps,
        "start_mb": start_mb,
        "peak_mb": peak_mb,
        "frames": result.frames,
        "landmarks": len(result.map.landmarks),
        "tentative": len(result.map.tentative),
        "objects": objects,
        "events": dict(Counter(event.kind for _, event in result.events)),
    }


def _row(step: StepResult, objects: int) -> dict[str, Any]:
    return {
        "index": step.index,
        "objects": objects,
        "in_view": int((np.unique(step.landmark_ids) >= 0).sum()) if step.landmark_ids is not None else 0,
        "observations": len(step.observations) if step.observations is not None else 0,
        "stages": {name: 1e3 * seconds for name, seconds in step.seconds.items()},
        "resident_mb": resident_mb(),
    }


def change_of_number(events: Iterable[MapEvent]) -> int:
    """By how many objects a map is larger after these."""
    changes = {"created": 1, "split": 1, "merged": -1, "removed": -1}
    return sum(changes.get(event.kind, 0) for event in events)


def _held(pipeline: Pipeline) -> dict[str, Any]:
    """What the map holds, and resident memory before anybody asked."""
    resident = resident_mb()
    shown = pipeline.snapshot()
    points = sum(len(row.cloud_world) for row in (*shown.landmarks, *shown.tentative))
    out = {"objects": len(shown.landmarks) + len(shown.tentative), "points": points, "cloud_mb": points * BYTES_A_POINT / MB}
    del shown
    gc.collect()
    return {**out, "resident_mb": resident}


def resident_mb() -> float:
    """Resident memory of this process now, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / MB


def peak_resident_mb() -> float:
    """Most resident memory of this process since ``forget_peak``, MiB; ``getrusage`` may tell that of the process that started it."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 2**10


def forget_peak() -> None:
    """Let the peak begin anew: what it took to load the libraries is no part of mapping."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


if __name__ == "__main__":
    print(json.dumps(replay(Path(sys.argv[1]), Config.from_dict(json.load(sys.stdin)))))
