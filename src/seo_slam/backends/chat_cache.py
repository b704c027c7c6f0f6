"""Answers kept by the content of the question, in memory or in a SQLite file that survives the process."""

import contextlib
import hashlib
import json
import logging
import sqlite3
import threading
import weakref
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from seo_slam.errors import ConfigError
from seo_slam.interfaces import ChatRequest

logger = logging.getLogger(__name__)

MOST_IN_MEMORY = 1024
MOST_IN_FILE = 100_000
_WAIT_S = 0.2  # for another process that writes the same file


class ReplyCache(Protocol):
    """Keeps answers."""

    def get(self, key: str) -> tuple[str, str] | None:
        """Text of the answer and the model that gave it; None if there is none."""
        ...

    def put(self, key: str, text: str, model: str) -> None:
        """Keep an answer."""
        ...

    def close(self) -> None:
        """Release files; a later use opens them again."""
        ...


def content_key(model: str, request: ChatRequest) -> str:
    """Return the SHA-256, in hex, of all that the answer depends on. Server, key and limits are not in it."""
    content = {
        "model": model,
        "system": request.system,
        "text": request.text,
        "images": [hashlib.sha256(image).hexdigest() for image in request.images],
        "schema": request.schema,
        "turns": request.turns,
        "temperature": request.temperature,
        "max_tokens": request.max_tokens,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=dict).encode()).hexdigest()


class NoCache:
    """Keeps nothing."""

    def get(self, key: str) -> tuple[str, str] | None:  # noqa: ARG002
        """None."""
        return None

    def put(self, key: str, text: str, model: str) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class MemoryCache:
    """Keeps the answers asked for last; those of this process only."""

    def __init__(self, most: int = MOST_IN_MEMORY) -> None:
        """Start empty."""
        self._most = most
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, tuple[str, str]] = OrderedDict()

    def get(self, key: str) -> tuple[str, str] | None:
        """See ``ReplyCache``."""
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
            return found

    def put(self, key: str, text: str, model: str) -> None:
        """See ``ReplyCache``."""
        with self._lock:
            self._kept[key] = (text, model)
            self._kept.move_to_end(key)
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)

    def close(self) -> None:
        """Do nothing."""


class FileCache:
    """Keeps answers in a SQLite file: one table, key -> text, model. A file that cannot be used later on is a warning, not an error.

    Args:
        path: the file; folders are made.
        most: answers kept; the oldest go when it is opened.

    Raises:
        ConfigError: it cannot be made, or is no cache.
    """

    def __init__(self, path: str | Path, most: int = MOST_IN_FILE) -> None:
        self._path = Path(path)
        self._most = most
        self._lock = threading.Lock()
        self._db: sqlite3.Connection | None = None
        self._warned = False
        try:
            self._opened()
        except (OSError, sqlite3.Error) as error:
            raise ConfigError(f"cache {self._path}: cannot be used: {error}") from error

    def get(self, key: str) -> tuple[str, str] | None:
        """See ``ReplyCache``."""
        with self._lock, self._forgiven():
            row = self._opened().execute("SELECT text, model FROM reply WHERE key = ?", (key,)).fetchone()
            return None if row is None else (str(row[0]), str(row[1]))
        return None

    def put(self, key: str, text: str, model: str) -> None:
        """See ``ReplyCache``."""
        with self._lock, self._forgiven(), self._opened() as db:
            db.execute("INSERT OR REPLACE INTO reply (key, text, model) VALUES (?, ?, ?)", (key, text, model))

    def close(self) -> None:
        """See ``ReplyCache``."""
        with self._lock:
            if self._db is not None:
                self._db.close()
            self._db = None

    def _opened(self) -> sqlite3.Connection:
        if self._db is not None:
            return self._db
        self._path.parent.mkdir(parents=True, exist_ok=True)
        db = sqlite3.connect(self._path, timeout=_WAIT_S, check_same_thread=False)
        try:
            db.execute("PRAGMA journal_mode = WAL")
            db.execute("PRAGMA synchronous = NORMAL")
            with db:
                db.execute("CREATE TABLE IF NOT EXISTS reply (number INTEGER PRIMARY KEY, key TEXT UNIQUE, text TEXT, model TEXT)")
                db.execute(
                    "DELETE FROM reply WHERE number <= (SELECT number FROM reply ORDER BY number DESC LIMIT 1 OFFSET ?)", (self._most,)
                )
        except sqlite3.Error:
            db.close()
            raise
        weakref.finalize(self, db.close)
        self._db = db
        return db

    @contextlib.contextmanager
    def _forgiven(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error, UnicodeError) as error:
            if not self._warned:
                logger.warning("cache %s: cannot be used any more (%s); asking goes on without it", self._path, error)
            self._warned = True


def make_cache(cache: str | Path | bool) -> ReplyCache:
    """Return the cache of an option: a path, True (in memory) or False (none).

    Raises:
        ConfigError: it is neither, or the file cannot be used.
    """
    if isinstance(cache, bool):
        return MemoryCache() if cache else NoCache()
    if not isinstance(cache, str | Path) or not str(cache):
        raise ConfigError(f"cache: got {cache!r:.60}, wanted a path, true or false")
    return FileCache(cache)
