"""What is it, in words that tell alike things apart? The description agent that asks no model."""

import importlib
from collections.abc import Mapping, Sequence

import numpy as np

from seo_slam.agents.colour_words import colour_words, colours_of
from seo_slam.agents.crop_classifier import CropClassifier, crop_of
from seo_slam.agents.local_looks import observations_of, surface_px, version_of
from seo_slam.agents.size_words import size_word
from seo_slam.agents.word_choice import leading_words, plain_word, without
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.errors import ConfigError
from seo_slam.interfaces import Agent, AgentView
from seo_slam.records import AgentRole, Confirm, Edit, Relabel
from seo_slam.types import heaviest

KNOWN_COLOUR_SHARE = 0.35
"""A label that is known already is used again where so much of a thing has its colour."""

CLASSIFIER_SHARE = 0.5
"""All that a classifier says of one picture weighs this part of all that the detector said."""


SETTLED = 8
"""Observations from which the word that was said most is trusted to stay; before, nothing is described."""


class LocalDescription(Agent):
    """Gives a landmark its colour, its size where that tells it from others, and the word that most of what was said of it means.

    The category is what the detector said most, where words of one meaning count together. The label is that word with the colour of
    the thing's own surface before it, and "large" or "small" if another of that colour is of another size. A label that was given before
    is used again where it fits, so that alike things have one label.
    """

    role: AgentRole = "description"

    def __init__(self, likelihood: LabelLikelihood | None = None, classifier: CropClassifier | str | None = None) -> None:
        """Take what compares words, and an image model if there is one.

        Args:
            likelihood: compares words; a pipeline gives its own. None: different words mean different things.
            classifier: what says what is in a picture, or "module:name" of a class or function without arguments that makes one.

        Raises:
            ConfigError: there is no such classifier, or it has no ``classify``.
        """
        self._likelihood = likelihood
        self._classifier = _made(classifier)

    @property
    def name(self) -> str:
        """Written beside every edit."""
        return "local description"

    def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return a ``Relabel``, or a ``Confirm`` where the landmark has that label; nothing of what no word was said of."""
        known, leading = list(view.known_labels), leading_words(view.landmarks)
        edits: list[Edit] = []
        for landmark_id in view.asked or tuple(view.boxes_px):
            edit = self._describe(landmark_id, view, known, leading)
            if isinstance(edit, Relabel) and edit.label not in known:
                known.append(edit.label)
            edits += [edit] if edit is not None else []
        return edits

    def _describe(self, landmark_id: int, view: AgentView, known: Sequence[str], leading: Mapping[str, int]) -> Edit | None:
        row = int(np.searchsorted(view.landmarks.ids, landmark_id))
        if observations_of(landmark_id, view) < SETTLED:
            return None
        weights = self._votes(landmark_id, row, view)
        word = plain_word(weights, without(view.landmarks, row, leading), self._likelihood)
        if not word:
            return None
        colours = colours_of(view.frame, surface_px(landmark_id, view))
        label = _known_label(word, colours, known) or " ".join(part for part in (colour_words(colours), word) if part)
        size = size_word(float(view.landmarks.size_m[row].max()), _longest_of_others(label, row, view))
        label = f"{size} {label}".strip()
        category = word if label != word else ""
        version = version_of(landmark_id, view)
        if (label, category) == (view.landmarks.name_of(row), view.landmarks.category_of(row)):
            return Confirm(landmark_id, version, self.name)
        return Relabel(landmark_id, version, label, self.name, category)

    def _votes(self, landmark_id: int, row: int, view: AgentView) -> Mapping[str, float]:
        """Word -> weight: the detector's, without what agents said; and the classifier's."""
        evidence = view.evidence.get(landmark_id)
        weights = dict(evidence.weights) if evidence is not None else dict(view.landmarks.labels[row])
        if self._classifier is None:
            return weights
        words = sorted({heaviest(labels) for labels in view.landmarks.labels} | weights.keys() - {""})
        total = CLASSIFIER_SHARE * (sum(weights.values()) or 1.0)
        for word, score in self._classifier.classify(crop_of(landmark_id, view), words).items():
            weights[word] = weights.get(word, 0.0) + total * float(score)
        return weights


def _known_label(word: str, colours: Mapping[str, float], known: Sequence[str]) -> str:
    """The label given before to such a thing whose colour this one has most of; "" if there is none."""
    fits = {f"{colour} {word}": share for colour, share in colours.items() if share >= KNOWN_COLOUR_SHARE}
    return next((label for label in fits if label in known), "")


def _longest_of_others(label: str, row: int, view: AgentView) -> list[float]:
    """Longest extents of the other landmarks that are called so, whatever size they were said to have."""
    landmarks = view.landmarks
    names = [landmarks.name_of(k).removeprefix("large ").removeprefix("small ") for k in range(len(landmarks))]
    return [float(landmarks.size_m[k].max()) for k, name in enumerate(names) if k != row and name == label]


def _made(classifier: CropClassifier | str | None) -> CropClassifier | None:
    if classifier is None or not isinstance(classifier, str):
        made = classifier
    else:
        module, _, name = classifier.partition(":")
        try:
            made = getattr(importlib.import_module(module), name)()
        except (ImportError, AttributeError, ValueError) as error:
            raise ConfigError(f"local_description: classifier {classifier!r} cannot be made: {error}; wanted 'module:name'") from error
    if made is not None and not callable(getattr(made, "classify", None)):
        raise ConfigError(f"local_description: classifier {made!r:.80} has no classify; see CropClassifier")
    return made
