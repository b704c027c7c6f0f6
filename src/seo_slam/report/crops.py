"""Collects, while a pipeline runs, what the report shows of each landmark: its best picture and what it was called when."""

from collections import Counter, deque
from dataclasses import dataclass, field

import cv2
import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.records import MapEvent, StepResult
from seo_slam.report.label_history import LabelHistory, LabelRun
from seo_slam.types import Frame

LONGER_SIDE_PX = 160
_JPEG_QUALITY = 82
_PADDING_SHARE = 0.12
_MOST_LIFE_EVENTS = 64
_SURE = frozenset({"stable", "lost", "found", "moved"})  # what happens to a landmark only once it was stable
_THERE = frozenset({"created", "stable", "found", "moved"})
_HALF_VALUE_AREA_SHARE = 0.01  # a box of 1 % of the image is worth half of a very large one


@dataclass(frozen=True, slots=True)
class Crop:
    """A picture of one object.

    Attributes:
        jpeg: the file's bytes, at most 160 px on the longer side.
        width_px, height_px: of the picture.
        box_share: left, top, right, bottom of the object's box, as shares (0..1) of the picture's width and height.
        timestamp_s: stamp of the frame it was cut from.
        value: how good it is, see ``crop_value``.
    """

    jpeg: bytes
    width_px: int
    height_px: int
    box_share: tuple[float, float, float, float]
    timestamp_s: float
    value: float


@dataclass(frozen=True, slots=True)
class RecordedEvent:
    """An event of the map and when it happened."""

    timestamp_s: float
    keyframe_id: int | None
    event: MapEvent


@dataclass(slots=True)
class _Seen:
    labels: LabelHistory = field(default_factory=LabelHistory)
    crop: Crop | None = None
    observations: int = 0
    last_s: float = 0.0
    life: list[RecordedEvent] = field(default_factory=list)
    was_stable: bool = False
    is_gone: bool = False


def crop_value(score: float, truncated_sides: int, box_area_px: float, image_area_px: float) -> float:
    """How well a box shows its object: score x visibility, in [0, 1).

    Visibility halves with every side cut by the image border, and grows with the box's area towards 1.
    """
    area = box_area_px / (box_area_px + _HALF_VALUE_AREA_SHARE * image_area_px)
    return float(score * 0.5**truncated_sides * area)


def cut_crop(frame: Frame, box_px: FloatArray, value: float) -> Crop | None:
    """Cut a box (4,) with some padding out of the image and compress it; None if nothing of it lies in the image."""
    height, width = frame.rgb.shape[:2]
    pad = 4.0 + _PADDING_SHARE * max(box_px[2] - box_px[0], box_px[3] - box_px[1])
    x0, y0 = max(int(box_px[0] - pad), 0), max(int(box_px[1] - pad), 0)
    x1, y1 = min(int(np.ceil(box_px[2] + pad)), width), min(int(np.ceil(box_px[3] + pad)), height)
    if x1 - x0 < 2 or y1 - y0 < 2:
        return None
    image = frame.rgb[y0:y1, x0:x1]
    shrink = LONGER_SIDE_PX / max(x1 - x0, y1 - y0)
    if shrink < 1.0:
        size = (max(round((x1 - x0) * shrink), 1), max(round((y1 - y0) * shrink), 1))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    ok, jpeg = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not ok:
        return None
    share = (box_px - np.array([x0, y0, x0, y0])) / np.array([x1 - x0, y1 - y0, x1 - x0, y1 - y0])
    left, top, right, bottom = (float(s) for s in np.clip(share, 0.0, 1.0))
    return Crop(jpeg.tobytes(), image.shape[1], image.shape[0], (left, top, right, bottom), frame.timestamp_s, value)


