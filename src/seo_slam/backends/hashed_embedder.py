"""Text vectors without a model: character n-grams, hashed."""

import unicodedata
import zlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray

_LENGTHS = (3, 4, 5)


class HashedEmbedder:
    """Words that share letters are near ("cup", "cups"); words that share meaning only ("cup", "mug") are not.

    Signed feature hashing (Weinberger et al. 2009) of the 3- to 5-grams of each word and of the word itself. CRC32, unlike Python's
    ``hash``, is the same in every process.
    """

    def __init__(self, size: int = 256) -> None:
        """Choose the length of the vectors.

        Raises:
            ConfigError: it is below 8.
        """
        if size < 8:
            raise ConfigError(f"hashed embedder: got size {size}, wanted at least 8")
        self._size = int(size)

    @property
    def name(self) -> str:
        """Always "hashed"."""
        return "hashed"

    @property
    def size(self) -> int:
        """D, the length of a vector."""
        return self._size

    def embed_text(self, texts: Sequence[str]) -> FloatArray:
        """Return (N, D) float64 unit rows."""
        return np.array([_row(text, self._size) for text in texts], dtype=np.float64).reshape(len(texts), self._size)


@lru_cache(maxsize=4096)
def _row(text: str, size: int) -> FloatArray:
    row = np.zeros(size)
    for gram in _grams(text):
        code = zlib.crc32(gram.encode("utf-8", "surrogatepass"))
        row[(code >> 1) % size] += 1.0 if code & 1 else -1.0
    norm = float(np.linalg.norm(row))
    if norm == 0.0:  # grams that cancelled out
        row[zlib.crc32(text.encode("utf-8", "surrogatepass")) % size] = norm = 1.0
    row /= norm
    row.flags.writeable = False
    return row


def _grams(text: str) -> list[str]:
    grams: list[str] = []
    for word in unicodedata.normalize("NFKC", text).casefold().split() or [""]:
        marked = f"<{word}>"  # so that beginnings and ends of words count
        grams.append(marked)
        grams += [marked[i : i + n] for n in _LENGTHS if n < len(marked) for i in range(len(marked) - n + 1)]
    return grams
