"""CLIP-like models of sentence-transformers: found by their files, asked through Pillow. The model itself is a stand-in here."""

import json
import sys

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.backends import sentence_transformers_embedder as backend
from seo_slam.backends.sentence_transformers_embedder import SentenceTransformersEmbedder, SentenceTransformersImageEmbedder
from seo_slam.config import Component
from seo_slam.errors import BackendError, FrameError, MissingBackendError
from seo_slam.interfaces import ImageEmbedder

CLIP = [{"type": "sentence_transformers.models.CLIPModel", "path": "0_CLIPModel"}]
PLAIN = [{"type": "sentence_transformers.models.Transformer", "path": ""}, {"type": "sentence_transformers.models.Pooling", "path": "1"}]


def folder_of(tmp_path, modules, config=None):
    (tmp_path / "modules.json").write_text(json.dumps(modules), encoding="utf-8")
    (tmp_path / "config.json").write_text(json.dumps(config or {}), encoding="utf-8")
    return tmp_path


def made(folder):
    return registry.create("embedder", Component(name="sentence_transformers", options={"model": str(folder)}))


class Clip:
    """Encodes a picture as its mean colour and a word as its length, three numbers each."""

    def encode(self, inputs, normalize_embeddings, show_progress_bar):
        assert normalize_embeddings
        assert not show_progress_bar
        return np.array([self.row(x) for x in inputs], dtype=np.float32)

    def row(self, x):
        return [len(x), 1.0, 0.0] if isinstance(x, str) else 3.0 * np.asarray(x).reshape(-1, 3).mean(axis=0)


class Words(Clip):
    def row(self, x):
        if not isinstance(x, str):
            raise ValueError("Modality 'image' is not supported\nby this model")
        return super().row(x)


@pytest.mark.parametrize(
    ("modules", "config", "kind"),
    [
        (CLIP, None, SentenceTransformersImageEmbedder),
        (PLAIN, {"text_config": {}, "vision_config": {}}, SentenceTransformersImageEmbedder),
        (PLAIN, {"hidden_size": 384}, SentenceTransformersEmbedder),
        ([], None, SentenceTransformersEmbedder),
    ],
)
def test_the_files_say_whether_a_model_takes_pictures(tmp_path, modules, config, kind):
    embedder = made(folder_of(tmp_path, modules, config))
    assert type(embedder) is kind
    assert embedder._model is None
    assert hasattr(embedder, "embed_image") == (kind is SentenceTransformersImageEmbedder)


def test_minilm_takes_no_pictures():
    assert not hasattr(registry.create("embedder", "minilm"), "embed_image")


def test_pictures_and_words_come_in_one_space(tmp_path, monkeypatch):
    monkeypatch.setattr(backend, "_load", lambda source, offline: Clip())
    embedder = made(folder_of(tmp_path, CLIP))
    assert isinstance(embedder, ImageEmbedder)
    assert embedder.size == 3
    picture = np.zeros((4, 5, 3), dtype=np.uint8)
    picture[..., 0], picture[..., 1] = 30, 40
    rows = embedder.embed_image([picture, picture[:, ::2, ::-1]])
    assert rows.dtype == np.float64
    assert np.allclose(rows, [[0.6, 0.8, 0.0], [0.0, 0.8, 0.6]])
    assert embedder.embed_image([]).shape == (0, 3)
    assert np.linalg.norm(embedder.embed_text(["cup", "a"]), axis=1) == pytest.approx(np.ones(2))


def test_a_model_that_takes_no_pictures_after_all_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(backend, "_load", lambda source, offline: Words())
    with pytest.raises(BackendError, match=r"does not take pictures: Modality 'image' is not supported$"):
        made(folder_of(tmp_path, CLIP)).embed_image([np.zeros((4, 5, 3), dtype=np.uint8)])


@pytest.mark.parametrize("picture", [np.zeros((4, 5), dtype=np.uint8), np.zeros((4, 5, 3)), np.zeros((0, 5, 3), dtype=np.uint8)])
def test_what_is_no_picture_is_named(tmp_path, monkeypatch, picture):
    monkeypatch.setattr(backend, "_load", lambda source, offline: Clip())
    with pytest.raises(FrameError, match=r"wanted uint8 \(H, W, 3\)"):
        made(folder_of(tmp_path, CLIP)).embed_image([picture])


def test_without_pillow_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "PIL.Image", None)
    with pytest.raises(MissingBackendError, match="pip install pillow"):
        made(folder_of(tmp_path, CLIP)).embed_image([np.zeros((4, 5, 3), dtype=np.uint8)])
