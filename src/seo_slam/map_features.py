"""The file features.npz: the vectors of landmarks that are known by what they look like, which words alone cannot give back."""

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seo_slam.errors import MapError, MapFormatError
from seo_slam.geometry import FloatArray
from seo_slam.map_document import write_atomically

FEATURES_FILE = "features.npz"
"""Its name in the folder of a map."""

_DAMAGE = (OSError, ValueError, KeyError, EOFError, SyntaxError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error)
"""What a damaged archive raises, by where the damage is."""


def write_features(path: Path, embedder: str, features: Mapping[int, FloatArray]) -> None:
    """Write vectors (D,) of landmarks; the same vectors give the same bytes.

    ``numpy.load`` reads the file without pickle: ``ids`` (N,) int64, rising, ``features`` (N, D) float32, and ``embedder``, a text.

    Raises:
        MapError: vectors are of different sizes or not finite, or the file cannot be written.
    """
    ids = sorted(features)
    sizes = {features[i].shape for i in ids}
    if len(sizes) > 1 or any(len(size) != 1 for size in sizes):
        raise MapError(f"{path}: features are {sorted(sizes)}, wanted (D,) with one D for all")
    rows = np.array([features[i] for i in ids], dtype="<f4").reshape(len(ids), -1 if ids else 0)
    if not np.isfinite(rows).all():
        raise MapError(f"{path}: the feature of landmark {ids[int(np.argmin(np.isfinite(rows).all(axis=1)))]} is not finite")
    archive = io.BytesIO()  # numpy dates what is in it 1980, whenever it is written
    np.savez(archive, ids=np.array(ids, dtype="<i8"), features=rows, embedder=np.array(embedder, dtype=np.str_))
    write_atomically(path, archive.getvalue())


def read_features(path: Path) -> tuple[str, dict[int, FloatArray]]:
    """Read what ``write_features`` wrote: the name of the embedder, and landmark id -> (D,) float64.

    Raises:
        MapFormatError: missing, cut off, changed since it was written, or not such a file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            damaged = archive.testzip()
        if damaged is not None:
            raise MapFormatError(f"{path}: damaged: {damaged} does not have its checksum")
        with np.load(path, allow_pickle=False) as arrays:
            ids, features, embedder = arrays["ids"], arrays["features"], arrays["embedder"]
    except _DAMAGE as error:
        raise MapFormatError(f"{path}: no file of features, or a damaged one: {error}") from error
    if ids.dtype.kind not in "iu" or ids.ndim != 1 or features.dtype.kind != "f" or embedder.dtype.kind != "U" or embedder.ndim:
        raise MapFormatError(
            f"{path}: got ids {ids.dtype}, features {features.dtype}, embedder {embedder.dtype}, wanted numbers and a text"
        )
    if features.ndim != 2 or len(features) != len(ids) or not np.isfinite(features).all():
        raise MapFormatError(f"{path}: features are {features.shape} for {len(ids)} landmarks, wanted a finite row for each")
    return str(embedder), dict(zip(ids.tolist(), features.astype(np.float64), strict=True))
