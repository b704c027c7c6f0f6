"""What the map knows of one thing beside its position: words, looks, size, and whether to believe in it."""

from dataclasses import dataclass, field

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.mapping.existence import Sightings
from seo_slam.mapping.observation_record import ObservationRecord
from seo_slam.types import LandmarkState, heaviest

AGENT_SHARE = 0.6
"""Weight of the word that an agent gave: more than half, so that it is the heaviest wherever the map is read."""

UNKNOWN_SIGMA_M = 1.0

LOOKS_KEPT = 30

SURFACE_VIEWS, SURFACE_POINTS = 4, 24
"""So many views of a thing's surface are remembered, and points of each."""


@dataclass(slots=True, eq=False)
class Thing:
    """The mutable side of a landmark.

    Attributes:
        weights: word -> summed score of the observations that said it.
        embedding_sum: (D,) score-weighted sum of label embeddings.
        whole_sizes, cut_sizes: (3,) world extents seen in full, and cut by the image border.
        whole_across: (2,) width and height across the line of sight, seen in full.
        sightings: what counts for and against it.
        existence: probability that it is there.
        looks: (area_px, hidden share) of the newest views in which it was found.
        surface_views: (S, 3) points of its surface each, from the newest views, relative to its position, world axes.
        fixed_label, fixed_embedding: the label an agent gave it, and (D,) its unit embedding.
        fixed_category: the plain word it gave beside it, "" if the label is one.
        cov_world: (3, 3) of its position, as last asked of the smoother.
        record: its observations with their points; None where no clouds are kept.
        is_background: it has no word, and was judged to be a piece of a wall or the like: it takes in what is seen of it, and is no thing.
    """

    id: int
    first_seen_s: float
    last_seen_s: float
    embedding_sum: FloatArray
    weights: dict[str, float] = field(default_factory=dict)
    whole_sizes: list[FloatArray] = field(default_factory=list)
    cut_sizes: list[FloatArray] = field(default_factory=list)
    whole_across: list[FloatArray] = field(default_factory=list)
    observations: int = 0
    sightings: Sightings = field(default_factory=Sightings)
    existence: float = 0.5
    looks: list[tuple[float, float]] = field(default_factory=list)
    surface_views: list[FloatArray] = field(default_factory=list)
    state: LandmarkState = "tentative"
    version: int = 0
    fixed_label: str | None = None
    fixed_embedding: FloatArray | None = None
    fixed_category: str = ""
    cov_world: FloatArray = field(default_factory=lambda: UNKNOWN_SIGMA_M**2 * np.eye(3))
    record: ObservationRecord | None = None
    is_background: bool = False
    _size_m: FloatArray | None = None
    _across_m: FloatArray | None = None
    _words: dict[str, float] | None = None
    _embedding: FloatArray | None = None

    @property
    def label(self) -> str:
        """The word that an agent gave it, else the heaviest."""
        if self.fixed_label is not None:
            return self.fixed_label
        return "" if self._is_nameless else heaviest(self.weights)

    @property
    def _is_nameless(self) -> bool:
        return self.record is not None and self.record.is_nameless

    def surface(self) -> FloatArray:
        """(M, 3) points of its surface relative to its position; M is the same for all things, few views are repeated."""
        views = self.surface_views or [np.zeros((SURFACE_POINTS, 3))]
        return np.concatenate([views[k % len(views)] for k in range(SURFACE_VIEWS)])

    def remember_look(self, area_px: float, hidden: float) -> None:
        """Note how it looked in a view in which it was found."""
        self.looks.append((area_px, hidden))
        del self.looks[:-LOOKS_KEPT]

    def changed(self) -> None:
        """Forget what was derived; to be called after weights or sizes change."""
        self._size_m = self._across_m = self._words = self._embedding = None

    def distribution(self) -> dict[str, float]:
        """Word -> share, heaviest first; an agent's word leads with at least ``AGENT_SHARE``."""
        if self._words is None:
            self._words = self._distribution()
        return self._words

    def _distribution(self) -> dict[str, float]:
        total = 0.0 if self._is_nameless else sum(self.weights.values())
        shares = {word: weight / total for word, weight in self.weights.items()} if total > 0 else {}
        if self.fixed_label is not None:
            shares = {word: (1.0 - AGENT_SHARE) * share for word, share in shares.items()}
            plain = self.fixed_category or self.fixed_label
            shares[plain] = shares.get(plain, 0.0) + 1.0 - sum(shares.values())
        return dict(sorted(shares.items(), key=lambda item: (-item[1], item[0])))

    def size_m(self) -> FloatArray:
        """(3,) extents along the world's axes: the median of whole views, else the largest of the cut ones."""
        if self._size_m is None:
            if self.whole_sizes:
                self._size_m = np.median(self.whole_sizes, axis=0)
            else:
                self._size_m = np.max(self.cut_sizes, axis=0) if self.cut_sizes else np.zeros(3)
        return self._size_m

    def across_m(self) -> FloatArray:
        """(2,) usual width and height across the line of sight: the median of whole views, 0 if there were none."""
        if self._across_m is None:
            self._across_m = np.median(self.whole_across, axis=0) if self.whole_across else np.zeros(2)
        return self._across_m

    def embedding(self) -> FloatArray:
        """(D,) unit vector of the words and an agent's word, by their shares; zeros while unnamed."""
        if self._embedding is None:
            self._embedding = self.record.feature() if self.record else _unit(self.embedding_sum)
            if self.fixed_embedding is not None:
                self._embedding = _unit((1.0 - AGENT_SHARE) * self._embedding + AGENT_SHARE * self.fixed_embedding)
        return self._embedding


def _unit(vector: FloatArray) -> FloatArray:
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 0 else vector.copy()
