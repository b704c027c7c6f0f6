"""Which plain word a landmark has: the detector's votes, with words of one meaning counted together."""

from collections import Counter
from collections.abc import Mapping

import numpy as np

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.interfaces import AgentView
from seo_slam.types import Landmarks, heaviest

ONE_MEANING = 0.4
"""Log likelihood ratio, between words, from which they count as one: cup and mug or shoe and sneaker, not cup and bottle."""

KNOWN_TIMES = 1.5
"""Among words of one meaning, one that leads at another landmark weighs so many times as much: alike things get alike words."""


DOUBT_TIMES = 1.1
"""A word must have been said so much more than the one that a landmark has before that one is doubted."""


def plain_word(weights: Mapping[str, float], leading: Mapping[str, int], likelihood: LabelLikelihood | None) -> str:
    """Return the word of a landmark.

    Each word gathers the weight of those that mean the same; of the heaviest such group the heaviest word is taken, where words that
    lead elsewhere in the map weigh more. Two cups and a teacup against three bowls are a cup.

    Args:
        weights: word -> summed score of the detections that said it.
        leading: word -> number of other landmarks of which it is the heaviest.
        likelihood: compares words; None: each means something else.
    """
    if len(weights) < 2 or likelihood is None:
        return heaviest(weights)
    ordered = sorted(weights, key=lambda word: (-weights[word], word))
    groups = {word: [other for other in ordered if other == word or _mean_one(word, other, likelihood)] for word in ordered}
    gathered = max(ordered, key=lambda word: sum(weights[other] for other in groups[word]))
    return max(groups[gathered], key=lambda word: weights[word] * (KNOWN_TIMES if leading.get(word) else 1.0))


def leading_words(landmarks: Landmarks) -> Counter[str]:
    """Return word -> number of landmarks of which it is the heaviest."""
    return Counter(heaviest(words) for words in landmarks.labels)


def without(landmarks: Landmarks, row: int, leading: Mapping[str, int]) -> dict[str, int]:
    """Return ``leading_words`` without the landmark of a row."""
    own = heaviest(landmarks.labels[row])
    return {word: number - (word == own) for word, number in leading.items()}


def word_now(landmarks: Landmarks, row: int) -> str:
    """Return the plain word that a landmark has now: the category that an agent gave, else its name."""
    return landmarks.category_of(row) or landmarks.name_of(row)


def word_doubted(landmark_id: int, view: AgentView, leading: Mapping[str, int], likelihood: LabelLikelihood | None) -> str:
    """Return the word that a landmark should have by what the detector said, if it has another one; else ""."""
    evidence = view.evidence.get(landmark_id)
    if evidence is None or not evidence.weights:
        return ""
    row = int(np.searchsorted(view.landmarks.ids, landmark_id))
    word = plain_word(evidence.weights, without(view.landmarks, row, leading), likelihood)
    now = word_now(view.landmarks, row)
    same = word.casefold() == now.casefold() or evidence.weights[word] < DOUBT_TIMES * evidence.weights.get(now, 0.0)
    return "" if same else word


def _mean_one(a: str, b: str, likelihood: LabelLikelihood) -> bool:
    return likelihood.between({a: 1.0}, {b: 1.0}) >= ONE_MEANING
