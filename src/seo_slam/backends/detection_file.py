"""The file of recorded detections: JSON lines, one frame a line.

``{"timestamp_s": t, "boxes_px": [[x0, y0, x1, y1], …], "labels": [text or null, …], "scores": […], "masks": [code or null, …]}``

Stamps are those of the colour images and rise, ``masks`` (COCO run-length) may be left out, a frame without a line had no detections.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from seo_slam.camera import Camera
from seo_slam.errors import DatasetError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.perception.adapters import outside
from seo_slam.perception.run_length import decode_mask, read_code
from seo_slam.types import BoolArray, Detections

NEEDED_KEYS = ("timestamp_s", "boxes_px", "labels", "scores")
STAMP_TOLERANCE_S = 0.0005
"""A line belongs to the frame whose stamp differs by no more; the nearest line wins."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedLine:
    """One line: what a detector saw in one frame.

    Attributes:
        where: file:line, for messages.
        timestamp_s: stamp of the colour image.
        boxes_px: (N, 4) as written, so perhaps hanging over the image.
        labels: N words or None.
        scores: (N,).
        masks: N COCO run-length codes or None; None where the line has no masks at all.
    """

    where: str
    timestamp_s: float
    boxes_px: FloatArray
    labels: tuple[str | None, ...]
    scores: FloatArray
    masks: tuple[dict[str, Any] | None, ...] | None

    def require_fits(self, camera: Camera) -> None:
        """Raise ``DatasetError`` if a box is wholly outside the image or a mask of another size."""
        beyond = outside(self.boxes_px, camera)
        if beyond.any():
            row = int(np.argmax(beyond))
            raise DatasetError(
                f"{self.where}: box {row} {self.boxes_px[row].tolist()} is wholly outside the {camera.width}x{camera.height} image; "
                "are these detections of another recording or image size?"
            )
        for row, code in enumerate(self.masks or ()):
            if code is not None and tuple(code["size"]) != (camera.height, camera.width):
                raise DatasetError(
                    f"{self.where}: mask {row} is of size {list(code['size'])}, wanted [{camera.height}, {camera.width}], that of the image"
                )

    def detections(self, camera: Camera, score: float) -> Detections:
        """Return the rows that reach ``score``, checked against the image.

        Raises:
            DatasetError: as ``require_fits``.
        """
        self.require_fits(camera)
        found = Detections(self.boxes_px, self.labels, self.scores, self._decoded_masks(camera))
        return found if (self.scores >= score).all() else found[self.scores >= score]

    def _decoded_masks(self, camera: Camera) -> BoolArray | None:
        if self.masks is None:
            return None
        masks = np.zeros((len(self.masks), camera.height, camera.width), dtype=np.bool_)
        for row, code in enumerate(self.masks):
            if code is not None:
                masks[row] = decode_mask(code)
        return masks


def read_lines(path: str | Path) -> Iterator[RecordedLine]:
    """Read and check a file of recorded detections; blank lines are passed over.

    Raises:
        DatasetError: names file and line: missing file, bad JSON, unknown or missing keys, lengths that differ, NaN, x0 >= x1, a score
            outside 0..1, a bad mask, stamps that do not rise.
    """
    file = Path(path)
    if not file.is_file():
        raise DatasetError(f"{file}: no such file of recorded detections")
    last: RecordedLine | None = None
    with file.open(encoding="utf-8") as lines:
        try:
            for number, text in enumerate(lines, start=1):
                if text.strip():
                    line = _read_line(text, f"{file}:{number}")
                    if last is not None and line.timestamp_s <= last.timestamp_s:
                        raise DatasetError(
                            f"{line.where}: timestamp_s {line.timestamp_s} does not rise from {last.timestamp_s} before it; "
                            "wanted one line a frame, in order of time"
                        )
                    last = line
                    yield line
        except UnicodeDecodeError as error:
            raise DatasetError(f"{file}: not a text file in UTF-8: {error.reason} at byte {error.start}") from None


def _read_line(text: str, where: str) -> RecordedLine:
    try:
        values = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{where}: not JSON: {error}") from None
    if not isinstance(values, dict):
        raise DatasetError(f"{where}: got a JSON {type(values).__name__}, wanted an object with {', '.join(NEEDED_KEYS)}")
    _require_keys(values, where)
    stamp = values["timestamp_s"]
    if not _is_number(stamp):
        raise DatasetError(f"{where}: timestamp_s is {stamp!r:.40}, wanted seconds")
    labels = _list(values, "labels", where)
    n = len(_list(values, "boxes_px", where))
    for key in ("labels", "scores", "masks"):
        if key in values and len(_list(values, key, where)) != n:
            raise DatasetError(f"{where}: {n} boxes_px, but {len(values[key])} {key}; wanted as many of each")
    for row, label in enumerate(labels):
        if not (label is None or isinstance(label, str)):
            raise DatasetError(f"{where}: label {row} is {label!r:.40}, wanted text or null")
    return RecordedLine(
        where=where,
        timestamp_s=float(stamp),
        boxes_px=_boxes(values["boxes_px"], where),
        labels=tuple(labels),
        scores=_scores(values["scores"], where),
        masks=_masks(values["masks"], where) if "masks" in values else None,
    )


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number that JSON knows; wanted finite numbers")


def _require_keys(values: dict[str, Any], where: str) -> None:
    missing = [key for key in NEEDED_KEYS if key not in values]
    unknown = sorted(set(values) - {*NEEDED_KEYS, "masks"})
    if missing or unknown:
        what = [f"missing {', '.join(missing)}"] if missing else []
        what += [f"unknown {', '.join(map(repr, unknown))}"] if unknown else []
        raise DatasetError(f"{where}: {'; '.join(what)}; wanted the keys {', '.join(NEEDED_KEYS)} and perhaps masks")


def _list(values: dict[str, Any], key: str, where: str) -> list[Any]:
    value = values[key]
    if not isinstance(value, list):
        raise DatasetError(f"{where}: {key} is {value!r:.40}, wanted a list")
    return value


def _is_number(value: Any) -> bool:
    # 1e999 is JSON, but no finite number; nor is a whole number of 400 digits.
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) < 2**62


def _boxes(rows: list[Any], where: str) -> FloatArray:
    for row, box in enumerate(rows):
        if not (isinstance(box, list) and len(box) == 4 and all(map(_is_number, box))):
            raise DatasetError(f"{where}: box {row} is {box!r:.80}, wanted four finite numbers x0, y0, x1, y1")
        if not (box[0] < box[2] and box[1] < box[3]):
            raise DatasetError(f"{where}: box {row} is {box}, wanted x0 < x1 and y0 < y1")
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _scores(rows: list[Any], where: str) -> FloatArray:
    for row, score in enumerate(rows):
        if not _is_number(score) or not 0.0 <= score <= 1.0:
            raise DatasetError(f"{where}: score {row} is {score!r:.40}, wanted 0..1")
    return np.array(rows, dtype=np.float64)


def _masks(rows: list[Any], where: str) -> tuple[dict[str, Any] | None, ...]:
    for row, code in enumerate(rows):
        if code is not None:
            try:
                read_code(code)
            except FrameError as error:
                raise DatasetError(f"{where}: mask {row}: {error}") from None
    return tuple(rows)
