"""Which furniture tells which room."""

from collections.abc import Mapping, Sequence

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder

ROOM_FURNITURE: Mapping[str, Mapping[str, float]] = {
    "kitchen": {
        "refrigerator": 3.0,
        "fridge": 3.0,
        "oven": 3.0,
        "stove": 3.0,
        "cooktop": 3.0,
        "kitchen sink": 3.0,
        "kitchen counter": 2.0,
        "kitchen cabinet": 2.0,
        "counter": 1.5,
        "dishwasher": 2.0,
        "microwave": 1.5,
    },
    "bathroom": {"toilet": 4.0, "bathtub": 4.0, "shower": 4.0, "bathroom sink": 2.0, "towel rack": 1.0},
    "bedroom": {"bed": 4.0, "double bed": 4.0, "nightstand": 2.0, "wardrobe": 1.5, "dresser": 1.0, "crib": 3.0},
    "living room": {"sofa": 2.5, "couch": 2.5, "tv stand": 2.0, "coffee table": 1.5, "armchair": 1.0, "fireplace": 2.0},
    "study": {"desk": 1.5, "office desk": 2.0, "office chair": 1.5, "bookcase": 1.0, "filing cabinet": 1.5, "computer desk": 2.0},
    "dining room": {"dining table": 2.5, "sideboard": 1.0, "china cabinet": 1.5},
    "gym": {"treadmill": 3.0, "exercise bench": 2.5, "dumbbell rack": 2.5},
    "hallway": {"coat rack": 2.0, "shoe rack": 1.5, "umbrella stand": 1.5},
    "laundry room": {"washing machine": 2.5, "tumble dryer": 2.5, "ironing board": 1.0},
    "garage": {"car": 4.0, "workbench": 2.0, "tool cabinet": 1.5},
    "meeting room": {"conference table": 3.0, "whiteboard": 1.5, "projector screen": 1.5},
}
"""Room -> what stands there -> how much one such thing tells. Ours. A chair, a shelf or a plain table tells nothing."""

_NEUTRAL = (
    "chair",
    "shelf",
    "table",
    "cabinet",
    "rack",
    "box",
    "lamp",
    "plant",
    "door",
    "window",
    "wall",
    "floor",
    "stool",
    "bench",
    "bin",
)
"""Words that are near to some of the above, and tell no room: what is nearest to one of these has no vote."""


def room_votes(features: Sequence[FloatArray], embedder: Embedder, similarity: float) -> list[dict[str, float]]:
    """Return for each thing how much it speaks for a kind of room; empty where it tells nothing.

    Args:
        features: (D,) unit vectors of furniture.
        embedder: that made them.
        similarity: least cosine to a known word.
    """
    if not features:
        return []
    known = [(room, word, weight) for room, words in ROOM_FURNITURE.items() for word, weight in words.items()]
    vectors = embedder.embed_text([word for _, word, _ in known] + list(_NEUTRAL))
    cosines = np.stack(features) @ vectors.T
    best = np.argmax(cosines, axis=1)
    return [
        {known[k][0]: known[k][2] * float(row[k])} if k < len(known) and row[k] >= similarity else {}
        for k, row in zip(best.tolist(), cosines, strict=True)
    ]
