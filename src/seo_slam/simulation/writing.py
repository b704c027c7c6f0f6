"""Writes a simulated recording as a folder in TUM layout, one frame in memory at a time."""

import json
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from seo_slam.datasets.camera_files import CAMERA_FILE, write_camera_file
from seo_slam.datasets.trajectory_files import GROUNDTRUTH_FILE, ODOMETRY_FILE, write_trajectory
from seo_slam.errors import DatasetError
from seo_slam.perception.run_length import encode_mask
from seo_slam.simulation.manifest import manifest_of
from seo_slam.simulation.sensors import DEPTH_UNITS_PER_M
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.types import BoolArray, Detections, Frame

DETECTIONS_FILE, TRUTH_FILE, MANIFEST_FILE = "detections.jsonl", "truth.json", "simulation.json"
_HEADS = {"rgb.txt": "# color images", "depth.txt": "# depth maps"}


def write_recording(recording: SimulatedRecording, folder: Path, frames: Iterable[Frame] | None = None) -> Path:
    """Write ``rgb/ depth/ rgb.txt depth.txt groundtruth.txt odometry.txt camera.json detections.jsonl truth.json simulation.json``.

    ``detections.jsonl`` holds the masks too: recorded detections are what the simulated detector said, bit for bit.

    Args:
        recording: what to write.
        folder: new or empty.
        frames: the recording's frames, if they come by way of a progress bar.

    Returns:
        ``folder``.

    Raises:
        DatasetError: the folder holds something already, or cannot be written; a disk that is full leaves what was written.
    """
    require_empty(folder)
    try:
        for name in ("rgb", "depth"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        _write_frames(recording, folder, recording if frames is None else frames)
        write_trajectory(folder / GROUNDTRUTH_FILE, recording.trajectory)
        write_trajectory(folder / ODOMETRY_FILE, recording.odometry)
        write_camera_file(folder / CAMERA_FILE, recording.camera, DEPTH_UNITS_PER_M)
        _write_json(folder / TRUTH_FILE, recording.truth)
        _write_json(folder / MANIFEST_FILE, manifest_of(recording))
    except OSError as error:
        where = folder if error.filename is None else error.filename
        raise DatasetError(f"{where}: the recording cannot be written: {error.strerror or error}") from error
    return folder


def require_empty(folder: Path) -> None:
    """Raise ``DatasetError`` unless a recording can be written there without touching anything: no such folder, or an empty one."""
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise DatasetError(f"{folder}: is there already; wanted a new or empty folder for the recording")
    except OSError as error:
        raise DatasetError(f"{folder}: cannot be read: {error.strerror or error}") from error


def _write_frames(recording: SimulatedRecording, folder: Path, frames: Iterable[Frame]) -> None:
    with ExitStack() as stack:
        names = (*_HEADS, DETECTIONS_FILE)
        rgb, depth, lines = (stack.enter_context((folder / name).open("w", encoding="utf-8", newline="\n")) for name in names)
        for file, head in zip((rgb, depth), _HEADS.values(), strict=True):
            file.write(f"{head}\n# timestamp filename\n")
        for frame in frames:
            stamp = f"{frame.timestamp_s:.6f}"
            units = np.round(frame.depth_m.astype(np.float64) * DEPTH_UNITS_PER_M).astype(np.uint16)
            for file, kind, image in ((rgb, "rgb", frame.rgb[:, :, ::-1]), (depth, "depth", units)):
                _write_png(folder / kind / f"{stamp}.png", np.ascontiguousarray(image))
                file.write(f"{stamp} {kind}/{stamp}.png\n")
            lines.write(_detections_line(frame.timestamp_s, recording.detector.detect(frame)))


def _write_png(path: Path, image: np.ndarray[Any, Any]) -> None:
    ok, code = cv2.imencode(".png", image)
    if not ok:
        raise DatasetError(f"{path}: a {image.shape} {image.dtype} image cannot be written as PNG")
    path.write_bytes(code.tobytes())  # by Python, since OpenCV does not say why a file cannot be written


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8", newline="\n")


def _detections_line(timestamp_s: float, detections: Detections) -> str:
    row = {
        "timestamp_s": timestamp_s,
        "boxes_px": detections.boxes_px.tolist(),
        "labels": list(detections.labels),
        "scores": detections.scores.tolist(),
        "masks": [_code(mask) for mask in (() if detections.masks is None else detections.masks)],
    }
    return json.dumps(row, allow_nan=False) + "\n"


def _code(mask: BoolArray) -> dict[str, list[int]] | None:
    return encode_mask(mask) if mask.any() else None
