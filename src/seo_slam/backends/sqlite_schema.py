"""The tables of map.db, and how the file is made, opened and checked.

The file is SQLite with a write-ahead log. ``application_id`` spells "SEOM"; ``user_version`` is the version of the tables below.
Blobs are little-endian: float64 for poses and covariances, float32 for embeddings, row after row.
"""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from seo_slam.errors import MapError, MapFormatError

Durability = Literal["normal", "full"]

APPLICATION_ID = 0x53454F4D
USER_VERSION = 3
"""1: the first. 2: landmarks have an existence. 3: landmarks have a category; edits of agents; changes after a keyframe."""

SCHEMA_NAME = f"seo_slam.db/{USER_VERSION}"

_LANDMARK_COLUMNS = """
    state TEXT{0}, label TEXT{0}, labels TEXT{0},
    x_m REAL{0}, y_m REAL{0}, z_m REAL{0}, covariance_m2 BLOB{0}, size_m BLOB{0}, embedding_id INTEGER,
    observations INTEGER{0}, first_seen_s REAL{0}, last_seen_s REAL{0}, version INTEGER{0}"""

_EXISTENCE_OF_LANDMARK = "existence REAL NOT NULL DEFAULT 1.0"
_EXISTENCE_IN_HISTORY = "existence REAL"
_CATEGORY_OF_LANDMARK = "category TEXT NOT NULL DEFAULT ''"
_AMENDMENT = "amendment INTEGER NOT NULL DEFAULT 0"

_HISTORY = f"""
CREATE TABLE landmark_history (
    keyframe_id INTEGER NOT NULL, landmark_id INTEGER NOT NULL, {_AMENDMENT}, change TEXT NOT NULL, {_LANDMARK_COLUMNS.format("")},
    {_EXISTENCE_IN_HISTORY}, category TEXT,
    PRIMARY KEY (keyframe_id, landmark_id, amendment)) WITHOUT ROWID"""
_INDEX_OF_HISTORY = "CREATE INDEX history_of_landmark ON landmark_history (landmark_id)"

_EDITS = (
    f"""
CREATE TABLE edit (
    id INTEGER PRIMARY KEY, keyframe_id INTEGER NOT NULL, judged_keyframe_id INTEGER NOT NULL, timestamp_s REAL NOT NULL,
    kind TEXT NOT NULL, landmark_id INTEGER NOT NULL, other_id INTEGER, outcome TEXT NOT NULL, detail TEXT NOT NULL,
    agent TEXT NOT NULL, model TEXT NOT NULL, prompt_hash TEXT NOT NULL, view_keyframe_id INTEGER NOT NULL, view_s REAL NOT NULL,
    landmarks_before TEXT NOT NULL, {_AMENDMENT})""",
    "CREATE INDEX edit_of_landmark ON edit (landmark_id)",
    "CREATE INDEX edit_of_keyframe ON edit (keyframe_id)",
)

_TABLES = f"""
BEGIN;
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE embedding (id INTEGER PRIMARY KEY, vector BLOB NOT NULL);
CREATE TABLE keyframe (
    id INTEGER PRIMARY KEY, session INTEGER NOT NULL, timestamp_s REAL NOT NULL,
    T_world_camera BLOB NOT NULL, covariance BLOB NOT NULL, T_previous_current BLOB NOT NULL, motion_covariance BLOB NOT NULL,
    observations INTEGER NOT NULL, embedding_size INTEGER NOT NULL);
CREATE TABLE observation (
    keyframe_id INTEGER NOT NULL, row INTEGER NOT NULL, landmark_id INTEGER NOT NULL,
    p_camera BLOB NOT NULL, cov_camera BLOB NOT NULL, size_m BLOB NOT NULL, label TEXT, score REAL NOT NULL,
    box_px BLOB NOT NULL, truncated INTEGER NOT NULL, detection_row INTEGER NOT NULL, embedding_id INTEGER,
    PRIMARY KEY (keyframe_id, row)) WITHOUT ROWID;
CREATE INDEX observation_of_landmark ON observation (landmark_id);
CREATE TABLE landmark (id INTEGER PRIMARY KEY, {_LANDMARK_COLUMNS.format(" NOT NULL")}, {_EXISTENCE_OF_LANDMARK},
    {_CATEGORY_OF_LANDMARK});
{_HISTORY};
{_INDEX_OF_HISTORY};
CREATE TABLE event (
    id INTEGER PRIMARY KEY, keyframe_id INTEGER NOT NULL, landmark_id INTEGER NOT NULL,
    kind TEXT NOT NULL, detail TEXT NOT NULL, source TEXT NOT NULL, other_id INTEGER,
    {_AMENDMENT});
CREATE INDEX event_of_landmark ON event (landmark_id);
CREATE INDEX event_of_keyframe ON event (keyframe_id);
{";".join(_EDITS)};
CREATE VIRTUAL TABLE landmark_box USING rtree (id, min_x, max_x, min_y, max_y, min_z, max_z);
INSERT INTO meta VALUES ('schema', '{SCHEMA_NAME}');
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {USER_VERSION};
COMMIT;
"""

