"""The points of landmarks go with the map."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam import Landmark, Map, MapFormatError


def landmark(landmark_id, points):
    cloud = np.random.default_rng(landmark_id).uniform(0, 1, (points, 3))
    return Landmark(
        landmark_id,
        "cup",
        {"cup": 1.0},
        np.zeros(3),
        0.01 * np.eye(3),
        np.full(3, 0.1),
        np.zeros(4),
        5,
        0.0,
        1.0,
        "stable",
        cloud_world=cloud,
    )


def test_clouds_are_saved_and_loaded(tmp_path):
    made = Map([landmark(3, 50), landmark(7, 0)])
    made.save(tmp_path)
    loaded = Map.load(tmp_path)
    np.testing.assert_allclose(loaded.landmark(3).cloud_world, made.landmark(3).cloud_world, atol=1e-6)
    assert loaded.landmark(7).cloud_world.shape == (0, 3)


def test_a_map_without_clouds_has_no_such_file_and_keeps_none_of_an_older_one(tmp_path):
    without = Map([landmark(7, 0)])
    without.save(tmp_path)
    assert not (tmp_path / "clouds.ply").exists()
    Map([replace(landmark(7, 30), id=7)]).save(tmp_path)
    without.save(tmp_path)
    assert not len(Map.load(tmp_path).landmark(7).cloud_world)


def test_a_damaged_file_of_clouds_is_named(tmp_path):
    Map([landmark(3, 50)]).save(tmp_path)
    path = tmp_path / "clouds.ply"
    path.write_bytes(path.read_bytes()[:-7])
    with pytest.raises(MapFormatError, match=r"clouds\.ply"):
        Map.load(tmp_path)


def test_the_points_of_a_map_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        Map([landmark(3, 50)]).landmark(3).cloud_world[0] = 0.0


def test_what_has_looks_but_no_word_can_be_found(tmp_path):
    class Embedder:
        name, size = "four", 4

        def embed_text(self, texts):
            return np.tile([1.0, 0.0, 0.0, 0.0], (len(texts), 1))

    seen = replace(landmark(3, 10), label="", labels={}, embedding=np.array([1.0, 0.0, 0.0, 0.0]))
    (hit,) = Map([seen], embedder="four").query("cup", embedder=Embedder())
    assert hit.landmark.id == 3
    assert hit.score == pytest.approx(1.0)
