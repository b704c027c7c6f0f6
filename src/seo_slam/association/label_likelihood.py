"""How much more likely two labels are if they name one thing than if they name two.

Cosines of label embeddings do not separate (shoe and banana have 0.38, book and notebook 0.42), so they are calibrated: for pairs of
words of which it is known whether detectors use them for one thing, a logistic regression of "one thing" on the cosine gives
the log likelihood ratio ``slope * cosine + offset``. ``benchmarks/label_calibration.py`` holds the word pairs, which come from
no recording, and makes the numbers below.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from seo_slam.geometry import FloatArray

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

    def __init__(self, embedder_name: str) -> None:
        """Use the calibration of an embedder, by its name."""
        self._slope, self._offset = CALIBRATION.get(embedder_name, CALIBRATION["minilm"])
        self._vectors: dict[str, FloatArray] = {}

    @property
    def highest(self) -> float:
        """The largest log ratio there is: the label that the landmark always had."""
        return float(np.log((1 - MISTAKE_SHARE) * np.exp(SAME_WORD) + MISTAKE_SHARE))

    def learn(self, labels: Sequence[str | None], embeddings: FloatArray) -> None:
        """Remember the unit vectors (K, D) of labels, so that distributions over them can be compared word by word."""
        for label, vector in zip(labels, embeddings, strict=True):
            if label and label not in self._vectors:
                self._vectors[label] = vector

    def log_ratio(self, labels: Sequence[str | None], distributions: Sequence[Mapping[str, float]]) -> FloatArray:
        """Return (K, N): log P(label | it is landmark n) - log P(label | it is another thing).

        The landmark's words vote by weight; a share of mistakes bounds it from below. 0 where either has no label, or a word was
        never learnt.
        """
        out = np.zeros((len(labels), len(distributions)))
        known = {label for label in labels if label} & self._vectors.keys()
        for n, distribution in enumerate(distributions):
            words = [word for word in distribution if word in self._vectors]
            if not words:
                continue
            weights = np.array([distribution[word] for word in words])
            weights = weights / weights.sum()
            vectors = np.array([self._vectors[word] for word in words])
            ratio_of = {label: float(weights @ self._ratio(label, words, vectors)) for label in known}
            for k, label in enumerate(labels):
                if label in ratio_of:
                    out[k, n] = np.log((1 - MISTAKE_SHARE) * ratio_of[label] + MISTAKE_SHARE)
        return out

    def between(self, a: Mapping[str, float], b: Mapping[str, float]) -> float:
        """The same for two distributions: words of ``a`` as if observed, averaged by weight."""
        words = [word for word in a if word in self._vectors]
        if not words:
            return 0.0
        weights = np.array([a[word] for word in words])
        return float(np.log(weights / weights.sum() @ np.exp(self.log_ratio(words, [b])[:, 0])))

    def _ratio(self, label: str, words: list[str], vectors: FloatArray) -> FloatArray:
        log_ratio = np.minimum(self._slope * (vectors @ self._vectors[label]) + self._offset, SAME_WORD)
        same = np.array([word == label for word in words])
        return np.asarray(np.exp(np.where(same, SAME_WORD, log_ratio)), dtype=np.float64)