_FROM_1_TO_2 = (
    f"ALTER TABLE landmark ADD COLUMN {_EXISTENCE_OF_LANDMARK}",
    f"ALTER TABLE landmark_history ADD COLUMN {_EXISTENCE_IN_HISTORY}",
    "UPDATE landmark_history SET existence = 1.0 WHERE change = 'set'",
)

_OLD_COLUMNS = (
    "change, state, label, labels, x_m, y_m, z_m, covariance_m2, size_m, embedding_id, observations, first_seen_s, last_seen_s, version, "
    "existence"
)

_FROM_2_TO_3 = (
    f"ALTER TABLE landmark ADD COLUMN {_CATEGORY_OF_LANDMARK}",
    # Made anew, since SQLite changes no primary key: more than one change of a landmark may follow one keyframe now.
    "ALTER TABLE landmark_history RENAME TO old_history",
    _HISTORY,
    f"INSERT INTO landmark_history SELECT keyframe_id, landmark_id, 0, {_OLD_COLUMNS}, CASE change WHEN 'set' THEN '' END FROM old_history",
    "DROP TABLE old_history",
    _INDEX_OF_HISTORY,
    f"ALTER TABLE event ADD COLUMN {_AMENDMENT}",
    *_EDITS,
)

_MIGRATIONS = {1: _FROM_1_TO_2, 2: _FROM_2_TO_3}
"""From each version to the next; ``_migrate`` then writes the version."""

# Failures of the machine, not of the file: another process writes, the disk is full, no permission.
_MACHINE_ERRORS = ("BUSY", "LOCKED", "FULL", "IOERR", "READONLY", "CANTOPEN", "PERM", "NOMEM", "INTERRUPT")


