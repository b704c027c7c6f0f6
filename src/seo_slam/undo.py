"""What agents changed in a saved map: list it, and take one edit back.

``map.db`` is changed first, in one transaction, then ``map.json`` is replaced by one of the same state. A process killed between the two
leaves a ``map.json`` that still has the edit; asking for the same undo again says that it is done and brings ``map.json`` up to date.
``clouds.ply`` and ``features.npz`` are written with ``map.json``; of two that were merged, each gets the points in its own box.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seo_slam import registry
from seo_slam.errors import MapError
from seo_slam.geometry import FloatArray
from seo_slam.map import MAP_FILE, STORE_FILE, Map
from seo_slam.map_clouds import CLOUDS_FILE, read_clouds
from seo_slam.records import Amendment, EditRecord, MapEvent
from seo_slam.types import BoolArray, Landmark

UNDOABLE = ("relabel", "remove", "merge")
USER = "user"
"""Who undoes, in the history."""

_BOX_GROWN_M = 0.05  # a point so near to the box of a landmark is of the landmark: boxes are rounded, and noise blurs edges


@dataclass(frozen=True, slots=True)
class _Files:
    """Where a saved map is: its map.db, and the map.json that tells the same, if there is one."""

    store: Path
    document: Path | None


def read_edits(path: str | Path) -> tuple[EditRecord, ...]:
    """Return what agents proposed and what became of it, oldest first; the first is edit number 1.

    Args:
        path: the folder of a result, or its map.json or map.db.

    Raises:
        MapError: there is no map.db, or it cannot be read.
    """
    with registry.find("store", "sqlite")(_files(path).store, read_only=True) as store:
        edits: tuple[EditRecord, ...] = store.edits()
        return edits


def undone_by(edits: Sequence[EditRecord]) -> dict[int, int]:
    """Return the number of each edit that was undone -> the number of the edit that undid it."""
    return {edit.other_id: n for n, edit in enumerate(edits, start=1) if edit.kind == "undo" and edit.other_id is not None}


def touched_by(edit: EditRecord) -> set[int]:
    """Return the ids of the landmarks that an edit is about."""
    others = {edit.other_id} if edit.kind == "merge" and edit.other_id is not None else set()
    return {edit.landmark_id, *others, *(row.id for row in edit.before)}


def undo_edit(folder: str | Path, number: int) -> EditRecord:
    """Take one edit back, in map.db and map.json; landmark ids stay as they were.

    A landmark that was renamed gets its label, category and label weights back; one that was removed comes back as it was; of two that were
    merged, the one that went comes back as it was, and the other is again what it was, but for how often and when it was seen since. Points
    of its surface (``clouds.ply``) a removed landmark has none any more; of two that were merged, each has those in its box.

    Args:
        folder: of a result that no run is writing; or its map.json or map.db.
        number: of an edit with outcome "applied" that renamed, removed or merged; the first edit is number 1.

    Returns:
        What was kept of it: an edit of kind "undo", whose ``other_id`` is ``number``. Where a removed thing seems to have been mapped again
        under another id since, ``detail`` ends with a warning that names it: the map then has the thing twice.

    Raises:
        MapError: no map.db, a run still writes it, no such edit, nothing that can be undone, undone already, or what came later stands in
            the way; says what. Nothing has changed then.
    """
    files = _files(folder)
    now = _map_now(files)
    by_id = {row.id: row for row in (*now.landmarks, *now.tentative)}
    with registry.find("store", "sqlite")(files.store, read_only=True) as store:
        edits = store.edits()
        _require_undoable(edits, number, files, now)
        _require_nothing_later(edits, number)
        edit = edits[number - 1]
        _require_map_as_left(edit, number, by_id, store)
        restored = _parted(edit, _restored(edit, by_id))
        record = _record(edit, number, store, [by_id[row.id] for row in restored if row.id in by_id])
        if edit.kind == "remove" and (twins := _mapped_again(restored[0], now.landmarks)):
            record = replace(record, detail=f"{record.detail}; {_warning(twins)}")
    _amend(files, Amendment(record.keyframe_id, tuple(restored), (), _events(edit, record), (record,)), len(edits))
    by_id.update({row.id: row for row in restored})
    _write(files, Map(by_id.values(), now.gravity, now.embedder, now.next_id, now.abstract, now.features))
    return record


def _amend(files: _Files, amendment: Amendment, edits_known: int) -> None:
    make_store = registry.find("store", "sqlite")
    make_store(files.store).close()  # folds in the log that a killed run left; that of a run which goes on stays
    if files.store.with_name(files.store.name + "-wal").exists():
        raise MapError(f"{files.store}: is in use; a run that is still writing it would not know of the undo")
    with make_store(files.store, durability="full") as store:
        if len(store.edits()) != edits_known:
            raise MapError(f"{files.store}: was changed meanwhile; look at its edits again")
        store.amend(amendment)


def _files(path: str | Path) -> _Files:
    target = Path(path)
    store = {".db": target, ".json": target.with_name(STORE_FILE)}.get(target.suffix, target / STORE_FILE)
    store = target / STORE_FILE if target.is_dir() else store
    if not store.is_file():
        raise MapError(f"{path}: holds no {STORE_FILE}, where edits are kept")
    document = store.with_name(MAP_FILE)
    return _Files(store, document if store.name == STORE_FILE and document.is_file() else None)


def _map_now(files: _Files) -> Map:
    """The map that map.db holds, with the finer figures that map.json has of landmarks which are the same there."""
    kept = Map.load(files.store)
    if files.document is None:
        return kept
    written, clouds_path = Map.load(files.document), files.document.with_name(CLOUDS_FILE)
    clouds = read_clouds(clouds_path) if clouds_path.is_file() else {}
    finer = {row.id: row for row in (*written.landmarks, *written.tentative)}
    rows = []
    for row in (*kept.landmarks, *kept.tentative):
        other = finer.get(row.id)
        row = replace(row, cloud_world=clouds.get(row.id, row.cloud_world))
        rows.append(replace(other, embedding=row.embedding) if other is not None and _state_of(other) == _state_of(row) else row)
    return Map(rows, written.gravity, written.embedder, max(written.next_id, kept.next_id), written.abstract, written.features)


def _state_of(row: Landmark) -> tuple[Any, ...]:
    return row.version, row.state, row.label, row.category, row.observations


def _write(files: _Files, state: Map) -> None:
    if files.document is not None:
        state.save(files.document.parent)


def _require_undoable(edits: Sequence[EditRecord], number: int, files: _Files, now: Map) -> None:
    if not 1 <= number <= len(edits):
        there = f"edits 1 to {len(edits)} are" if edits else "no edit is"
        raise MapError(f"{files.store}: no edit {number}; {there} kept")
    edit, undo = edits[number - 1], undone_by(edits).get(number)
    if undo is not None:
        _write(files, _caught_up(edit, now))  # a process may have been killed before it came to that
        raise MapError(f"edit {number} was undone already, by edit {undo}")
    if edit.kind == "undo":
        raise MapError(f"edit {number} is itself an undo, of edit {edit.other_id}; that cannot be undone")
    if edit.outcome != "applied" or edit.kind not in UNDOABLE:
        raise MapError(f"edit {number} ({_called(edit)}, {edit.outcome}) changed nothing in the map that could be undone")
    wanted = {edit.landmark_id, edit.other_id} if edit.kind == "merge" else {edit.landmark_id}
    if wanted != {row.id for row in edit.before}:
        raise MapError(f"edit {number} ({_called(edit)}) cannot be undone: what was before it was not kept")


def _require_nothing_later(edits: Sequence[EditRecord], number: int) -> None:
    touched, undone = touched_by(edits[number - 1]), undone_by(edits)
    for later, other in enumerate(edits[number:], start=number + 1):
        both = touched & touched_by(other)
        if both and other.outcome == "applied" and other.kind in UNDOABLE and later not in undone:
            raise MapError(f"edit {number} cannot be undone while edit {later} stands, the {_called(other)} after it; undo {later} first")


def _require_map_as_left(edit: EditRecord, number: int, by_id: Mapping[int, Landmark], store: Any) -> None:
    """Refuse where the map itself went on since: not another edit, but what was seen, stands in the way."""
    what = f"edit {number} ({_called(edit)}) cannot be undone"
    stays, went = (edit.other_id, edit.landmark_id) if edit.kind == "merge" else (edit.landmark_id, None)
    if edit.kind == "remove":
        stays, went = None, edit.landmark_id
    if went is not None and went in by_id:
        raise MapError(f"{what}: landmark {went} is in the map again")
    if stays is not None and stays not in by_id:
        raise MapError(f"{what}: landmark {stays} left the map since: {_farewell(stays, store)}")
    if edit.kind == "merge" and stays is not None:
        for keyframe_id, event in _since_merge(store.events_of(stays), edit):
            if event.kind == "merged" and event.other_id == stays and event.landmark_id not in by_id:
                raise MapError(f"{what}: landmark {event.landmark_id} was merged into {stays}, too, at keyframe {keyframe_id}")
            if event.kind == "moved" and event.landmark_id == stays:
                raise MapError(f"{what}: landmark {stays} moved since, at keyframe {keyframe_id}")


def _since_merge(events: Sequence[tuple[int, MapEvent]], edit: EditRecord) -> Sequence[tuple[int, MapEvent]]:
    """What happened after the merge itself, which is one of the events."""
    pair = ("merged", edit.landmark_id, edit.other_id)
    own = [n for n, (_, event) in enumerate(events) if (event.kind, event.landmark_id, event.other_id) == pair]
    return events[own[-1] + 1 :] if own else [item for item in events if item[0] > edit.keyframe_id]


def _farewell(landmark_id: int, store: Any) -> str:
    gone = [(k, event) for k, event in store.events_of(landmark_id) if event.landmark_id == landmark_id]
    for keyframe_id, event in reversed(gone):
        if event.kind in ("merged", "removed"):
            into = f" into {event.other_id}" if event.other_id is not None else ""
            return f"{event.kind}{into} at keyframe {keyframe_id}, by {event.source}"
    return "nothing says how"


def _restored(edit: EditRecord, by_id: Mapping[int, Landmark]) -> list[Landmark]:
    """The landmarks as they are to be, each a version further."""
    before = {row.id: row for row in edit.before}
    if edit.kind == "relabel":
        was, now = before[edit.landmark_id], by_id[edit.landmark_id]
        words = replace(now, label=was.label, category=was.category, labels=dict(was.labels), embedding=was.embedding)
        return [replace(words, version=now.version + 1)]
    back = before[edit.landmark_id]
    restored = [replace(back, version=back.version + 1)]
    if edit.kind == "merge" and edit.other_id is not None:
        restored.append(_split(before[edit.other_id], back, by_id[edit.other_id]))
    return restored


def _parted(edit: EditRecord, rows: Sequence[Landmark]) -> list[Landmark]:
    """The landmarks of an edit; of two that were merged, each with those points of the merged one that lie in its own box."""
    merged = [row for row in rows if row.id == edit.other_id]
    if edit.kind != "merge" or not merged:
        return list(rows)
    p_world = merged[0].cloud_world
    return [replace(row, cloud_world=p_world[_in_box(row, p_world)]) for row in rows]


def _in_box(row: Landmark, p_world: FloatArray) -> BoolArray:
    return np.asarray((np.abs(p_world - row.position_m) <= 0.5 * row.size_m + _BOX_GROWN_M).all(axis=1))


def _caught_up(edit: EditRecord, now: Map) -> Map:
    """The map after an undo that may not have come to the files beside map.db."""
    by_id = {row.id: row for row in (*now.landmarks, *now.tentative)}
    back, stays = by_id.get(edit.landmark_id), by_id.get(-1 if edit.other_id is None else edit.other_id)
    if back is not None and stays is not None and not len(back.cloud_world):
        by_id.update({row.id: row for row in _parted(edit, (back, stays))})
    return Map(by_id.values(), now.gravity, now.embedder, now.next_id, now.abstract, now.features)


def _mapped_again(back: Landmark, stable: Iterable[Landmark]) -> list[int]:
    """Ids of stable landmarks within the extent of one that comes back, of the same label or category: most likely the same thing."""
    words = {back.label, back.category} - {""}
    return [
        row.id
        for row in stable
        if words & {row.label, row.category} and bool(np.all(np.abs(row.position_m - back.position_m) <= 0.5 * back.size_m))
    ]


def _warning(twins: Sequence[int]) -> str:
    which = f"landmark {twins[0]} is" if len(twins) == 1 else f"landmarks {', '.join(map(str, twins))} are"
    return f"warning: {which} at that place under the same name; it may be the same thing, mapped again since"


def _split(was: Landmark, back: Landmark, now: Landmark) -> Landmark:
    """The landmark that stayed, without the one that comes back; what was seen since the merge counts for it."""
    since = max(now.observations - was.observations - back.observations, 0)
    seen = replace(was, last_seen_s=now.last_seen_s, state=now.state, existence=now.existence) if since else was
    version = max(now.version, was.version) + 1
    return replace(seen, observations=was.observations + since, version=version, cloud_world=now.cloud_world)


def _record(edit: EditRecord, number: int, store: Any, before: Iterable[Landmark]) -> EditRecord:
    newest = int(store.keyframe_ids()[-1])
    stamp_s = float(store.keyframe(newest).timestamp_s)
    return EditRecord(
        kind="undo",
        landmark_id=edit.landmark_id,
        other_id=number,
        outcome="applied",
        detail=f"edit {number}, {_called(edit)}: {edit.detail}",
        agent=USER,
        model="",
        prompt_hash="",
        view_keyframe_id=newest,
        view_s=stamp_s,
        keyframe_id=newest,
        timestamp_s=stamp_s,
        before=tuple(before),
    )


def _events(edit: EditRecord, record: EditRecord) -> tuple[MapEvent, ...]:
    own = MapEvent("undone", edit.landmark_id, record.detail, USER, edit.other_id)
    if edit.kind != "merge" or edit.other_id is None:
        return (own,)
    return own, MapEvent("undone", edit.other_id, record.detail, USER, edit.landmark_id)


def _called(edit: EditRecord) -> str:
    """An edit in a few words: "merge of landmark 5 into 3"."""
    into = f" into {edit.other_id}" if edit.kind == "merge" and edit.other_id is not None else ""
    return f"{edit.kind} of landmark {edit.landmark_id}{into}"
