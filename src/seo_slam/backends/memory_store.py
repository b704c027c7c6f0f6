"""A store that forgets when the process ends."""

from collections.abc import Iterable
from dataclasses import replace
from types import TracebackType
from typing import Self, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from seo_slam.backends.store_checks import require_amendment, require_next, without_clouds
from seo_slam.errors import MapError
from seo_slam.geometry import FloatArray
from seo_slam.mapping.nearby import rows_within
from seo_slam.records import Amendment, EditRecord, KeyframeRecord
from seo_slam.types import IntArray, Landmark, Observations

_Change = TypeVar("_Change", KeyframeRecord, Amendment)
_Precision = type[np.float32] | type[np.float64]


class MemoryStore:
    """A ``MapStore`` in memory: for runs whose result is only a map.json, and for tests.

    Like map.db it keeps no clouds, and embeddings in single precision: they are what a long run fills memory with.
    """

    def __init__(self) -> None:
        self._keyframes: dict[int, KeyframeRecord] = {}
        self._landmarks: dict[int, Landmark] = {}
        self._history: dict[int, list[tuple[int, str, str, str]]] = {}
        self._edits: list[EditRecord] = []
        self._meta: dict[str, str] = {}
        self._last_id: int | None = None
        self._next_landmark_id = 0
        self._closed = False

    def commit(self, record: KeyframeRecord) -> None:
        """Keep a keyframe, wholly or not at all; clouds are dropped.

        Raises:
            MapError: its id does not rise, a value could not be kept, or the store is closed.
        """
        self._require_open()
        require_next(record, self._last_id)
        kept = replace(self._kept(record), observations=_observations(record.observations, np.float32))
        self._keyframes[record.keyframe_id] = kept
        self._last_id = record.keyframe_id
        self._use_ids(record.landmark_ids.tolist())
        self._change(kept)

    def amend(self, amendment: Amendment) -> None:
        """Keep a change of the map that no keyframe made, wholly or not at all.

        Raises:
            MapError: its keyframe is not the newest, a value could not be kept, or the store is closed.
        """
        self._require_open()
        require_amendment(amendment, self._last_id)
        self._change(self._kept(amendment))

    def edits(self) -> tuple[EditRecord, ...]:
        """Everything that agents proposed and what became of it, in the order it was kept; the first is edit number 1."""
        return tuple(_edit(edit, np.float64) for edit in self._edits)

    def _kept(self, change: _Change) -> _Change:
        """What is kept of a change; an embedding that is as it was is not kept twice."""
        landmarks = [_landmark(landmark, np.float32) for landmark in change.landmarks]
        for row, landmark in enumerate(landmarks):
            before = self._landmarks.get(landmark.id)
            if before is not None and np.array_equal(before.embedding, landmark.embedding):
                landmarks[row] = replace(landmark, embedding=before.embedding)
        return replace(change, landmarks=tuple(landmarks), edits=tuple(_edit(edit, np.float32) for edit in change.edits))

    def _change(self, change: KeyframeRecord | Amendment) -> None:
        self._landmarks.update({landmark.id: landmark for landmark in change.landmarks})
        for landmark_id in change.removed_ids:
            self._landmarks.pop(landmark_id, None)
        for event in change.events:
            lines = self._history.setdefault(event.landmark_id, [])
            lines.append((change.keyframe_id, event.kind, event.detail, event.source))
        self._edits += change.edits
        self._use_ids([*change.removed_ids, *(landmark.id for landmark in change.landmarks), *(e.landmark_id for e in change.events)])

    def _use_ids(self, used: Iterable[int]) -> None:
        self._next_landmark_id = max(self._next_landmark_id, *(i + 1 for i in used), 0)

    def keyframe(self, keyframe_id: int) -> KeyframeRecord:
        """Return a keyframe as it was committed, without clouds, embeddings in single precision.

        Raises:
            MapError: no such keyframe.
        """
        if keyframe_id not in self._keyframes:
            raise MapError(f"no keyframe {keyframe_id}; {len(self._keyframes)} are kept")
        kept = self._keyframes[keyframe_id]
        return replace(
            kept,
            observations=_observations(kept.observations, np.float64),
            landmarks=tuple(_landmark(landmark, np.float64) for landmark in kept.landmarks),
            edits=tuple(_edit(edit, np.float64) for edit in kept.edits),
        )

    def keyframe_ids(self) -> IntArray:
        """(T,) ids of the keyframes kept, rising."""
        return np.array(list(self._keyframes), dtype=np.int64)

    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Stamps (T,) in seconds and ``T_world_camera`` (T, 4, 4) of all keyframes, as they were when committed."""
        records = list(self._keyframes.values())
        stamps = np.array([r.timestamp_s for r in records], dtype=np.float64)
        return stamps, np.array([r.T_world_camera for r in records], dtype=np.float64).reshape(-1, 4, 4)

    def observations(self, landmark_id: int) -> tuple[IntArray, Observations]:
        """Keyframe ids (M,) and the measurements given to a landmark when they were committed, oldest first."""
        ids: list[int] = []
        parts: list[Observations] = []
        for record in self._keyframes.values():
            rows = np.flatnonzero(record.landmark_ids == landmark_id)
            if len(rows):
                ids += [record.keyframe_id] * len(rows)
                parts.append(record.observations[rows])
        return np.array(ids, dtype=np.int64), _observations(stack_observations(parts), np.float64)

    def landmarks(self) -> tuple[Landmark, ...]:
        """All landmarks in the map, by rising id, tentative ones included."""
        return tuple(_landmark(self._landmarks[i], np.float64) for i in sorted(self._landmarks))

    def near(self, p_world: ArrayLike, radius_m: float) -> tuple[int, ...]:
        """Ids of landmarks within ``radius_m`` of a point (3,), world frame, nearest first.

        Raises:
            FrameError: not a finite point, or a negative radius.
        """
        positions_m = np.array([row.position_m for row in self._landmarks.values()], dtype=np.float64).reshape(-1, 3)
        ids = np.array(list(self._landmarks), dtype=np.int64)
        return tuple(ids[rows_within(positions_m, ids, p_world, radius_m)].tolist())

    def history(self, landmark_id: int) -> tuple[tuple[int, str, str, str], ...]:
        """``(keyframe_id, kind, detail, source)`` of every event of a landmark, oldest first; also of ids that left the map."""
        return tuple(self._history.get(landmark_id, ()))

    def next_id(self) -> int:
        """The lowest landmark id that was never used."""
        return max(self._next_landmark_id, int(self._meta.get("next_id", 0)))

    def set_meta(self, key: str, value: str) -> None:
        """Keep a fact about the whole map."""
        self._require_open()
        self._meta[key] = value

    def meta(self) -> dict[str, str]:
        """Every fact kept by ``set_meta``."""
        return dict(self._meta)

    def close(self) -> None:
        """Take no more commits; what was kept can still be read."""
        self._closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def _require_open(self) -> None:
        if self._closed:
            raise MapError("the store is closed and takes no more commits")


def _landmark(landmark: Landmark, precision: _Precision) -> Landmark:
    return replace(landmark, embedding=_in(precision, landmark.embedding), cloud_world=np.zeros((0, 3)))


def _edit(edit: EditRecord, precision: _Precision) -> EditRecord:
    return replace(edit, before=tuple(_landmark(landmark, precision) for landmark in edit.before))


def _observations(observations: Observations, precision: _Precision) -> Observations:
    return replace(without_clouds(observations), embeddings=_in(precision, observations.embeddings))


def _in(precision: _Precision, embedding: FloatArray) -> FloatArray:
    return cast(FloatArray, embedding.astype(precision))  # single only while it is kept


def stack_observations(parts: list[Observations]) -> Observations:
    """Join measurements of several keyframes, row after row."""
    if not parts:
        return Observations.empty()
    return Observations(
        p_camera=np.concatenate([p.p_camera for p in parts]),
        cov_camera=np.concatenate([p.cov_camera for p in parts]),
        size_m=np.concatenate([p.size_m for p in parts]),
        labels=tuple(label for p in parts for label in p.labels),
        scores=np.concatenate([p.scores for p in parts]),
        embeddings=np.concatenate([p.embeddings for p in parts]),
        boxes_px=np.concatenate([p.boxes_px for p in parts]),
        truncated=np.concatenate([p.truncated for p in parts]),
        clouds=tuple(cloud for p in parts for cloud in p.clouds),
        rows=np.concatenate([p.rows for p in parts]),
    )
