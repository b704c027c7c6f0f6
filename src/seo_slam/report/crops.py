"""Collects, while a pipeline runs, what the report shows of each landmark: its best picture and what it was called when."""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from seo_slam.records import EditRecord, MapEvent, StepResult
from seo_slam.report.crop import Crop, crop_value, cut_crop
from seo_slam.report.edit_log import EditLog, event_of
from seo_slam.report.label_history import LabelHistory, LabelRun
from seo_slam.types import Frame

_MOST_LIFE_EVENTS = 64
_SURE = frozenset({"stable", "lost", "found", "moved"})  # what happens to a landmark only once it was stable
_THERE = frozenset({"created", "stable", "found", "moved"})


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
        self._edits = EditLog(self.crop)

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
    def edits(self) -> EditLog:
        """What agents proposed and what became of it."""
        return self._edits

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
        self._edits.note(step.edits)  # first: they show things as they were
        for event in step.events:
            self._follow(RecordedEvent(step.timestamp_s, step.keyframe_id, event))

    def observe_edits(self, edits: Iterable[EditRecord]) -> None:
        """Take in edits that came between frames or after the last one, and what they did to the landmarks."""
        for edit in edits:
            self._edits.note([edit])
            event = event_of(edit)
            if event is not None:
                self._follow(RecordedEvent(edit.timestamp_s, edit.keyframe_id, event))

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

    def _follow(self, recorded: RecordedEvent) -> None:
        event = recorded.event
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
