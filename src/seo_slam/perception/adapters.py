"""From whatever a detector returns to ``Detections`` that fit the image.

A plug-in may return our ``Detections``, an object laid out like ``supervision.Detections`` (which is not imported), or any object or
mapping with boxes, labels, scores and perhaps masks. All of it passes here before the pipeline uses it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.geometry import AnyArray, FloatArray
from seo_slam.perception.labels import clean_label
from seo_slam.types import BoolArray, Detections, Frame

# What detectors call these, the most telling name first.
_BOXES = ("boxes_px", "xyxy", "boxes")
_SCORES = ("scores", "confidence")
_LABELS = ("text_labels", "labels", "class_name", "class_id")
_MASKS = ("masks", "mask")

_MIN_SIDE_PX = 1.0
_ROUNDING = 1e-6  # float32 scores may exceed 1 by this much


def to_detections(found: Any, image: Frame | Camera, source: str = "detector") -> Detections:
    """Return ``found`` as ``Detections`` whose boxes lie in the image.

    Boxes that hang over the border are clipped to ``0..width`` and ``0..height``; one of which less than a pixel is left is dropped.
    Missing scores become 1, labels are cleaned (``clean_label``), class numbers without words become "class 3", a mask that is None in a
    list of masks becomes an empty one, which means: use the box. Applying this twice changes nothing.

    Args:
        found: ``Detections``; or an object with attributes, or a mapping with keys, of which ``boxes_px``, ``xyxy`` or ``boxes`` (N, 4)
            is needed, and ``text_labels``, ``labels``, ``data["class_name"]`` or ``class_id`` (N), ``scores`` or ``confidence`` (N),
            ``masks`` or ``mask`` (N, H, W) and ``embeddings`` (N, D) may be there. Arrays may be lists or CPU/GPU tensors.
        image: the frame, or only its camera, to which the boxes belong.
        source: who found it, for messages.

    Raises:
        FrameError: names frame, source and row: NaN, a box wholly outside the image, x0 >= x1, lengths that differ, a mask of another
            size than the image, a score outside 0..1.
    """
    camera = image.camera if isinstance(image, Frame) else image
    where = f"{source}, frame {image.index} (t={image.timestamp_s})" if isinstance(image, Frame) else source
    boxes, scores, labels = _boxes(found, where), _scores(found, where), _labels(found, where)
    n = len(boxes)
    scores = np.ones(n) if scores is None else scores
    labels = (None,) * n if labels is None else labels
    masks, embeddings = _masks(found, n, camera, where), _embeddings(found, n, where)
    for name, rows in (("scores", scores), ("labels", labels), ("masks", masks), ("embeddings", embeddings)):
        if rows is not None and len(rows) != n:
            raise FrameError(f"{where}: got {n} boxes and {len(rows)} {name}, wanted as many of each")
    _require_usable(boxes, scores, camera, where)
    clipped = clip_boxes(boxes, camera.width, camera.height)
    vanished = ((clipped[:, 2:] - clipped[:, :2] < _MIN_SIDE_PX) & (clipped != boxes).reshape(n, 2, 2).any(axis=1)).any(axis=1)
    detections = Detections(clipped, labels, np.clip(scores, 0.0, 1.0), masks, embeddings)
    return detections[~vanished] if vanished.any() else detections


def clip_boxes(boxes_px: FloatArray, width: int, height: int) -> FloatArray:
    """Return boxes (N, 4) clipped to an image, in pixels."""
    return np.clip(boxes_px, 0.0, np.array([width, height, width, height], dtype=np.float64))


def outside(boxes_px: FloatArray, camera: Camera) -> BoolArray:
    """Return (N,) bool: no part of the box is inside the image."""
    beyond = (boxes_px[:, :2] >= (camera.width, camera.height)) | (boxes_px[:, 2:] <= 0.0)
    return np.asarray(beyond.any(axis=1))


def _require_usable(boxes: FloatArray, scores: FloatArray, camera: Camera, where: str) -> None:
    bad = ~(np.isfinite(boxes).all(axis=1) & np.isfinite(scores))
    if bad.any():
        row = int(np.argmax(bad))
        raise FrameError(f"{where}, row {row}: box {boxes[row].tolist()} with score {scores[row]} is not finite")
    bad = np.asarray((boxes[:, 2:] <= boxes[:, :2]).any(axis=1))
    if bad.any():
        row = int(np.argmax(bad))
        raise FrameError(f"{where}, row {row}: box is {boxes[row].tolist()}, wanted x0 < x1 and y0 < y1 (x0, y0, x1, y1 in pixels)")
    bad = outside(boxes, camera)
    if bad.any():
        row = int(np.argmax(bad))
        raise FrameError(
            f"{where}, row {row}: box {boxes[row].tolist()} is wholly outside the {camera.width}x{camera.height} image; wanted pixels "
            "of the image as it is in the frame"
        )
    bad = (scores < 0.0) | (scores > 1.0 + _ROUNDING)
    if bad.any():
        row = int(np.argmax(bad))
        raise FrameError(f"{where}, row {row}: score is {scores[row]}, wanted 0..1")


def _boxes(found: Any, where: str) -> FloatArray:
    value = _first(found, _BOXES)
    if value is None:
        raise FrameError(
            f"{where}: got {type(found).__name__}, wanted Detections or something with boxes ({', '.join(_BOXES)}), labels and scores"
        )
    boxes = _numbers(value, "boxes", where)
    if boxes.size == 0:
        return np.zeros((0, 4))
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise FrameError(f"{where}: boxes are {boxes.shape}, wanted (N, 4): x0, y0, x1, y1 in pixels")
    return boxes


def _scores(found: Any, where: str) -> FloatArray | None:
    value = _first(found, _SCORES)
    if value is None:
        return None
    scores = _numbers(value, "scores", where)
    if scores.ndim != 1:
        raise FrameError(f"{where}: scores are {scores.shape}, wanted (N,)")
    return scores


def _labels(found: Any, where: str) -> tuple[str | None, ...] | None:
    extra = _first(found, ("data",))
    names = _first(extra, ("class_name",)) if isinstance(extra, Mapping) else None
    value = names if names is not None else _first(found, _LABELS)
    if value is None:
        return None
    if isinstance(value, str):
        raise FrameError(f"{where}: labels are one text {value!r:.40}, wanted a list of texts or None")
    items = value if isinstance(value, list | tuple) else _array(value).tolist()
    labels: list[str | None] = []
    for row, item in enumerate(items):
        try:
            labels.append(clean_label(item))
        except FrameError as error:
            raise FrameError(f"{where}, row {row}: {error}") from None
    return tuple(labels)


def _masks(found: Any, n: int, camera: Camera, where: str) -> BoolArray | None:
    value = _first(found, _MASKS)
    if value is None:
        return None
    size = (camera.height, camera.width)
    rows = list(value) if isinstance(value, list | tuple) else _array(value)
    if len(rows) != n:
        raise FrameError(f"{where}: got {n} boxes and {len(rows)} masks, wanted as many of each")
    if isinstance(rows, np.ndarray) and rows.dtype == np.bool_ and rows.shape == (n, *size):
        return rows
    out = np.zeros((n, *size), dtype=np.bool_)
    for row, item in enumerate(rows):
        if item is None:
            continue
        mask = _array(item)
        if mask.ndim == 3 and mask.shape[0] == 1:  # some networks keep a channel axis
            mask = mask[0]
        if mask.shape != size:
            raise FrameError(f"{where}, row {row}: mask is {mask.shape}, wanted {size}, the size of the image")
        out[row] = mask > 0.5 if mask.dtype.kind == "f" else mask != 0
    return out


def _embeddings(found: Any, n: int, where: str) -> FloatArray | None:
    value = _first(found, ("embeddings",))
    if value is None:
        return None
    embeddings = _numbers(value, "embeddings", where)
    if n == 0 and embeddings.size == 0:  # an empty list says no D
        return None
    if embeddings.ndim != 2:
        raise FrameError(f"{where}: embeddings are {embeddings.shape}, wanted (N, D)")
    bad = ~np.isfinite(embeddings).all(axis=1)
    if bad.any():
        raise FrameError(f"{where}, row {int(np.argmax(bad))}: the embedding is not finite")
    return embeddings


def _first(found: Any, names: tuple[str, ...]) -> Any:
    for name in names:
        value = found.get(name) if isinstance(found, Mapping) else getattr(found, name, None)
        if value is not None:
            return value
    return None


def _array(value: Any) -> AnyArray:
    if hasattr(value, "detach"):  # a torch tensor, perhaps on a GPU or with a gradient
        value = value.detach().cpu()
    return np.asarray(value)


def _numbers(value: Any, name: str, where: str) -> FloatArray:
    try:
        return np.asarray(_array(value), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise FrameError(f"{where}: {name} are not an array of numbers: {error}") from None
