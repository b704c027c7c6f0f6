"""A store in one SQLite file that survives ``kill -9`` and keeps all history."""

import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from seo_slam.backends import sqlite_edits as edit_rows
from seo_slam.backends import sqlite_rows as rows
from seo_slam.backends import sqlite_schema as schema
from seo_slam.backends.store_checks import require_amendment, require_next
from seo_slam.errors import ConfigError, MapError, MapFormatError
from seo_slam.geometry import FloatArray
from seo_slam.mapping.nearby import require_point, rows_within
from seo_slam.records import Amendment, EditRecord, KeyframeRecord, MapEvent
from seo_slam.types import IntArray, Landmark, Observations

_CACHED_VECTORS = 4096


class SqliteStore:
    """A ``MapStore`` in a file, usually ``map.db`` in the folder of a result.

    An existing file is continued: keyframes and history are only ever added. One transaction a keyframe. Any thread may call;
    calls wait for each other. A killed process loses nothing that ``commit`` returned from; with durability "normal" a power
    cut may lose the last few keyframes, with "full" none. A file of an older version can be read, and is brought to this one when it is
    continued.

    Args:
        path: the file; folders are made.
        durability: "normal" or "full" (waits for the disk at every commit).
        read_only: change nothing and take no commits; the file must be there. A run may be writing it meanwhile.

    Raises:
        MapFormatError: the file is no map of a known version, is cut off or damaged. It is left as it is.
        MapError: it cannot be read or written.
    """

    def __init__(self, path: str | Path, durability: schema.Durability = "normal", read_only: bool = False) -> None:
        if durability not in ("normal", "full"):
            raise ConfigError(f"durability: got {durability!r}, wanted 'normal' or 'full'")
        self._path = Path(path)
        self._read_only = read_only
        self._lock = threading.RLock()
        self._closed = False
        self._vector_ids: dict[bytes, int] = {}
        self._db = schema.open_for_reading(self._path) if read_only else schema.open_for_writing(self._path, durability)
        try:
            with self._reading() as db:
                last_id, last_session = db.execute("SELECT max(id), max(session) FROM keyframe").fetchone()
                self._last_id = None if last_id is None else int(last_id)
                self._session = 0 if last_session is None else int(last_session) + 1
        except MapError:
            self._db.close()
            raise

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    def commit(self, record: KeyframeRecord) -> None:
        """Keep a keyframe, wholly or not at all; clouds are dropped.

        Raises:
            MapError: its id does not rise, a value could not be kept, the disk is full, or the store is closed or read-only.
        """
        with self._writing() as db:
            require_next(record, self._last_id)
            db.execute(f"INSERT INTO keyframe VALUES ({_marks(9)})", rows.keyframe_values(record, self._session))
            observations = rows.observation_rows(record, self._embedding_id)
            db.executemany(f"INSERT INTO observation ({rows.OBSERVATION_COLUMNS}) VALUES ({_marks(12)})", observations)
            self._write_change(record, 0)
        self._last_id = record.keyframe_id

    def amend(self, amendment: Amendment) -> None:
        """Keep a change of the map that no keyframe made, wholly or not at all.

        Raises:
            MapError: its keyframe is not the newest, a value could not be kept, the disk is full, or the store is closed or read-only.
        """
        with self._writing() as db:
            newest = db.execute("SELECT max(id) FROM keyframe").fetchone()[0]  # asked again: another process may have gone on
            require_amendment(amendment, newest)
            tables = ("landmark_history", "event", "edit")
            last = [db.execute(f"SELECT max(amendment) FROM {name} WHERE keyframe_id = ?", (newest,)).fetchone()[0] for name in tables]
            self._write_change(amendment, 1 + max(number or 0 for number in last))

    def edits(self) -> tuple[EditRecord, ...]:
        """Everything that agents proposed and what became of it, in the order it was kept; the first is edit number 1."""
        with self._reading() as db:
            return self._edits("ORDER BY id", ()) if schema.version_of(db) > 2 else ()

    def _edits(self, which: str, parameters: rows.Row) -> tuple[EditRecord, ...]:
        found = self._db.execute(f"SELECT {edit_rows.EDIT_COLUMNS} FROM edit {which}", parameters).fetchall()
        vectors: dict[int, FloatArray] = {}
        for number in sorted(edit_rows.embedding_ids(found)):
            vectors |= rows.read_vectors(self._db, "WHERE id = ?", (number,))
        return tuple(edit_rows.edit_from(row, vectors) for row in found)

    def _write_change(self, change: KeyframeRecord | Amendment, amendment: int) -> None:
        self._write_landmarks(change, amendment)
        place = (change.keyframe_id, amendment)
        self._db.executemany(
            f"INSERT INTO event (keyframe_id, amendment, {rows.EVENT_COLUMNS}) VALUES ({_marks(7)})",
            [(*place, *rows.event_values(event)) for event in change.events],
        )
        self._db.executemany(
            f"INSERT INTO edit (keyframe_id, amendment, {edit_rows.EDIT_COLUMNS}) VALUES ({_marks(15)})",
            [(*place, *edit_rows.edit_values(edit, self._embedding_id)) for edit in change.edits],
        )

    def _write_landmarks(self, record: KeyframeRecord | Amendment, amendment: int) -> None:
        values = [(int(landmark.id), *rows.landmark_values(landmark, self._embedding_id)) for landmark in record.landmarks]
        removed = [(int(landmark_id),) for landmark_id in record.removed_ids]
        columns = rows.LANDMARK_COLUMNS
        db = self._db
        db.executemany(f"INSERT OR REPLACE INTO landmark (id, {columns}) VALUES ({_marks(16)})", values)
        db.executemany(
            f"INSERT INTO landmark_history (keyframe_id, amendment, change, landmark_id, {columns}) VALUES ({_marks(19)})",
            [(record.keyframe_id, amendment, "set", *row) for row in values],
        )
        db.executemany("INSERT OR REPLACE INTO landmark_box VALUES (?1, ?2, ?2, ?3, ?3, ?4, ?4)", [(row[0], *row[4:7]) for row in values])
        db.executemany("DELETE FROM landmark WHERE id = ?", removed)
        db.executemany("DELETE FROM landmark_box WHERE id = ?", removed)
        db.executemany(
            "INSERT INTO landmark_history (keyframe_id, amendment, change, landmark_id) VALUES (?, ?, 'removed', ?)",
            [(record.keyframe_id, amendment, *row) for row in removed],
        )

    def set_meta(self, key: str, value: str) -> None:
        """Keep a fact about the whole map.

        Raises:
            MapError: the store is closed or read-only, or the key is "schema".
        """
        if key == "schema":
            raise MapError("meta: the key 'schema' belongs to the file format")
        with self._writing() as db:
            db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))

    def meta(self) -> dict[str, str]:
        """Every fact kept by ``set_meta``."""
        with self._reading() as db:
            return dict(db.execute("SELECT key, value FROM meta WHERE key != 'schema' ORDER BY key"))

    def keyframe_ids(self) -> IntArray:
        """(T,) ids of the keyframes kept, rising."""
        with self._reading() as db:
            return np.array([row[0] for row in db.execute("SELECT id FROM keyframe ORDER BY id")], dtype=np.int64)

    def keyframe(self, keyframe_id: int) -> KeyframeRecord:
        """Return a keyframe as it was committed, without clouds, embeddings in single precision.

        Raises:
            MapError: no such keyframe.
        """
        number = int(keyframe_id)
        with self._reading() as db:
            row = db.execute("SELECT * FROM keyframe WHERE id = ?", (number,)).fetchone()
            if row is None:
                raise MapError(f"{self._path}: no keyframe {keyframe_id}; {len(self.keyframe_ids())} are kept")
            version = schema.version_of(db)
            own, columns = rows.with_keyframe(version), rows.readable_landmark_columns(version)
            changes = db.execute(
                f"SELECT landmark_id, {columns} FROM landmark_history WHERE {own} AND change = 'set' ORDER BY landmark_id", (number,)
            ).fetchall()
            removed = db.execute(
                f"SELECT landmark_id FROM landmark_history WHERE {own} AND change = 'removed' ORDER BY landmark_id", (number,)
            ).fetchall()
            events = db.execute(f"SELECT {rows.EVENT_COLUMNS} FROM event WHERE {own} ORDER BY id", (number,)).fetchall()
            history = "WHERE id IN (SELECT embedding_id FROM landmark_history WHERE keyframe_id = ?)"
            vectors = rows.read_vectors(db, history, (number,))
            _, landmark_ids, observations = self._observations("keyframe_id = ?", number, row[8])
            return KeyframeRecord(
                keyframe_id=number,
                timestamp_s=row[2],
                T_world_camera=rows.unblob(row[3], (4, 4)),
                covariance=rows.unblob(row[4], (6, 6)),
                T_previous_current=rows.unblob(row[5], (4, 4)),
                motion_covariance=rows.unblob(row[6], (6, 6)),
                observations=observations,
                landmark_ids=landmark_ids,
                landmarks=tuple(rows.landmark_from(change, vectors) for change in changes),
                removed_ids=tuple(landmark_id for (landmark_id,) in removed),
                events=tuple(MapEvent(*event) for event in events),
                edits=self._edits(f"WHERE {own} ORDER BY id", (number,)) if version > 2 else (),
            )

    def poses(self) -> tuple[FloatArray, FloatArray]:
        """Stamps (T,) in seconds and ``T_world_camera`` (T, 4, 4) of all keyframes, as they were when committed."""
        with self._reading() as db:
            found = db.execute("SELECT timestamp_s, T_world_camera FROM keyframe ORDER BY id").fetchall()
            poses = np.array([rows.unblob(row[1], (4, 4)) for row in found], dtype=np.float64).reshape(-1, 4, 4)
        return np.array([row[0] for row in found], dtype=np.float64), poses

    def sessions(self) -> IntArray:
        """(T,) the run each keyframe belongs to: 0, and one more each time that the file was continued.

        The odometry factor of a run's first keyframe does not start at the keyframe before it.
        """
        with self._reading() as db:
            return np.array([row[0] for row in db.execute("SELECT session FROM keyframe ORDER BY id")], dtype=np.int64)

    def observations(self, landmark_id: int) -> tuple[IntArray, Observations]:
        """Keyframe ids (M,) and the measurements given to a landmark when they were committed, oldest first."""
        with self._reading():
            keyframe_ids, _, observations = self._observations("landmark_id = ?", int(landmark_id), None)
        return keyframe_ids, observations

    def _observations(self, where: str, number: int, size: int | None) -> tuple[IntArray, IntArray, Observations]:
        found = self._db.execute(
            f"SELECT {rows.OBSERVATION_COLUMNS} FROM observation WHERE {where} ORDER BY keyframe_id, row", (number,)
        ).fetchall()
        used = f"WHERE id IN (SELECT embedding_id FROM observation WHERE {where})"
        vectors = rows.read_vectors(self._db, used, (number,))
        if size is None:
            size = len(next(iter(vectors.values()))) if vectors else 0
        keyframe_ids = np.array([row[0] for row in found], dtype=np.int64)
        landmark_ids = np.array([row[2] for row in found], dtype=np.int64)
        return keyframe_ids, landmark_ids, rows.observations_from(found, vectors, size)

    def landmarks(self) -> tuple[Landmark, ...]:
        """All landmarks in the map, by rising id, tentative ones included."""
        with self._reading() as db:
            vectors = rows.read_vectors(db, "WHERE id IN (SELECT embedding_id FROM landmark)")
            columns = rows.readable_landmark_columns(schema.version_of(db))
            found = db.execute(f"SELECT id, {columns} FROM landmark ORDER BY id")
            return tuple(rows.landmark_from(row, vectors) for row in found)

    def near(self, p_world: ArrayLike, radius_m: float) -> tuple[int, ...]:
        """Ids of landmarks within ``radius_m`` of a point (3,), world frame, nearest first.

        Raises:
            FrameError: not a finite point, or a negative radius.
        """
        point = require_point(p_world, radius_m)
        x, y, z = point.tolist()
        r = float(radius_m)
        with self._reading() as db:
            # The boxes are single precision, rounded outwards, so they find a few too many, never too few.
            found = db.execute(
                "SELECT l.id, l.x_m, l.y_m, l.z_m FROM landmark_box b JOIN landmark l ON l.id = b.id WHERE b.max_x >= ? AND "
                "b.min_x <= ? AND b.max_y >= ? AND b.min_y <= ? AND b.max_z >= ? AND b.min_z <= ?",
                (x - r, x + r, y - r, y + r, z - r, z + r),
            ).fetchall()
        ids = np.array([row[0] for row in found], dtype=np.int64)
        positions_m = np.array([row[1:] for row in found], dtype=np.float64)
        return tuple(ids[rows_within(positions_m, ids, point, r)].tolist())

    def history(self, landmark_id: int) -> tuple[tuple[int, str, str, str], ...]:
        """``(keyframe_id, kind, detail, source)`` of every event of a landmark, oldest first; also of ids that left the map."""
        with self._reading() as db:
            found = db.execute("SELECT keyframe_id, kind, detail, source FROM event WHERE landmark_id = ? ORDER BY id", (int(landmark_id),))
            return tuple(found.fetchall())

    def events_of(self, landmark_id: int) -> tuple[tuple[int, MapEvent], ...]:
        """Keyframe id and event, oldest first, of every event that names a landmark, also as the other one."""
        number = int(landmark_id)
        with self._reading() as db:
            found = db.execute(
                f"SELECT keyframe_id, {rows.EVENT_COLUMNS} FROM event WHERE landmark_id = ? OR other_id = ? ORDER BY id", (number, number)
            ).fetchall()
        return tuple((row[0], MapEvent(*row[1:])) for row in found)

    def next_id(self) -> int:
        """The lowest landmark id that was never used."""
        tables = ("landmark_history", "observation", "event")
        with self._reading() as db:
            used = [db.execute(f"SELECT max(landmark_id) FROM {table}").fetchone()[0] for table in tables]
        highest = max((i for i in used if i is not None), default=-1)
        return max(highest + 1, int(self.meta().get("next_id", 0)))

    def close(self) -> None:
        """Release the file. After that the store takes no more calls but ``close``."""
        with self._lock:
            if not self._closed:
                self._closed = True
                schema.close(self._db, leave_one_file=not self._read_only)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()

    def _embedding_id(self, embedding: FloatArray) -> int | None:
        if embedding.size == 0:
            return None
        data = rows.vector_blob(embedding)
        number = self._vector_ids.get(data)
        if number is None:
            number = self._db.execute("INSERT INTO embedding (vector) VALUES (?)", (data,)).lastrowid
            if len(self._vector_ids) >= _CACHED_VECTORS:
                self._vector_ids.clear()
            self._vector_ids[data] = int(number or 0)
        return number

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            self._require_open()
            if self._read_only:
                raise MapError(f"{self._path}: opened read-only")
            with schema.clear_errors(self._path):
                self._db.execute("BEGIN IMMEDIATE")
                try:
                    yield self._db
                    self._db.execute("COMMIT")
                except BaseException:  # also Ctrl-C: a keyframe is kept wholly or not at all
                    self._vector_ids.clear()
                    if self._db.in_transaction:
                        self._db.execute("ROLLBACK")
                    raise

    @contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        with self._lock:
            self._require_open()
            with schema.clear_errors(self._path):
                try:
                    yield self._db
                except (ValueError, TypeError, KeyError, AttributeError) as error:  # a blob or a text that no commit wrote
                    raise MapFormatError(f"{self._path}: damaged: {error}") from error

    def _require_open(self) -> None:
        if self._closed:
            raise MapError(f"{self._path}: the store is closed")


def _marks(n: int) -> str:
    return ", ".join("?" * n)
