"""Which things in a map may serve a request, and which of them stand out from the rest."""

from dataclasses import dataclass

import numpy as np

from seo_slam.errors import MapError
from seo_slam.interfaces import Embedder
from seo_slam.map import Map
from seo_slam.types import Landmark

LONGEST_QUESTION = 2000  # characters

# Cosines of unrelated words differ from model to model (0.1 to 0.4 with MiniLM), so that no fixed score says "this fits".
_STANDS_OUT = 3.5  # spreads above the median; measured in docs/ask.md
_FEWEST_SCORES = 8  # different ones, below which a spread means nothing
_LEAST_SPREAD = 0.03  # so that a map of much the same things does not make a rounding error stand out


@dataclass(frozen=True, slots=True, eq=False)
class Retrieved:
    """A thing found by the embedding of its labels.

    Attributes:
        landmark: the thing.
        score: cosine of the question's embedding with the landmark's, -1..1.
        spreads: how far the score lies above the median of the map's scores, in robust standard deviations (1.4826 times the median
            absolute deviation); None in a map with too few different things to tell.
    """

    landmark: Landmark
    score: float
    spreads: float | None

    @property
    def stands_out(self) -> bool:
        """Whether the score is out of the ordinary for this map: the thing likely has to do with the question."""
        return self.spreads is not None and self.spreads >= _STANDS_OUT


def retrieve(map_: Map, question: str, k: int, embedder: Embedder | None) -> tuple[Retrieved, ...]:
    """Return the ``k`` stable landmarks that are nearest to a question in meaning, best first.

    Raises:
        MapError: the question is empty or too long, k is below 1, or the map does not say which embedder made it.
        MissingBackendError, UnknownBackendError: the map's embedder cannot be had here.
    """
    if not question.strip():
        raise MapError("ask: got an empty question, wanted words")
    if len(question) > LONGEST_QUESTION:
        raise MapError(f"ask: got a question of {len(question)} characters, wanted at most {LONGEST_QUESTION}")
    if k < 1:
        raise MapError(f"ask: got k={k}, wanted 1 or more")
    if not any(row.labels for row in map_.landmarks):
        return ()
    if embedder is None and not map_.embedder:
        raise MapError("ask: this map does not say which embedder made it; give one: ask(map, question, embedder=…), or --embedder NAME")
    hits = map_.query(question.encode("utf-8", "replace").decode(), len(map_), embedder)  # a terminal may hand over half a character
    # Alike things have alike scores and count once: thirty cups are not thirty opinions.
    scores = np.unique(np.round([hit.score for hit in hits], 9))
    median = float(np.median(scores))
    spread = max(1.4826 * float(np.median(np.abs(scores - median))), _LEAST_SPREAD)
    enough = len(scores) >= _FEWEST_SCORES
    return tuple(Retrieved(hit.landmark, hit.score, (hit.score - median) / spread if enough else None) for hit in hits[:k])