class ReportRecorder:
    """Watches a run, a keyframe at a time, for ``write_report``.

    It keeps compressed pictures and runs of labels only, so memory stays bounded: about 5 kB a landmark, and never more
    than ``crop_budget_bytes`` of pictures (then those of the least seen landmarks go).

    Args:
        margin: a new crop is cut only if it is worth this many times the best so far, which keeps the cost a keyframe low.
        crop_budget_bytes: of all pictures together.
        max_events: events kept; older ones are only counted.
    """

    def __init__(self, *, margin: float = 1.2, crop_budget_bytes: int = 32 * 2**20, max_events: int = 2000) -> None:
        self._margin = margin
        self._budget_bytes = crop_budget_bytes
        self._bytes = 0
        self._seen: dict[int, _Seen] = {}
        self._merged_into: dict[int, int] = {}
        self._events: deque[RecordedEvent] = deque(maxlen=max_events)
        self._event_counts: Counter[str] = Counter()

    @property
    def events(self) -> tuple[RecordedEvent, ...]:
        """The newest events, oldest first."""
        return tuple(self._events)

    @property
    def event_counts(self) -> dict[str, int]:
        """Kind -> how many there were in the whole run."""
        return dict(self._event_counts)

    @property
    def crop_bytes(self) -> int:
        """Bytes of all pictures held."""
        return self._bytes

    def crop(self, landmark_id: int) -> Crop | None:
        """The best picture of a landmark, or None."""
        seen = self._seen.get(self._survivor(landmark_id))
        return seen.crop if seen else None

    def label_history(self, landmark_id: int) -> tuple[LabelRun, ...]:
        """What the detector called a landmark, in order of time; empty if it was never seen."""
        seen = self._seen.get(self._survivor(landmark_id))
        return seen.labels.runs if seen else ()

    def life(self, landmark_id: int) -> tuple[RecordedEvent, ...]:
        """What happened to a landmark (created, stable, lost, found, moved, merged, removed), in order of time, the newest 64."""
        seen = self._seen.get(self._survivor(landmark_id))
        return tuple(seen.life) if seen else ()

    @property
    def gone(self) -> tuple[int, ...]:
        """Ids of landmarks that were stable once and were removed, by rising id. Their picture and history stay."""
        return tuple(sorted(landmark_id for landmark_id, seen in self._seen.items() if seen.is_gone))

    def observe(self, frame: Frame, step: StepResult) -> None:
        """Take in one frame and what the pipeline made of it. Frames between keyframes cost nothing."""
        observations, ids = step.observations, step.landmark_ids
        if observations is not None and ids is not None:
            image_area = float(frame.rgb.shape[0] * frame.rgb.shape[1])
            sides = observations.truncated.sum(axis=1)
            areas = np.prod(observations.boxes_px[:, 2:] - observations.boxes_px[:, :2], axis=1)
            for row, landmark_id in enumerate(ids.tolist()):
                if landmark_id < 0:  # REJECTED
                    continue
                seen = self._seen.setdefault(self._survivor(landmark_id), _Seen())
                seen.observations += 1
                seen.last_s = step.timestamp_s
                seen.labels.add(step.timestamp_s, observations.labels[row])
                value = crop_value(float(observations.scores[row]), int(sides[row]), float(areas[row]), image_area)
                if seen.crop is None or value > self._margin * seen.crop.value:
                    self._keep(seen, cut_crop(frame, observations.boxes_px[row], value))
        for event in step.events:
            self._follow(event, step)

    def _keep(self, seen: _Seen, crop: Crop | None) -> None:
        if crop is None:
            return
        self._bytes += len(crop.jpeg) - (len(seen.crop.jpeg) if seen.crop else 0)
        seen.crop = crop
        if self._bytes > self._budget_bytes:
            self._drop_least_seen()

    def _drop_least_seen(self) -> None:
        for seen in sorted(self._seen.values(), key=lambda s: (not s.is_gone, s.observations, s.last_s)):
            if self._bytes <= 0.9 * self._budget_bytes:
                return
            self._forget_crop(seen)

    def _forget_crop(self, seen: _Seen) -> None:
        self._bytes -= len(seen.crop.jpeg) if seen.crop else 0
        seen.crop = None

    def _follow(self, event: MapEvent, step: StepResult) -> None:
        recorded = RecordedEvent(step.timestamp_s, step.keyframe_id, event)
        self._events.append(recorded)
        self._event_counts[event.kind] += 1
        if event.kind == "merged" and event.other_id is not None:
            self._merge(event.landmark_id, event.other_id)
            self._note(self._seen.setdefault(self._survivor(event.other_id), _Seen()), recorded)
            return
        if event.kind == "moved" and event.other_id is not None:
            self._merge(event.other_id, event.landmark_id)  # what was seen at the new place was this thing
        if event.kind == "removed":
            self._remove(recorded)
        elif event.kind in _THERE | _SURE:
            seen = self._seen.setdefault(self._survivor(event.landmark_id), _Seen())
            seen.was_stable |= event.kind in _SURE
            seen.is_gone &= event.kind not in _THERE
            self._note(seen, recorded)

    def _note(self, seen: _Seen, event: RecordedEvent) -> None:
        seen.life.append(event)
        del seen.life[:-_MOST_LIFE_EVENTS]

    def _remove(self, event: RecordedEvent) -> None:
        seen = self._seen.get(event.event.landmark_id)
        if seen is None:
            return
        if seen.was_stable:
            seen.is_gone = True
            self._note(seen, event)
        else:  # nobody relied on it: most of these are false detections
            self._forget_crop(seen)
            del self._seen[event.event.landmark_id]

    def _merge(self, gone_id: int, kept_id: int) -> None:
        gone_id, kept_id = self._survivor(gone_id), self._survivor(kept_id)
        if gone_id == kept_id:
            return
        self._merged_into[gone_id] = kept_id
        gone = self._seen.pop(gone_id, None)
        if gone is None:
            return
        kept = self._seen.setdefault(kept_id, _Seen())
        kept.labels.merge(gone.labels)
        kept.life = sorted([*kept.life, *gone.life], key=lambda item: item.timestamp_s)[-_MOST_LIFE_EVENTS:]
        kept.was_stable |= gone.was_stable
        kept.observations += gone.observations
        kept.last_s = max(kept.last_s, gone.last_s)
        if gone.crop and (kept.crop is None or gone.crop.value > kept.crop.value):
            kept.crop, gone.crop = gone.crop, kept.crop
        self._forget_crop(gone)

    def _survivor(self, landmark_id: int) -> int:
        while landmark_id in self._merged_into:
            landmark_id = self._merged_into[landmark_id]
        return landmark_id
