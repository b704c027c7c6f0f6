"""How a map's features were made goes with the map."""

import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor
from seo_slam.abstraction.updating import updated
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import MapFormatError
from seo_slam.map import Map
from seo_slam.map_document import map_json_schema
from seo_slam.perception.features import ObservationFeatures
from seo_slam.records import FeatureRecipe
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.settings.observing import FeatureSettings
from seo_slam.testing.store import make_landmark
from seo_slam.testing.worlds import tiny_frames

PICTURES = FeatureRecipe(0.7, 0.3, "Clip:small")
WORDS = HashedEmbedder(8)


def a_map(features=PICTURES):
    desk = Anchor(1, "desk", WORDS.embed_text(["desk"])[0], np.zeros((1, 2)), 9, (0.0, 0.8), 0.8)
    return Map([make_landmark(4)], "poses", WORDS.name, features=features).with_abstract(AbstractMap((desk,), embedder=WORDS.name))


def test_it_comes_back_and_the_abstract_map_knows_it(tmp_path):
    a_map().save(tmp_path)
    loaded = Map.load(tmp_path)
    assert loaded.features == loaded.abstract.features == PICTURES
    assert loaded.to_json() == (tmp_path / "map.json").read_bytes()
    written = json.loads(loaded.to_json())
    assert written["features"] == {"image_weight": 0.7, "text_weight": 0.3, "image_encoder": "Clip:small"}
    assert list(jsonschema.Draft202012Validator(map_json_schema()).iter_errors(written)) == []


def test_a_map_that_does_not_say_it_has_the_bytes_it_always_had(tmp_path):
    plain = a_map(None)
    assert "features" not in json.loads(plain.to_json())
    plain.save(tmp_path)
    assert Map.load(tmp_path).features is None


def test_what_is_no_recipe_is_refused(tmp_path):
    a_map().save(tmp_path)
    file = tmp_path / "map.json"
    file.write_text(file.read_text().replace('"text_weight": 0.3', '"text_weight": -0.3'))
    with pytest.raises(MapFormatError, match=r"features\.text_weight"):
        Map.load(tmp_path)


def test_features_made_anew_for_another_embedder_are_of_words():
    again = a_map().with_embeddings(Looks(8))
    assert again.features.in_words == again.abstract.features.in_words == "words only"
    assert a_map().with_embeddings(WORDS).features == PICTURES
    shorter = a_map().with_embeddings(WORDS).with_embeddings(HashedEmbedder(16))
    assert shorter.features.in_words == shorter.abstract.features.in_words == "words only"


def test_an_update_keeps_what_the_old_anchors_are_made_of():
    old, new = a_map().abstract, replace(a_map().abstract, features=FeatureRecipe(0.7, 0.3))
    assert updated(old, new, AbstractionSettings()).features == PICTURES
    assert updated(AbstractMap(()), new, AbstractionSettings()).features == new.features


def test_recipes_in_words():
    assert PICTURES.in_words == "0.7 pictures (Clip:small) and 0.3 words"
    assert FeatureRecipe(0.7, 0.3).in_words == FeatureRecipe(0.0, 1.0, "Clip:small").in_words == "words only"


class Looks(HashedEmbedder):
    """Looks at pictures."""

    name = "looks"

    def embed_crops(self, frame, boxes_px):
        return self.embed_text(["picture"] * len(boxes_px))


def test_features_say_how_they_are_made():
    both, own = FeatureSettings(image_weight=0.7, text_weight=0.3), np.zeros((1, 8))
    assert ObservationFeatures(both, Looks(8)).recipe == FeatureRecipe(0.7, 0.3, "Looks:looks")
    assert not ObservationFeatures(FeatureSettings(), Looks(8)).recipe.has_pictures
    features, frame, box = ObservationFeatures(both, WORDS), tiny_frames(1)[0], np.array([[5.0, 5.0, 30.0, 40.0]])
    features.of(frame, box, ("cup",), own)
    assert features.recipe == FeatureRecipe(0.7, 0.3)
    features.of(frame, box, ("cup",), own + 1.0)
    assert features.recipe == FeatureRecipe(0.7, 0.3, "detector")
