"""How much more likely two labels are if they name one thing than if they name two.

Cosines of label embeddings do not separate (shoe and banana have 0.38, book and notebook 0.42), so they are calibrated: for pairs of
words of which it is known whether detectors use them for one thing, a logistic regression of "one thing" on the cosine gives
the log likelihood ratio ``slope * cosine + offset``. ``benchmarks/label_calibration.py`` holds the word pairs, which come from
no recording, and makes the numbers below.
"""

import math
from collections.abc import Mapping

from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder

CALIBRATION: dict[str, tuple[float, float]] = {
    "minilm": (12.0, -6.0),
    "hashed": (6.0, -1.5),
}
"""Embedder -> slope, offset of the log likelihood ratio; "minilm" stands in for other sentence-transformers models."""

SAME_WORD = 4.0
"""Log likelihood ratio of a word with itself: about one pair of different things in 55 shares its word."""

MISTAKE_SHARE = 0.1
"""Share of labels that are wrong beyond confusion: such a label says nothing about which thing it is."""


class LabelLikelihood:
    """Log likelihood ratios between observed labels and landmarks' label distributions."""

    def __init__(self, embedder: Embedder | None = None) -> None:
        """Compare words by an embedder and its calibration; without one, words are the same or not."""
        self._embedder = embedder
        name = embedder.name if embedder is not None else ""
        self._slope, self._offset = CALIBRATION.get(name, CALIBRATION["minilm"])
        self._vectors: dict[str, FloatArray] = {}
        self._ratios: dict[tuple[str, str], float] = {}

    @property
    def highest(self) -> float:
        """The largest log ratio there is: the one word that the landmark always had."""
        return math.log((1 - MISTAKE_SHARE) * math.exp(SAME_WORD) + MISTAKE_SHARE)

    @property
    def lowest(self) -> float:
        """The smallest log ratio there is: a word that has nothing to do with the landmark's, so it may be a mistake."""
        return math.log(MISTAKE_SHARE)

    def log_ratio(self, label: str | None, distribution: Mapping[str, float]) -> float:
        """Return log P(label | it is this landmark) - log P(label | it is another thing).

        The landmark's words vote by weight; the share of mistakes bounds it from below. 0 where either has no label.
        """
        if not label or not distribution:
            return 0.0
        mean = sum(weight * self._ratio(label, word) for word, weight in distribution.items()) / sum(distribution.values())
        return math.log((1 - MISTAKE_SHARE) * mean + MISTAKE_SHARE)

    def between(self, a: Mapping[str, float], b: Mapping[str, float]) -> float:
        """Return the same for two distributions: the words of ``a`` as if observed, averaged by weight."""
        if not a or not b:
            return 0.0
        mean = sum(weight * math.exp(self.log_ratio(word, b)) for word, weight in a.items()) / sum(a.values())
        return math.log(mean)

    def _ratio(self, a: str, b: str) -> float:
        if a == b:
            return math.exp(SAME_WORD)
        key = (a, b) if a < b else (b, a)
        if key not in self._ratios:
            self._ratios[key] = self._ratio_of_different(*key)
        return self._ratios[key]

    def _ratio_of_different(self, a: str, b: str) -> float:
        if self._embedder is None:
            return 0.0
        for word in (a, b):
            if word not in self._vectors:
                self._vectors[word] = self._embedder.embed_text([word])[0]
        cosine = float(self._vectors[a] @ self._vectors[b])
        return math.exp(min(self._slope * cosine + self._offset, SAME_WORD))
