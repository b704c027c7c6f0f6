"""features.npz: what was seen of a landmark is still known after its map was saved without map.db."""

import logging
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import MapError, MapFormatError
from seo_slam.map import Map
from seo_slam.map_features import read_features, write_features
from seo_slam.testing.store import make_landmark

MODEL = HashedEmbedder(64)
FEATURES = {7: np.array([0.6, 0.8, 0.0]), 3: np.array([0.0, 0.0, 1.0])}


def looks(landmark_id, word, **changes):
    cloud_world = np.random.default_rng(landmark_id).uniform(0, 1, (20, 3))
    return replace(make_landmark(landmark_id), embedding=MODEL.embed_text([word])[0], cloud_world=cloud_world, state="stable", **changes)


def made():
    """A thing without a word, a cup that looks like a bowl, and a thing nobody has looked at."""
    nameless = looks(4, "vase", label="", labels={})
    return Map([nameless, looks(5, "bowl"), replace(looks(6, "x"), embedding=np.zeros(64))], "poses", MODEL.name)


def test_what_landmarks_look_like_is_saved_and_loaded(tmp_path):
    made().save(tmp_path)
    loaded = Map.load(tmp_path)
    for landmark_id in (4, 5):
        np.testing.assert_allclose(loaded.landmark(landmark_id).embedding, made().landmark(landmark_id).embedding, atol=1e-7)
    (hit,) = loaded.query("vase", 1, MODEL)
    assert hit.landmark.id == 4
    assert hit.score == pytest.approx(1.0, abs=1e-6)
    assert loaded.query("bowl", 1, MODEL)[0].landmark.id == 5
    assert not loaded.landmark(6).embedding.any()


def test_a_map_without_clouds_has_no_such_file_and_keeps_none_of_an_older_one(tmp_path):
    bare = Map([replace(row, cloud_world=np.zeros((0, 3))) for row in made().landmarks], "poses", MODEL.name)
    bare.save(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["map.json"]
    made().save(tmp_path)
    bare.save(tmp_path)
    assert not Map.load(tmp_path).landmark(4).embedding.any()


def test_features_of_another_embedder_are_left_out(tmp_path, caplog):
    made().save(tmp_path)
    write_features(tmp_path / "features.npz", "another", {4: np.ones(64)})
    with caplog.at_level(logging.WARNING):
        assert not Map.load(tmp_path).landmark(4).embedding.any()
    assert "features of 'another'" in caplog.text


def test_a_damaged_file_costs_the_features_and_not_the_map(tmp_path, caplog):
    made().save(tmp_path)
    path = tmp_path / "features.npz"
    path.write_bytes(path.read_bytes()[:-9])
    with caplog.at_level(logging.WARNING):
        loaded = Map.load(tmp_path)
    assert len(loaded) == 3
    assert not loaded.landmark(4).embedding.any()
    assert "features.npz" in caplog.text


def test_what_is_written_is_read_and_bytes_do_not_tell_the_time(tmp_path):
    path = tmp_path / "features.npz"
    write_features(path, "four", FEATURES)
    embedder, features = read_features(path)
    assert (embedder, list(features)) == ("four", [3, 7])
    np.testing.assert_allclose(features[7], FEATURES[7], rtol=1e-7)
    first = path.read_bytes()
    write_features(path, "four", dict(reversed(FEATURES.items())))
    assert path.read_bytes() == first
    with zipfile.ZipFile(path) as archive:
        assert {info.date_time[0] for info in archive.infolist()} == {1980}
    write_features(path, "four", {})
    assert read_features(path) == ("four", {})


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "features.npz"
    write_features(path, "four", FEATURES)
    return path, path.read_bytes()


@settings(deadline=None, max_examples=300)
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_noticed_or_changes_nothing(written, where, bit):
    path, data = written[0], bytearray(written[1])
    data[int(where * len(data))] ^= 1 << bit
    path.write_bytes(data)
    try:
        embedder, features = read_features(path)
    except MapFormatError:
        return
    assert embedder == "four"
    assert {i: row.tolist() for i, row in features.items()} == {i: row.astype(np.float32).tolist() for i, row in FEATURES.items()}


@settings(deadline=None)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_cut_off_anywhere_is_noticed(written, share):
    path, data = written
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(MapFormatError, match=r"features\.npz"):
        read_features(path)


def test_pickles_are_not_opened(tmp_path):
    path = tmp_path / "features.npz"
    np.savez(path, ids=np.array([1]), features=np.array([{"a": 1}], dtype=object), embedder=np.array("four"))
    with pytest.raises(MapFormatError, match="allow_pickle"):
        read_features(path)


@pytest.mark.parametrize(
    "arrays",
    [
        {"ids": np.array([0.5]), "features": np.ones((1, 3))},
        {"ids": np.array([1, 2]), "features": np.ones((1, 3))},
        {"ids": np.array([1]), "features": np.full((1, 3), np.nan)},
        {"ids": np.array([1])},
    ],
)
def test_what_is_no_file_of_features_is_refused(tmp_path, arrays):
    path = tmp_path / "features.npz"
    np.savez(path, embedder=np.array("four"), **arrays)
    with pytest.raises(MapFormatError, match=r"features\.npz"):
        read_features(path)


@pytest.mark.parametrize("features", [{1: np.ones(3), 2: np.ones(4)}, {1: np.ones((2, 2))}, {1: np.full(3, np.nan)}])
def test_what_cannot_be_written_is_refused(tmp_path, features):
    with pytest.raises(MapError):
        write_features(tmp_path / "features.npz", "four", features)
    assert not list(tmp_path.iterdir())
