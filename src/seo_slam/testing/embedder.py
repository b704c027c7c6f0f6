"""Contract of an ``Embedder``."""

import numpy as np

from seo_slam.interfaces import Embedder
from seo_slam.testing.clauses import require, require_array

_TEXTS = ("cup", "keyboard", "a blue book", "tasse à café", "椅子", "x" * 500, "", "cup")


def check_embedder(embedder: Embedder) -> None:
    """Check that an embedder turns any text into a unit vector, always the same one.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(embedder, Embedder), embedder, "lacks name, size or embed_text(texts)")
    require(isinstance(embedder.name, str) and bool(embedder.name), embedder, f"name is {embedder.name!r}, wanted text")
    size = embedder.size
    require(isinstance(size, int) and size > 0, embedder, f"size is {size!r}, wanted a whole number above 0")
    require_array(embedder.embed_text([]), (0, size), "f", embedder, "the embedding of no texts")
    rows = embedder.embed_text(list(_TEXTS))
    require_array(rows, (len(_TEXTS), size), "f", embedder, f"the embedding of {len(_TEXTS)} texts")
    require(rows.dtype == np.float64, embedder, f"rows are {rows.dtype}, wanted float64")
    norms = np.linalg.norm(rows, axis=1)
    off = int(np.argmax(np.abs(norms - 1.0)))
    require(bool(abs(norms[off] - 1.0) < 1e-6), embedder, f"the row of {_TEXTS[off]!r:.20} has length {norms[off]:.6g}, wanted 1")
    require(np.array_equal(rows[0], rows[-1]), embedder, "the same text twice in one call gave two vectors")
    alone = embedder.embed_text([_TEXTS[1]])[0]
    require(bool(np.allclose(alone, rows[1], atol=1e-5)), embedder, "the vector of a text depends on the texts beside it")
    require(float(rows[0] @ rows[1]) < 0.999, embedder, "'cup' and 'keyboard' have the same vector")
