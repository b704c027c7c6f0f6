"""A made-up desk: painted images, boxes and landmarks, for the tests of the report."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.camera import Camera
from seo_slam.records import MapEvent, StepResult, Trajectory
from seo_slam.report.crops import ReportRecorder
from seo_slam.types import Frame, Landmark, Observations

CAMERA = Camera(250.0, 250.0, 160.0, 120.0, 320, 240)


@dataclass
class MadeUpMap:
    landmarks: tuple[Landmark, ...] = ()
    tentative: tuple[Landmark, ...] = ()
    gravity: str = "recorded poses"
    embedder: str = "a model"


def landmark(landmark_id: int, label: str = "cup", position=(0.0, 0.0, 0.8), state="stable", sigma_m=0.01, **changes) -> Landmark:
    values = {
        "id": landmark_id,
        "label": label,
        "labels": {label: 0.75, "thing": 0.25} if label else {},
        "position_m": np.array(position, dtype=np.float64),
        "covariance_m2": np.diag([sigma_m**2, 4 * sigma_m**2, sigma_m**2]),
        "size_m": np.array([0.2, 0.1, 0.1]),
        "embedding": np.zeros(4),
        "observations": 5,
        "first_seen_s": 100.0,
        "last_seen_s": 104.0,
        "state": state,
    }
    return Landmark(**{**values, **changes})


def painted_frame(timestamp_s: float, boxes: Sequence[Sequence[float]], seed: int = 0) -> Frame:
    """Noise with a flat patch of its own colour in every box."""
    rng = np.random.default_rng(seed)
    rgb = rng.integers(90, 130, (CAMERA.height, CAMERA.width, 3), dtype=np.uint8)
    for i, (x0, y0, x1, y1) in enumerate(boxes):
        rgb[int(y0) : int(y1), int(x0) : int(x1)] = np.random.default_rng(i).integers(0, 256, 3)
    return Frame(timestamp_s, rgb, None, CAMERA)


def step(
    frame: Frame,
    ids: Sequence[int] = (),
    boxes: Sequence[Sequence[float]] = (),
    labels: Sequence[str | None] | None = None,
    scores: Sequence[float] | None = None,
    truncated: Sequence[int] | None = None,
    events: Sequence[MapEvent] = (),
    keyframe_id: int | None = 0,
) -> StepResult:
    """What a pipeline would say of a frame; ``truncated`` is the number of cut sides of each box."""
    n = len(ids)
    cut = np.zeros((n, 4), dtype=np.bool_)
    for row, sides in enumerate(truncated or [0] * n):
        cut[row, :sides] = True
    observations = Observations(
        p_camera=np.zeros((n, 3)),
        cov_camera=np.zeros((n, 3, 3)),
        size_m=np.zeros((n, 2)),
        labels=tuple(labels or ["cup"] * n),
        scores=np.array(scores or [0.5] * n),
        embeddings=np.zeros((n, 4)),
        boxes_px=np.array(boxes, dtype=np.float64).reshape(n, 4),
        truncated=cut,
        clouds=tuple(np.zeros((0, 3)) for _ in range(n)),
        rows=np.arange(n),
    )
    return StepResult(
        index=frame.index,
        timestamp_s=frame.timestamp_s,
        T_world_camera=np.eye(4),
        odometry_status="ok",
        keyframe_id=keyframe_id,
        observations=observations,
        landmark_ids=np.array(ids, dtype=np.int64),
        events=tuple(events),
    )


def circle_trajectory(poses: int = 40) -> Trajectory:
    angle = np.linspace(0, 2, poses)
    T = np.tile(np.eye(4), (poses, 1, 1))
    T[:, 0, 3], T[:, 1, 3], T[:, 2, 3] = 1.5 * np.cos(angle), 1.5 * np.sin(angle), 1.5
    T[:, :3, 2] = np.array([-0.8, -0.3, -0.52])
    return Trajectory(100.0 + np.arange(poses) * 0.25, T)


@dataclass
class Desk:
    """All arguments of ``write_report``."""

    map: MadeUpMap
    trajectory: Trajectory
    recorder: ReportRecorder
    run: dict

    @property
    def arguments(self) -> dict:
        return {"map": self.map, "trajectory": self.trajectory, "recorder": self.recorder, "run": self.run}


def make_desk(objects: int = 12, labels: Sequence[str] = ("book", "cup", "keyboard", "tv", "mouse"), tentative: int = 3) -> Desk:
    rng = np.random.default_rng(objects)
    recorder = ReportRecorder()
    ids = list(range(1, objects + 1))
    for k in range(4):
        shown = ids[k * 8 : k * 8 + 8] or ids[:8]
        boxes = [[5 + 38 * i, 60, 40 + 38 * i, 120] for i in range(len(shown))]
        frame = painted_frame(100.0 + k, boxes, seed=k)
        events = [MapEvent("created", i) for i in shown if recorder.crop(i) is None]
        recorder.observe(frame, step(frame, shown, boxes, [labels[i % len(labels)] for i in shown], events=events, keyframe_id=k))
    made = [
        landmark(
            i,
            labels[i % len(labels)],
            (*rng.uniform(-1, 1, 2), 0.8),
            "stable" if i <= objects - tentative else "tentative",
            sigma_m=float(rng.uniform(0.005, 0.03)),
            observations=int(rng.integers(1, 60)),
        )
        for i in ids
    ]
    run = {
        "dataset": "/recordings/made up desk",
        "counts": {"frames": 120, "keyframes": 40, "lost": 0},
        "seconds_per_stage": {"detection": {"p50": 0.1, "p95": 0.2, "max": 0.9}, "smoothing": {"p50": 0.01, "p95": 0.02, "max": 0.05}},
        "warnings": [{"message": "no depth", "count": 2}, {"message": "no depth", "count": 1}, {"message": "too small", "count": 7}],
        "versions": {"numpy": "2.0"},
        "config": {"seed": 0, "map": {"merge_duplicates": True}},
        "peak_memory_mb": 512.0,
        "command": "seo-slam demo",
    }
    stable = tuple(m for m in made if m.state == "stable")
    return Desk(MadeUpMap(stable, tuple(m for m in made if m.state == "tentative")), circle_trajectory(), recorder, run)
