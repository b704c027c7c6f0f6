"""What class names mean as vectors, and which of them is nearest to what an object looks like."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from seo_slam.errors import EvaluationError
from seo_slam.evaluation.labelled_points import require_class_names
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder

TEMPLATES = ("{}", "there is a {} in the scene")
"""A class's vector is the mean of the vectors of these."""


@dataclass(frozen=True, eq=False)
class ClassWords:
    """Class names and their vectors.

    Attributes:
        names: K different words.
        features: (K, D) unit rows.
        embedder: makes vectors of objects' own words, in the same way.
        templates: what was embedded of each name.
    """

    names: tuple[str, ...]
    features: FloatArray
    embedder_in_use: Embedder = field(repr=False)
    templates: tuple[str, ...] = TEMPLATES

    @classmethod
    def of(cls, names: Sequence[str], embedder: Embedder, templates: Sequence[str] = TEMPLATES) -> "ClassWords":
        """Embed class names.

        Raises:
            EvaluationError: no names, an empty or a doubled one, or a template without a place for the name.
        """
        require_class_names(tuple(names))
        wrong = [template for template in templates if "{}" not in template]
        if wrong or not templates:
            raise EvaluationError(f"templates: got {wrong or 'none'}, wanted texts with {{}} where the name goes")
        return cls(tuple(names), _meant(tuple(names), embedder, tuple(templates)), embedder, tuple(templates))

    @property
    def embedder(self) -> str:
        """Name of the model."""
        return self.embedder_in_use.name

    def similarity(self, features: Sequence[FloatArray], labels: Sequence[str]) -> FloatArray:
        """Return (N, K) cosines of objects with classes: by feature, or where that is missing or zero by label; NaN without both."""
        out = np.full((len(features), len(self.names)), np.nan)
        spoken = sorted({label for label in labels if label.strip()})
        of_word = dict(zip(spoken, _meant(tuple(spoken), self.embedder_in_use, self.templates), strict=True)) if spoken else {}
        for row, (feature, label) in enumerate(zip(features, labels, strict=True)):
            vector = feature if feature.any() else of_word.get(label)
            if vector is not None:
                out[row] = self.features @ (vector / np.linalg.norm(vector))
        return out


def _meant(names: tuple[str, ...], embedder: Embedder, templates: tuple[str, ...]) -> FloatArray:
    rows = embedder.embed_text([template.replace("{}", name) for name in names for template in templates])
    mean = rows.reshape(len(names), len(templates), -1).mean(axis=1)
    return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True), dtype=np.float64)
