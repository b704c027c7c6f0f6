"""Detections of an earlier run, written to a file and read back: bit for bit what the detector said then."""

import json
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from seo_slam.backends.detection_file import STAMP_TOLERANCE_S, read_lines
from seo_slam.camera import Camera
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.perception.run_length import encode_mask
from seo_slam.types import Detections, Frame


class RecordedDetector:
    """Replays a file of recorded detections (``detection_file`` describes it)."""

    def __init__(self, path: str | Path, score: float = 0.0) -> None:
        """Read and check the whole file.

        Args:
            path: JSON lines, one frame a line.
            score: detections below it are left out, 0..1.

        Raises:
            DatasetError: names file and line of what is wrong.
            ConfigError: the score is out of range.
        """
        if not 0.0 <= score <= 1.0:
            raise ConfigError(f"recorded detector: got score {score}, wanted 0..1")
        self._score = float(score)
        self._lines = tuple(read_lines(path))
        self._stamps_s = np.array([line.timestamp_s for line in self._lines])

    def __len__(self) -> int:
        """Frames that have a line."""
        return len(self._lines)

    def check_against(self, camera: Camera) -> None:
        """Raise ``DatasetError``, naming file and line, if a box is wholly outside the image or a mask of another size."""
        for line in self._lines:
            line.require_fits(camera)

    def detect(self, frame: Frame) -> Detections:
        """Return what was recorded for the stamp of ``frame``, within half a millisecond; nothing if there is no line.

        Raises:
            DatasetError: as ``check_against``, for this frame.
        """
        if not self._lines:
            return Detections.empty()
        nearest = int(np.argmin(np.abs(self._stamps_s - frame.timestamp_s)))
        if abs(self._stamps_s[nearest] - frame.timestamp_s) > STAMP_TOLERANCE_S:
            return Detections.empty()
        return self._lines[nearest].detections(frame.camera, self._score)


class DetectionRecorder:
    """Writes detections so that ``RecordedDetector`` gives the same ones back, bit for bit.

    Embeddings of a detector's own are not kept: the format has no place for them. Each line is flushed, so that a run that is stopped
    leaves what it saw.
    """

    def __init__(self, path: str | Path) -> None:
        """Create the file, or empty it.

        Raises:
            DatasetError: it cannot be written.
        """
        self._path = Path(path)
        try:
            self._file = self._path.open("w", encoding="utf-8", newline="\n")
        except OSError as error:
            raise DatasetError(f"{self._path}: recorded detections cannot be written: {error.strerror}") from error

    def record(self, frame: Frame, detections: Detections) -> None:
        """Write one line; stamps must rise."""
        line = {
            "timestamp_s": float(frame.timestamp_s),
            "boxes_px": detections.boxes_px.tolist(),
            "labels": list(detections.labels),
            "scores": detections.scores.tolist(),
        }
        if detections.masks is not None:
            line["masks"] = [encode_mask(mask) if mask.any() else None for mask in detections.masks]
        self._file.write(json.dumps(line, allow_nan=False) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file; a second time does nothing."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
