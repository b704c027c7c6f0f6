"""What of a keyframe goes into the store."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seo_slam.agents.reply_text import encodable
from seo_slam.composition import Parts
from seo_slam.geometry import FloatArray
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.records import Amendment, EditRecord, KeyframeRecord, MapEvent
from seo_slam.types import Estimate, IntArray, Landmark, Motion, Observations

KEPT_WITHIN_M = 0.01
"""The store keeps every landmark within this of where the map has it."""

COVARIANCE_EVERY = 10
"""A landmark's covariance in the store is at most this many keyframes old; it is dear, and observations only shrink it."""

LONGEST_TEXT = 2000
"""Longer texts in an edit are cut: an agent may say anything, and none of it shall keep a keyframe from being kept."""

_LARGEST_ID = 2**63 - 1


class Keeper:
    """Commits keyframes, each with the landmarks that are new, changed or elsewhere than the store has them.

    A landmark's existence changes with every view of its place, without an event. It is kept whenever the landmark is: when it was
    seen, moved, or changed its state, which is an event. The store's value of one that was only looked for is therefore older.
    """

    def __init__(self, parts: Parts, objects: ObjectMap) -> None:
        """Take the store and smoother among ``parts``, and what else is known of the landmarks."""
        self._parts = parts
        self._objects = objects
        self._kept_at: dict[int, FloatArray] = {}
        self._covariance_of: dict[int, int] = {}  # the keyframe at which each landmark's covariance was asked for

    def keep(
        self,
        keyframe_id: int,
        timestamp_s: float,
        estimate: Estimate,
        motion: Motion | None,
        observations: Observations,
        landmark_ids: IntArray,
        events: Sequence[MapEvent],
        edits: Sequence[EditRecord] = (),
    ) -> None:
        """Commit a keyframe.

        Args:
            keyframe_id: above all before it.
            timestamp_s: its stamp.
            estimate: of its camera.
            motion: from the keyframe before; None for the first.
            observations: K rows, the measurements used.
            landmark_ids: (K,) the landmark of each.
            events: what happened to the map.
            edits: what agents proposed, and what became of it.

        Raises:
            MapError: the store could not; what it lacks then goes with the next keyframe.
        """
        changed, gone = self._changes({int(i) for i in landmark_ids} | _ids_in(events), keyframe_id)
        self._parts.store.commit(
            KeyframeRecord(
                keyframe_id=keyframe_id,
                timestamp_s=timestamp_s,
                T_world_camera=estimate.T_world_camera,
                covariance=estimate.covariance,
                T_previous_current=motion.T_previous_current if motion else np.eye(4),
                motion_covariance=motion.covariance if motion else np.zeros((6, 6)),
                observations=observations,
                landmark_ids=landmark_ids,
                landmarks=tuple(changed),
                removed_ids=tuple(sorted(gone)),
                events=tuple(_storable_event(event) for event in events),
                edits=tuple(_storable(edit) for edit in edits),
            )
        )
        self._have_kept(changed, gone)

    def amend(self, keyframe_id: int, events: Sequence[MapEvent], edits: Sequence[EditRecord]) -> None:
        """Commit what agents changed since the newest keyframe.

        Args:
            keyframe_id: the newest keyframe.
            events: what happened to the map since.
            edits: what agents proposed, and what became of it.

        Raises:
            MapError: the store could not.
        """
        changed, gone = self._changes(_ids_in(events), keyframe_id)
        kept_events = tuple(_storable_event(event) for event in events)
        kept_edits = tuple(_storable(edit) for edit in edits)
        self._parts.store.amend(Amendment(keyframe_id, tuple(changed), tuple(sorted(gone)), kept_events, kept_edits))
        self._have_kept(changed, gone)

    def _changes(self, touched: set[int], keyframe_id: int) -> tuple[list[Landmark], set[int]]:
        """Landmarks that the store has otherwise, or not yet, and ids that it has and the map does not (any more)."""
        ids, p_world = self._parts.smoother.positions()
        gone = (touched | self._kept_at.keys()) - set(ids.tolist())
        rows = np.array([n for n, i in enumerate(ids) if int(i) in touched or self._is_elsewhere(int(i), p_world[n])], dtype=np.int64)
        return self._objects.rows_with(ids[rows], p_world[rows], self._covariances(ids[rows], keyframe_id)), gone

    def _have_kept(self, changed: Sequence[Landmark], gone: set[int]) -> None:
        ids, p_world = self._parts.smoother.positions()
        self._kept_at.update({row.id: p_world[int(np.searchsorted(ids, row.id))] for row in changed})
        for landmark_id in gone:
            self._kept_at.pop(landmark_id, None)
            self._covariance_of.pop(landmark_id, None)

    def _covariances(self, ids: IntArray, keyframe_id: int) -> FloatArray:
        """(N, 3, 3) of landmarks: all anew once one is too old, else only those never asked for."""
        last = [self._covariance_of.get(int(i)) for i in ids]
        too_old = any(known is not None and keyframe_id - known >= COVARIANCE_EVERY for known in last)
        due = np.array([too_old or known is None for known in last], dtype=np.bool_)
        out = np.array([self._objects[int(i)].cov_world for i in ids], dtype=np.float64).reshape(len(ids), 3, 3)
        if due.any():
            out[due] = self._parts.smoother.covariances(ids[due])
            self._covariance_of.update({int(i): keyframe_id for i in ids[due]})
        return out

    def _is_elsewhere(self, landmark_id: int, p_world: FloatArray) -> bool:
        """Whether the store has it elsewhere, or not at all: optimisation moves what is not in view, too."""
        kept_at = self._kept_at.get(landmark_id)
        return kept_at is None or bool(np.abs(p_world - kept_at).max() > KEPT_WITHIN_M)


def _ids_in(events: Sequence[MapEvent]) -> set[int]:
    return {event.landmark_id for event in events} | {event.other_id for event in events if event.other_id is not None}


def _storable(edit: EditRecord) -> EditRecord:
    """The edit with texts and ids that any store can hold; an id that no landmark can have becomes -1."""
    return replace(
        edit,
        kind=_storable_text(edit.kind),
        landmark_id=_storable_id(edit.landmark_id),
        other_id=None if edit.other_id is None else _storable_id(edit.other_id),
        detail=_storable_text(edit.detail),
        agent=_storable_text(edit.agent),
        model=_storable_text(edit.model),
        prompt_hash=_storable_text(edit.prompt_hash),
    )


def _storable_event(event: MapEvent) -> MapEvent:
    """The event with texts that any store can hold: its source and words may be an agent's."""
    return replace(event, detail=_storable_text(event.detail), source=_storable_text(event.source))


def _storable_id(number: object) -> int:
    return int(number) if isinstance(number, int | np.integer) and abs(int(number)) <= _LARGEST_ID else -1


def _storable_text(text: object) -> str:
    return encodable(str(text)[:LONGEST_TEXT])
