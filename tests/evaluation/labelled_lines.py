"""A tiny labelled world for tests of the segmentation's score: four classes on a line, ten metres apart, and words at right angles."""

import numpy as np

from seo_slam.evaluation.class_words import ClassWords
from seo_slam.evaluation.labelled_points import LabelledCloud
from seo_slam.evaluation.segmentation import PredictedObject

NAMES = ("chair", "door", "lamp", "table", "wall")
"""A lamp has a word, but no points."""
PLACES_M = {"chair": 0.0, "table": 10.0, "door": 20.0, "wall": 30.0}
SPACING_M = 0.5
STEPS_M = SPACING_M * np.arange(4)


class OneWordOneAxis:
    """An embedder of class names: each its own axis, whatever sentence it stands in."""

    name = "one word one axis"
    size = len(NAMES)

    def embed_text(self, texts):
        return np.array([[float(name in text) for name in NAMES] for text in texts])


def words():
    return ClassWords.of(NAMES, OneWordOneAxis())


def line(name, shift_m=0.0):
    """(4, 3) the points of a class."""
    p_world = np.zeros((4, 3))
    p_world[:, 0] = PLACES_M[name] + STEPS_M + shift_m
    return p_world


def truth(names=("chair", "table", "door", "wall"), **more):
    """Four points a class; a class is one thing, and its id is ten times the class's."""
    class_ids = np.repeat([NAMES.index(name) for name in names], 4)
    return LabelledCloud(np.concatenate([line(name) for name in names]), 10 * class_ids, class_ids, NAMES, **more)


def feature(**weights):
    """A feature by class names."""
    return np.array([float(weights.get(name, 0.0)) for name in NAMES])


def thing(place, feature_or_label="", points=slice(None)):
    """An object with the points of a class."""
    if isinstance(feature_or_label, str):
        return PredictedObject(line(place)[points], label=feature_or_label)
    return PredictedObject(line(place)[points], feature_or_label)
