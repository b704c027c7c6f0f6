"""Which landmarks rarely move: by their words against lists of static and movable things (DualMap IV-A)."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.types import Landmark

Vote = Literal[-1, 0, 1]
"""1: static, -1: movable, 0: undecided."""

_HALF = 0.5


class Mobility:
    """Tells static from movable things.

    Two rules. "template" is the paper's: one mean vector of static names and phrases, one threshold. "prototypes": a word in either list,
    or that ends in one ("kitchen table"), is decided; another by its greatest cosine to static names against that to movable names, and,
    where these are within ``name_margin``, to the phrases.

    Args:
        embedder: of all words.
        settings: lists and thresholds.
    """

    def __init__(self, embedder: Embedder, settings: AbstractionSettings) -> None:
        self._embedder = embedder
        self._settings = settings
        self._static_keys = {words_of(name) for name in settings.static_names}
        self._movable_keys = {words_of(name) for name in settings.movable_names}
        self._static, self._movable = self._embed(settings.static_names), self._embed(settings.movable_names)
        self._static_phrases, self._movable_phrases = self._embed(settings.static_phrases), self._embed(settings.movable_phrases)
        template = np.concatenate([self._static, self._static_phrases]).mean(axis=0)
        self._template = template / max(float(np.linalg.norm(template)), 1e-12)

    def of_word(self, word: str) -> Vote:
        """Say whether a word means something that stays, that moves, or neither for sure."""
        if self._settings.anchor_rule == "prototypes":
            listed = self._listed(words_of(word))
            if listed:
                return listed
        return self.of_feature(self._embed([word])[0])

    def of_feature(self, feature: FloatArray) -> Vote:
        """Say the same of a unit vector (D,) without a word; zeros are undecided."""
        if not feature.any():
            return 0
        settings = self._settings
        if settings.anchor_rule == "template":
            return 1 if float(self._template @ feature) > settings.template_threshold else -1
        by_name = _highest(self._static, feature) - _highest(self._movable, feature)
        if abs(by_name) > settings.name_margin:
            return 1 if by_name > 0 else -1
        by_phrase = _highest(self._static_phrases, feature) - _highest(self._movable_phrases, feature)
        if abs(by_phrase) > settings.phrase_margin:
            return 1 if by_phrase > 0 else -1
        return 0

    def of_landmark(self, words: Mapping[str, float], feature: FloatArray, large: bool) -> bool:
        """Say whether a landmark is an anchor.

        Args:
            words: word -> share, see ``words_for``; a majority of the shares decides.
            feature: (D,) its unit vector, asked where words leave it open; zeros, or a vector of another length than the embedder's, say
                nothing.
            large: it is as large as furniture: decides where all else leaves it open, if the settings allow.
        """
        balance = sum(share * self.of_word(word) for word, share in words.items())
        if abs(balance) > self._settings.undecided_share:
            return balance > 0
        vote = self.of_feature(feature) if feature.shape == (self._embedder.size,) else 0
        if vote:
            return vote > 0
        return large if self._settings.large_is_anchor else balance > 0

    def is_listed(self, landmark: Landmark) -> bool:
        """Whether the list of static things itself, and no mere likeness to it, makes an anchor of a landmark."""
        return sum(share for word, share in words_for(landmark).items() if self._listed(words_of(word)) > 0) > _HALF

    def _listed(self, word: tuple[str, ...]) -> Vote:
        """By the longest ending of a word of several, since English names a thing last: "coffee table", but "table lamp"."""
        for start in range(len(word)):
            ending = word[start:]
            if ending in self._static_keys:
                return 1
            if ending in self._movable_keys:
                return -1
        return 0

    def _embed(self, words: Sequence[str]) -> FloatArray:
        return self._embedder.embed_text([" ".join(words_of(word)) for word in words]).reshape(len(words), self._embedder.size)


def words_of(name: str) -> tuple[str, ...]:
    """Split a name into lower-case words."""
    return tuple(name.casefold().replace("_", " ").split())


def words_for(landmark: Landmark) -> dict[str, float]:
    """Return word -> share by which a landmark is judged: its labels, or, where an agent renamed it, the agent's word alone."""
    if landmark.label and landmark.label not in landmark.labels:
        return {landmark.category or landmark.label: 1.0}
    return dict(landmark.labels)


def features_of(landmarks: Iterable[Landmark], embedder: Embedder) -> list[FloatArray]:
    """Return the unit vector (D,) of each landmark: its own, else that of its words, else zeros."""
    return [_feature(landmark, embedder) for landmark in landmarks]


def _feature(landmark: Landmark, embedder: Embedder) -> FloatArray:
    own = np.asarray(landmark.embedding, dtype=np.float64)
    if own.shape != (embedder.size,) or not own.any():
        words = words_for(landmark)
        shares = np.array(list(words.values()), dtype=np.float64)
        own = shares @ embedder.embed_text(list(words)) if words else np.zeros(embedder.size)
    return np.asarray(own / max(float(np.linalg.norm(own)), 1e-12))


def _highest(rows: FloatArray, feature: FloatArray) -> float:
    return float((rows @ feature).max()) if len(rows) else -1.0
