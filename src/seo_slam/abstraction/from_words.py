"""An abstract map for another embedder."""

from dataclasses import replace

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder


def is_of(abstract_map: AbstractMap, embedder: Embedder) -> bool:
    """Return whether the map's features are of this embedder: of its name, and each of its size."""
    anchors = abstract_map.anchors
    carried = [volatile.feature for anchor in anchors for volatile in (*anchor.volatiles, *anchor.hints)]
    features = [*(anchor.feature for anchor in anchors), *carried]
    return abstract_map.embedder == embedder.name and all(feature.shape == (embedder.size,) for feature in features)


def with_features_of_words(abstract_map: AbstractMap, embedder: Embedder) -> AbstractMap:
    """Return the map with features that ``embedder`` makes of its words: what pictures told is lost, places and layout stay.

    What has no word has zeros, and is found by no query.
    """

    def feature(label: str) -> FloatArray:
        return embedder.embed_text([label])[0] if label else np.zeros(embedder.size)

    def renewed(anchor: Anchor) -> Anchor:
        volatiles, hints = (
            tuple(replace(volatile, feature=feature(volatile.label)) for volatile in rows) for rows in (anchor.volatiles, anchor.hints)
        )
        return replace(anchor, feature=feature(anchor.label), volatiles=volatiles, hints=hints)

    recipe = None if abstract_map.features is None else replace(abstract_map.features, image_encoder="")
    anchors = tuple(renewed(anchor) for anchor in abstract_map.anchors)
    return replace(abstract_map, anchors=anchors, embedder=embedder.name, features=recipe)
