"""What a user's own image model says of a landmark, as votes beside the detector's."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from seo_slam.interfaces import AgentView, ImageEmbedder

CROP_AROUND = 0.1
"""Share of a box's sides that is shown around it."""


@runtime_checkable
class CropClassifier(Protocol):
    """Says what is in a picture."""

    def classify(self, rgb: NDArray[np.uint8], words: Sequence[str]) -> Mapping[str, float]:
        """Return word -> score in [0, 1] for a picture (H, W, 3); of ``words``, or of the model's own if it has a fixed list."""
        ...


class EmbeddingClassifier:
    """A ``CropClassifier`` of an ``ImageEmbedder``, such as CLIP."""

    def __init__(self, embedder: ImageEmbedder, temperature: float = 0.01, phrase: str = "a photo of a {}") -> None:
        """Take the embedder; ``temperature`` turns cosines into odds (CLIP's is 0.01)."""
        self._embedder = embedder
        self._temperature = temperature
        self._phrase = phrase

    def classify(self, rgb: NDArray[np.uint8], words: Sequence[str]) -> Mapping[str, float]:
        """Return word -> probability that it is the one of ``words`` that fits best."""
        if not words:
            return {}
        texts = self._embedder.embed_text([self._phrase.format(word) for word in words])
        picture = np.asarray(self._embedder.embed_image([rgb]), dtype=np.float64)[0]
        odds = np.asarray(texts, dtype=np.float64) @ picture / self._temperature
        shares = np.exp(odds - odds.max())
        return dict(zip(words, (shares / shares.sum()).tolist(), strict=True))


def crop_of(landmark_id: int, view: AgentView) -> NDArray[np.uint8]:
    """Return the picture of a landmark with a box, with a little around it."""
    x0, y0, x1, y1 = view.boxes_px[landmark_id].tolist()
    margin_x, margin_y = CROP_AROUND * (x1 - x0), CROP_AROUND * (y1 - y0)
    height, width = view.frame.depth_m.shape
    left, top = int(max(x0 - margin_x, 0)), int(max(y0 - margin_y, 0))
    right, bottom = int(min(x1 + margin_x + 1, width)), int(min(y1 + margin_y + 1, height))
    return np.ascontiguousarray(view.frame.rgb[top : max(bottom, top + 1), left : max(right, left + 1)])
