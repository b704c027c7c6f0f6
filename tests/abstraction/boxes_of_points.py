"""Landmarks made of points on boxes, and a tiny embedder whose words are what they are."""

import numpy as np

from seo_slam.types import Landmark

SIZE = 16
_KINDS = {"furniture": 0, "portable": 1}
_WORDS = {
    "table": (0, 2), "desk": (0, 2), "chair": (0, 3), "shelf": (0, 4), "wardrobe": (0, 5), "sofa": (0, 6), "cup": (1, 7), "mug": (1, 7),
    "book": (1, 8), "banana": (1, 9), "shoe": (1, 10), "furniture": (0, 0), "portable": (1, 1),
}  # fmt: skip


class WordEmbedder:
    """Half of a vector says furniture or not, half says which; an unknown word is neither."""

    name = "words"
    size = SIZE

    def embed_text(self, texts):
        out = np.zeros((len(texts), SIZE))
        for row, text in zip(out, texts, strict=True):
            for axis in _WORDS.get(text, (14, 15)):
                row[axis] += 1.0
        return out / np.linalg.norm(out, axis=1, keepdims=True)


def on_box(low, high, sides="all", step_m=0.02):
    """Points (N, 3) on the faces of a box; ``sides``: all, top, or front (the face at low y)."""
    axes = [np.linspace(a, b, max(2, round((b - a) / step_m) + 1)) for a, b in zip(low, high, strict=True)]
    p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    at_low, at_high = np.isclose(p, low), np.isclose(p, high)
    chosen = {"all": (at_low | at_high).any(axis=1), "top": at_high[:, 2], "front": at_low[:, 1]}
    return p[chosen[sides]]


def table_points(corner=(0.0, 0.0), size=(1.2, 0.8), height=0.74):
    """A top and four legs."""
    x, y = corner
    top = on_box((x, y, height - 0.02), (x + size[0], y + size[1], height))
    legs = [on_box((a, b, 0.0), (a + 0.04, b + 0.04, height - 0.02)) for a in (x, x + size[0] - 0.04) for b in (y, y + size[1] - 0.04)]
    return np.concatenate([top, *legs])


def shelf_points(corner=(0.0, 0.0), size=(0.8, 0.34), levels=(0.05, 0.45, 0.85, 1.25)):
    """Two sides, a back at high y, and boards."""
    (x, y), (wide, deep), top = corner, size, levels[-1]
    return np.concatenate(
        [
            on_box((x, y, 0.0), (x + 0.02, y + deep, top)),
            on_box((x + wide - 0.02, y, 0.0), (x + wide, y + deep, top)),
            on_box((x, y + deep - 0.02, 0.0), (x + wide, y + deep, top)),
            *(on_box((x, y, z - 0.02), (x + wide, y + deep, z)) for z in levels),
        ]
    )


def chair_points(corner=(0.0, 0.0)):
    """A seat, a back at high y, four legs."""
    x, y = corner
    return np.concatenate(
        [
            on_box((x, y, 0.43), (x + 0.44, y + 0.44, 0.45)),
            on_box((x, y + 0.42, 0.45), (x + 0.44, y + 0.44, 0.9)),
            *(on_box((x + a, y + b, 0.0), (x + a + 0.04, y + b + 0.04, 0.43)) for a in (0, 0.4) for b in (0, 0.4)),
        ]
    )


def thing_points(x, y, z, side=0.08):
    """A small cube that stands with its middle over x, y at height z."""
    return on_box((x - side / 2, y - side / 2, z), (x + side / 2, y + side / 2, z + side), step_m=0.01)


def landmark(landmark_id, label, p_world, labels=None, embedding=None):
    words = ({label: 1.0} if label else {}) if labels is None else labels
    vector = WordEmbedder().embed_text([label])[0] if label else np.zeros(SIZE)
    return Landmark(
        id=landmark_id,
        label=label,
        labels=words,
        position_m=0.5 * (p_world.min(axis=0) + p_world.max(axis=0)),
        covariance_m2=np.eye(3) * 1e-4,
        size_m=np.ptp(p_world, axis=0),
        embedding=vector if embedding is None else embedding,
        observations=9,
        first_seen_s=0.0,
        last_seen_s=1.0,
        state="stable",
        cloud_world=p_world,
    )
