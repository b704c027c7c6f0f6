"""Writes a simulated recording as a folder in TUM layout."""

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from seo_slam.datasets.camera_files import CAMERA_FILE, write_camera_file
from seo_slam.datasets.trajectory_files import write_trajectory
from seo_slam.errors import DatasetError
from seo_slam.simulation.sensors import DEPTH_UNITS_PER_M
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.types import Detections, Frame


def write_recording(recording: SimulatedRecording, folder: Path, frames: Iterable[Frame] | None = None) -> Path:
    """Write ``rgb/ depth/ rgb.txt depth.txt groundtruth.txt odometry.txt camera.json detections.jsonl truth.json simulation.json``.

    Args:
        recording: what to write.
        folder: new or empty.
        frames: the recording's frames, if they come by way of a progress bar.

    Returns:
        ``folder``.

    Raises:
        DatasetError: the folder holds something already, or cannot be written.
    """
    _make_empty(folder)
    lists: dict[str, list[str]] = {"rgb": ["# color images", "# timestamp filename"], "depth": ["# depth maps", "# timestamp filename"]}
    lines = []
    for frame in recording if frames is None else frames:
        stamp = f"{frame.timestamp_s:.6f}"
        units = np.round(frame.depth_m.astype(np.float64) * DEPTH_UNITS_PER_M).astype(np.uint16)
        for name, image in (("rgb", frame.rgb[:, :, ::-1]), ("depth", units)):
            _write_png(folder / name / f"{stamp}.png", np.ascontiguousarray(image))
            lists[name].append(f"{stamp} {name}/{stamp}.png")
        lines.append(_detections_line(frame.timestamp_s, recording.detector.detect(frame)))
    for name, rows in lists.items():
        _write_lines(folder / f"{name}.txt", rows)
    _write_lines(folder / "detections.jsonl", lines)
    write_trajectory(folder / "groundtruth.txt", recording.trajectory)
    write_trajectory(folder / "odometry.txt", recording.odometry)
    write_camera_file(folder / CAMERA_FILE, recording.camera, DEPTH_UNITS_PER_M)
    _write_json(folder / "truth.json", recording.truth)
    knobs = {
        "seed": recording.seed,
        "level": recording.level,
        "sensor": dataclasses.asdict(recording.sensor_knobs),
        "detector": dataclasses.asdict(recording.detector_knobs),
    }
    _write_json(folder / "simulation.json", knobs)
    return folder


def _make_empty(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise DatasetError(f"{folder}: is there already; wanted a new or empty folder for the recording")
    try:
        for name in ("rgb", "depth"):
            (folder / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DatasetError(f"{folder}: cannot be written: {error.strerror}") from error


def _write_png(path: Path, image: np.ndarray[Any, Any]) -> None:
    if not cv2.imwrite(str(path), image):
        raise DatasetError(f"{path}: cannot be written")


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8", newline="\n")


def _write_json(path: Path, content: Any) -> None:
    _write_lines(path, [json.dumps(content, indent=1)])


def _detections_line(timestamp_s: float, detections: Detections) -> str:
    return json.dumps(
        {
            "timestamp_s": timestamp_s,
            "boxes_px": detections.boxes_px.tolist(),
            "labels": list(detections.labels),
            "scores": detections.scores.tolist(),
            "masks": [None] * len(detections),
        }
    )
