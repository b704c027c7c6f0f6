"""YOLOX detectors (Ge et al., "YOLOX: Exceeding YOLO Series in 2021") run by ONNX Runtime on the CPU."""

from pathlib import Path

import cv2
import numpy as np
import onnxruntime

from seo_slam.backends.coco_names import COCO_NAMES
from seo_slam.errors import BackendError, ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.perception.adapters import clip_boxes
from seo_slam.perception.boxes import iou
from seo_slam.types import Detections, Frame, IntArray

Float32Array = np.ndarray[tuple[int, ...], np.dtype[np.float32]]

_GREY = 114  # what YOLOX was trained to see beside a picture that does not fill its square
_STRIDES = (8, 16, 32)
_STRIDES_P6 = (8, 16, 32, 64)
_MIN_SIDE_PX = 1.0


class YoloxDetector:
    """A YOLOX network as exported by its authors: input (1, 3, H, W), output (1, anchors, 5 + classes).

    One box gets one label, its likeliest class. The same image gives the same detections.
    """

    def __init__(
        self,
        weights: str | Path,
        score: float = 0.35,
        nms_iou: float = 0.45,
        threads: int = 1,
        labels: str | Path | None = None,
    ) -> None:
        """Load the network and run it once, on grey.

        Args:
            weights: the ONNX file; its input size must be fixed.
            score: detections below it are left out, 0..1.
            nms_iou: of two boxes of one class that overlap more, the better one stays, 0..1.
            threads: CPU threads of the network.
            labels: a text file with one class name a line; None for the 80 classes of COCO.

        Raises:
            ConfigError: a file is missing, a number out of range, or the names are not as many as the classes.
            BackendError: the weights are no ONNX model, or not one of a YOLOX.
        """
        if not (0.0 <= score <= 1.0 and 0.0 <= nms_iou <= 1.0 and threads >= 1):
            raise ConfigError(f"yolox: got score {score}, nms_iou {nms_iou}, threads {threads}; wanted 0..1, 0..1 and at least one thread")
        self._score, self._nms_iou = float(score), float(nms_iou)
        self._weights = Path(weights)
        self._session = _open_session(self._weights, threads)
        self._input_name, self._input_size = _input_layout(self._session, self._weights)
        self._canvas = np.full((1, 3, *self._input_size), float(_GREY), dtype=np.float32)
        self._filled = (0, 0)
        trial = self._try()
        self._offsets_px, self._strides_px = _anchors(self._input_size, trial.shape, self._weights)
        # Exports with the decoding inside give pixels, others offsets of a few cells.
        self._is_decoded = bool(np.abs(trial[0, :, :2]).max() > 0.5 * min(self._input_size))
        self._names = _class_names(labels, trial.shape[2] - 5, self._weights)

    @property
    def names(self) -> tuple[str, ...]:
        """The classes it knows, in the order of the network's output."""
        return self._names

    def detect(self, frame: Frame) -> Detections:
        """Return the objects in ``frame.rgb``, best first, boxes clipped to the image."""
        scale = self._place(frame.rgb)
        boxes, scores, classes = self._decode(self._infer()[0])
        width, height = frame.camera.width, frame.camera.height
        boxes = clip_boxes(boxes / scale, width, height)
        # The network also looks at the grey beside the picture; what it sees there is nothing.
        visible = (boxes[:, 2:] - boxes[:, :2] >= _MIN_SIDE_PX).all(axis=1)
        boxes, scores, classes = boxes[visible], scores[visible], classes[visible]
        kept = suppress(boxes, scores, classes, self._nms_iou)
        return Detections(boxes[kept], tuple(self._names[c] for c in classes[kept]), scores[kept])

    def _place(self, rgb: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> float:
        """Draw the image, scaled to fit, into the top left of the network's input; return the scale."""
        height, width = self._input_size
        scale = min(height / rgb.shape[0], width / rgb.shape[1])
        h, w = int(rgb.shape[0] * scale), int(rgb.shape[1] * scale)
        small = cv2.resize(rgb, (w, h), interpolation=cv2.INTER_LINEAR) if (h, w) != rgb.shape[:2] else rgb
        if self._filled != (h, w):
            self._canvas.fill(float(_GREY))
            self._filled = (h, w)
        for channel in range(3):  # RGB in, BGR out
            self._canvas[0, channel, :h, :w] = small[:, :, 2 - channel]
        return scale

    def _try(self) -> Float32Array:
        try:
            return self._infer()
        except Exception as error:  # ONNX Runtime's errors have no common base class
            raise BackendError(f"{self._weights}: not a YOLOX model: it does not run on one image: {_first_line(error)}") from error

    def _infer(self) -> Float32Array:
        return np.asarray(self._session.run(None, {self._input_name: self._canvas})[0], dtype=np.float32)

    def _decode(self, raw: Float32Array) -> tuple[FloatArray, FloatArray, IntArray]:
        """Boxes (N, 4) in pixels of the network's input, scores (N,) and classes (N,) of all anchors that reach the score."""
        # A class probability is at most 1, so an anchor whose objectness is below the score cannot reach it.
        rows = np.flatnonzero(raw[:, 4] >= self._score)
        found = raw[rows]
        classes = np.argmax(found[:, 5:], axis=1)
        scores = found[:, 4] * found[np.arange(len(rows)), 5 + classes]
        good = scores >= self._score
        rows, found, classes, scores = rows[good], found[good], classes[good], scores[good]
        centre, side = found[:, :2], found[:, 2:4]
        if not self._is_decoded:
            stride = self._strides_px[rows]
            centre = centre * stride + self._offsets_px[rows]
            side = np.exp(np.minimum(side, 20.0)) * stride  # e^20 strides are beyond any image
        boxes = np.concatenate([centre - 0.5 * side, centre + 0.5 * side], axis=1)
        return boxes.astype(np.float64), np.minimum(scores, 1.0).astype(np.float64), classes.astype(np.int64)


def suppress(boxes_px: FloatArray, scores: FloatArray, classes: IntArray, max_iou: float) -> IntArray:
    """Class-aware non-maximum suppression: rows to keep, best first; of equal scores the earlier row comes first."""
    order = np.argsort(-scores, kind="stable")
    boxes, kinds = boxes_px[order], classes[order]
    rivals = (iou(boxes, boxes) > max_iou) & (kinds[:, None] == kinds[None, :])
    keep = np.ones(len(order), dtype=np.bool_)
    for i in np.flatnonzero(np.triu(rivals, 1).any(axis=1)):
        if keep[i]:
            keep[i + 1 :] &= ~rivals[i, i + 1 :]
    return np.asarray(order[keep], dtype=np.int64)


def _open_session(weights: Path, threads: int) -> onnxruntime.InferenceSession:
    if not weights.is_file():
        raise ConfigError(f"{weights}: no such weights file; wanted a YOLOX model as ONNX")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(str(weights), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors have no common base class
        raise BackendError(f"{weights}: not a model that ONNX Runtime can load: {_first_line(error)}") from error


def _input_layout(session: onnxruntime.InferenceSession, weights: Path) -> tuple[str, tuple[int, int]]:
    inputs = session.get_inputs()
    shape = list(inputs[0].shape) if inputs else []
    one_image = len(inputs) == 1 and len(shape) == 4 and (shape[0] == 1 or not isinstance(shape[0], int))
    if not one_image or shape[1] != 3 or inputs[0].type != "tensor(float)" or not all(isinstance(s, int) for s in shape[2:]):
        got = ", ".join(f"{i.name} {i.type} {i.shape}" for i in inputs)
        raise BackendError(f"{weights}: not a YOLOX model: input is {got or 'missing'}, wanted one float (1, 3, H, W) of fixed size")
    return inputs[0].name, (int(shape[2]), int(shape[3]))


def _anchors(input_size: tuple[int, int], output_shape: tuple[int, ...], weights: Path) -> tuple[Float32Array, Float32Array]:
    """Offsets (A, 2) and strides (A, 1) in pixels of the network's input, one row an anchor."""
    height, width = input_size
    for strides in (_STRIDES, _STRIDES_P6):
        cells = [(height // s, width // s) for s in strides]
        if len(output_shape) == 3 and output_shape[1] == sum(h * w for h, w in cells) and output_shape[2] > 5:
            grids = [np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=2).reshape(-1, 2) for h, w in cells]
            stride = np.concatenate([np.full((len(g), 1), s) for g, s in zip(grids, strides, strict=True)])
            return (np.concatenate(grids) * stride).astype(np.float32), stride.astype(np.float32)
    wanted = sum((height // s) * (width // s) for s in _STRIDES)
    raise BackendError(
        f"{weights}: not a YOLOX model: output is {tuple(output_shape)}, wanted (1, {wanted}, 5 + classes) for an input of {width}x{height}"
    )


def _class_names(labels: str | Path | None, classes: int, weights: Path) -> tuple[str, ...]:
    if labels is None:
        names, source = COCO_NAMES, "the names of COCO"
    else:
        file = Path(labels)
        try:
            names = tuple(line.strip() for line in file.read_text(encoding="utf-8").splitlines() if line.strip())
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{file}: class names cannot be read: {_first_line(error)}") from error
        source = str(file)
    if len(names) != classes:
        raise ConfigError(
            f"{weights} has {classes} classes, {source} {len(names)}; give a text file with one name a line as option 'labels'"
        )
    return names


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
