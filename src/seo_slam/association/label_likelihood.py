"""How much more likely two labels are if they name one thing than if they name two.

Cosines of label embeddings do not separate (shoe and banana have 0.38, book and notebook 0.42), so they are calibrated: for pairs of
different words of which it is known whether they name one thing, a logistic regression of "one thing" on the cosine gives the log
likelihood ratio ``slope * cosine + offset``. To that comes what it says that the words are the same, or not.
``benchmarks/label_calibration.py`` holds the word pairs, which come from no recording, and makes the numbers; docs/association.md
says how good they are.
"""

import math
from collections.abc import Mapping

from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder

CALIBRATION: dict[str, tuple[float, float]] = {
    "minilm": (6.65, -3.13),
    "hashed": (3.23, -0.41),
}
"""Embedder -> slope, offset of the log likelihood ratio; "minilm" stands in for other sentence-transformers models."""

PHRASE = "a {}"
"""Words are compared within a phrase, which makes sentence embeddings take them as things: fewer wrong verdicts than bare words."""

KEEPS_WORD = 0.5
"""Chance that one thing is given the same word twice. A judgement: 0.7 to 0.85 on the simulated desk, and open-vocabulary detectors
hesitate more. The low end is the safe one: a wrong "two things" makes a duplicate, a wrong "one thing" must still pass the geometry."""

SHARES_WORD = 0.025
"""Chance that two different things near each other are given the same word: measured on the simulated desk, 0.025 to 0.036."""

SAME_WORD = math.log(KEEPS_WORD / SHARES_WORD)
"""Log likelihood ratio of a word with itself, 3.0; no two words have more."""

SAME_WORD_RATIO = math.exp(SAME_WORD)

OTHER_WORD = math.log((1.0 - KEEPS_WORD) / (1.0 - SHARES_WORD))
"""Log likelihood ratio, -0.67, of the words being different ones, whichever they are."""

MISTAKE_SHARE = 0.1
"""Share of labels that are wrong beyond confusion: such a label says nothing about which thing it is. A judgement, since it differs by
detector. It bounds the evidence of one label at log 0.1 = -2.3, less than a position that fits within 3 cm weighs for it (+3.9),
so that an absurd label alone makes no second landmark."""


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
        votes = total = 0.0
        for word, weight in distribution.items():
            votes += weight * (SAME_WORD_RATIO if word == label else self._ratio(label, word))
            total += weight
        mean = votes / total
        return math.log((1 - MISTAKE_SHARE) * mean + MISTAKE_SHARE)

    def between(self, a: Mapping[str, float], b: Mapping[str, float]) -> float:
        """Return the same for two distributions: the words of ``a`` as if observed, averaged by weight."""
        if not a or not b:
            return 0.0
        mean = sum(weight * math.exp(self.log_ratio(word, b)) for word, weight in a.items()) / sum(a.values())
        return math.log(mean)

    def _ratio(self, a: str, b: str) -> float:
        key = (a, b) if a < b else (b, a)
        if key not in self._ratios:
            self._ratios[key] = self._ratio_of_different(*key)
        return self._ratios[key]

    def _ratio_of_different(self, a: str, b: str) -> float:
        if self._embedder is None:
            return 0.0
        for word in (a, b):
            if word not in self._vectors:
                self._vectors[word] = self._embedder.embed_text([PHRASE.format(word)])[0]
        cosine = float(self._vectors[a] @ self._vectors[b])
        return math.exp(min(self._slope * cosine + self._offset + OTHER_WORD, SAME_WORD))