@contextmanager
def clear_errors(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into ours, naming the file.

    Raises:
        MapFormatError: the file is damaged, or no map.
        MapError: it cannot be read or written just now (locked, disk full, no permission).
    """
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorname", "") or ""
        if any(code.startswith(f"SQLITE_{name}") for name in _MACHINE_ERRORS):
            raise MapError(f"{path}: {error} ({code})") from error
        raise MapFormatError(f"{path}: not a readable map: {error}") from error
    except UnicodeEncodeError as error:  # half of a surrogate pair in a label: no text that any file could hold
        raise MapError(f"{path}: a text is no valid Unicode: {error}") from error


def open_for_writing(path: Path, durability: Durability) -> sqlite3.Connection:
    """Open map.db, made first if it is not there, brought to this version if it is of an older one.

    Raises:
        MapFormatError: the file is there and is no map of a known version, or is damaged; it is not touched.
        MapError: the folder cannot be written.
    """
    try:
        fresh = not path.exists() or path.stat().st_size == 0
        path.parent.mkdir(parents=True, exist_ok=True)
        if fresh:
            _make(path)
    except OSError as error:
        raise MapError(f"{path}: cannot be written: {error}") from error
    _require_map(path)
    with clear_errors(path):
        connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute(f"PRAGMA synchronous = {'FULL' if durability == 'full' else 'NORMAL'}")
            _migrate(connection)
        except sqlite3.Error:
            connection.close()
            raise
    return connection


def open_for_reading(path: Path) -> sqlite3.Connection:
    """Open map.db without changing it; a run may be writing it meanwhile.

    Raises:
        MapFormatError: no such file, no map of a known version, or damaged.
        MapError: it cannot be read.
    """
    if not path.is_file():
        raise MapFormatError(f"{path}: no such map file")
    _require_map(path)
    with clear_errors(path):
        return _connect_read_only(path)


def version_of(connection: sqlite3.Connection) -> int:
    """The version of the tables as they are now; the file's header may lag behind while there is a log."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _migrate(connection: sqlite3.Connection) -> None:
    """Bring the tables to this version, in one transaction: a process killed meanwhile leaves the old ones."""
    if version_of(connection) == USER_VERSION:
        return
    connection.execute("BEGIN IMMEDIATE")
    try:
        for version in range(version_of(connection), USER_VERSION):  # asked again: another process may have just done it
            for statement in _MIGRATIONS[version]:
                connection.execute(statement)
        connection.execute("UPDATE meta SET value = ? WHERE key = 'schema'", (SCHEMA_NAME,))
        connection.execute(f"PRAGMA user_version = {USER_VERSION}")
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def close(connection: sqlite3.Connection, leave_one_file: bool) -> None:
    """Close a connection; after writing, fold the log into the file, so that it can be copied alone or read without write access."""
    if leave_one_file:
        with suppress(sqlite3.Error):  # a reader is still there: the log stays beside the file, which is as good
            connection.execute("PRAGMA busy_timeout = 0")
            connection.execute("PRAGMA journal_mode = DELETE")
    connection.close()


def _make(path: Path) -> None:
    # Made beside and renamed, so that a process killed right here leaves no half-made map.db.
    draft = path.with_name(f"{path.name}.new-{os.getpid()}")
    try:
        draft.unlink(missing_ok=True)
        with clear_errors(path):
            connection = sqlite3.connect(draft)
            try:
                connection.executescript(_TABLES)
            finally:
                connection.close()
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _connect_read_only(path: Path) -> sqlite3.Connection:
    try:
        return _connect_by_uri(path, "mode=ro")
    except sqlite3.Error as error:
        if not getattr(error, "sqlite_errorname", "").startswith(("SQLITE_CANTOPEN", "SQLITE_READONLY")):
            raise
        log = path.with_name(path.name + "-wal")
        if log.exists() and log.stat().st_size:
            raise MapError(
                f"{path}: {log.name} holds keyframes that a killed run left, and reading them takes a folder that can be written: "
                "copy both files to one"
            ) from error
    # In log mode SQLite wants to write beside the file even to read it; without a log there is nothing that it could miss.
    return _connect_by_uri(path, "immutable=1")


def _connect_by_uri(path: Path, mode: str) -> sqlite3.Connection:
    uri = f"file:{quote(str(path.absolute()))}?{mode}"
    connection = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False)
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _require_map(path: Path) -> None:
    try:
        with path.open("rb") as file:
            header = file.read(100)
        size = path.stat().st_size
        log = path.with_name(path.name + "-wal")
        has_log = log.exists() and log.stat().st_size > 0
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error}") from error
    if len(header) < 100 or not header.startswith(b"SQLite format 3\x00"):
        raise MapFormatError(f"{path}: not a map.db, or cut off (no SQLite header in its {size} bytes)")
    page_size = int.from_bytes(header[16:18], "big")
    page_size = 65536 if page_size == 1 else page_size
    wanted = page_size * int.from_bytes(header[28:32], "big")
    if size < wanted and not has_log:
        raise MapFormatError(f"{path}: cut off: got {size} bytes, wanted {wanted}")
    version, application = int.from_bytes(header[60:64], "big"), int.from_bytes(header[68:72], "big")
    if application != APPLICATION_ID:
        raise MapFormatError(f"{path}: a SQLite file, but no map of seo_slam (application_id {application:#x})")
    if not 1 <= version <= USER_VERSION:
        raise MapFormatError(f"{path}: schema: got seo_slam.db/{version}, wanted {SCHEMA_NAME}")
