"""Eq 1: what the picture and what the word give to a feature."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.errors import ConfigError, FrameError
from seo_slam.perception.features import ObservationFeatures, crops
from seo_slam.settings.observing import FeatureSettings
from seo_slam.testing.worlds import tiny_frames

FRAME = tiny_frames(1)[0]
BOXES = np.array([[5.0, 5.0, 30.0, 40.0], [40.0, 10.0, 60.0, 30.0], [1.5, 2.0, 9.5, 11.0]])
WORDS = HashedEmbedder(64)


class Sees(HashedEmbedder):
    """An image embedder whose vector of a picture is told by its size."""

    def __init__(self):
        super().__init__(64)
        self.seen = []

    def embed_image(self, images):
        self.seen += [image.shape for image in images]
        return self.embed_text([str(image.shape) for image in images])


class SeesCrops:
    """A crop embedder that gives every box the vector of "picture"."""

    def embed_crops(self, frame, boxes_px):
        return WORDS.embed_text(["picture"] * len(boxes_px))


def unit(row):
    return row / np.linalg.norm(row)


def test_without_pictures_the_rows_are_the_embedders():
    labels = ("cup", None, "brown shoe")
    features, warnings = ObservationFeatures(FeatureSettings(), WORDS).of(FRAME, BOXES, labels)
    assert warnings == ()
    assert np.array_equal(features[[0, 2]], WORDS.embed_text(["cup", "brown shoe"]))
    assert not features[1].any()


@given(image=st.floats(0.05, 1.0), text=st.floats(0.0, 1.0))
def test_equation_1(image, text):
    features, _ = ObservationFeatures(FeatureSettings(image_weight=image, text_weight=text), WORDS, SeesCrops()).of(
        FRAME, BOXES, ("cup", None, "shoe")
    )
    picture, cup, shoe = WORDS.embed_text(["picture", "cup", "shoe"])
    assert np.allclose(features, [unit(image * picture + text * cup), picture, unit(image * picture + text * shoe)])
    assert np.allclose(np.linalg.norm(features, axis=1), 1.0)


def test_what_has_no_word_gets_the_mean_of_known_words():
    settings = FeatureSettings(image_weight=0.7, text_weight=0.3, null_text=True, classes=("cup", "shoe"))
    features, _ = ObservationFeatures(settings, WORDS, SeesCrops()).of(FRAME, BOXES, (None, "cup", "lamp"))
    cup, shoe, picture = WORDS.embed_text(["cup", "shoe", "picture"])
    assert np.allclose(features[0], unit(0.7 * picture + 0.3 * unit((cup + shoe) / 2.0)))


def test_without_a_class_list_known_words_are_those_said_so_far():
    made = ObservationFeatures(FeatureSettings(null_text=True), WORDS)
    first, _ = made.of(FRAME, BOXES[:1], (None,))
    assert not first.any()
    second, _ = made.of(FRAME, BOXES, ("cup", None, "cup"))
    assert np.allclose(second[1], WORDS.embed_text(["cup"])[0])
    third, _ = made.of(FRAME, BOXES[:2], ("shoe", None))
    assert np.allclose(third[1], unit(WORDS.embed_text(["cup", "shoe"]).mean(axis=0)))


def test_text_only_is_said_once_a_run():
    made = ObservationFeatures(FeatureSettings(image_weight=0.7, text_weight=0.3), WORDS)
    features, warnings = made.of(FRAME, BOXES, ("cup", "lamp", "shoe"))
    assert len(warnings) == 1
    assert "words only" in warnings[0]
    assert "'hashed'" in warnings[0]
    assert np.array_equal(features[0], WORDS.embed_text(["cup"])[0])
    assert made.of(FRAME, BOXES, ("cup", "lamp", "shoe"))[1] == ()


def test_things_without_any_feature_are_told_of_once_a_run():
    made = ObservationFeatures(FeatureSettings(image_weight=0.7, text_weight=0.3, null_text=True), WORDS)
    features, warnings = made.of(FRAME, BOXES, (None,) * 3)
    assert not features.any()
    assert len(warnings) == 2
    assert "features.classes" in warnings[1]
    assert "image encoder" in warnings[1]
    assert made.of(FRAME, BOXES, (None,) * 3)[1] == ()


@pytest.mark.parametrize(
    ("settings", "encoder"),
    [
        ({"image_weight": 0.7, "null_text": True, "classes": ("cup",)}, None),
        ({"image_weight": 0.7, "null_text": True}, SeesCrops()),
        ({}, None),  # words are all that is asked for
    ],
)
def test_nobody_is_told_of_a_missing_feature_where_there_is_one_or_none_is_wanted(settings, encoder):
    _, warnings = ObservationFeatures(FeatureSettings(**settings), WORDS, encoder).of(FRAME, BOXES, (None,) * 3)
    assert not any("have no feature" in warning for warning in warnings)


def test_nothing_seen_warns_of_nothing():
    features, warnings = ObservationFeatures(FeatureSettings(image_weight=1.0), WORDS).of(FRAME, np.zeros((0, 4)), ())
    assert features.shape == (0, 64)
    assert warnings == ()


def test_an_embedder_that_sees_is_shown_crops_with_a_margin():
    sees = Sees()
    settings = FeatureSettings(image_weight=1.0, text_weight=0.0, crop_margin_px=3)
    features, _ = ObservationFeatures(settings, sees).of(FRAME, BOXES, (None,) * 3)
    assert sees.seen == [(41, 31, 3), (26, 26, 3), (14, 13, 3)]
    assert np.allclose(features, sees.embed_text([str(shape) for shape in sees.seen]))


def test_the_detectors_own_embeddings_come_first_and_rows_of_zeros_are_asked_for():
    sees = Sees()
    own = np.zeros((3, 64))
    own[1] = 4.0 * WORDS.embed_text(["theirs"])[0]
    settings = FeatureSettings(image_weight=1.0, text_weight=0.0)
    features, _ = ObservationFeatures(settings, sees).of(FRAME, BOXES, (None,) * 3, own)
    assert len(sees.seen) == 2
    assert np.allclose(features[1], WORDS.embed_text(["theirs"])[0])
    blind, warnings = ObservationFeatures(settings, WORDS).of(FRAME, BOXES, (None,) * 3, own)
    (warning,) = warnings
    assert "have no feature" in warning
    assert np.allclose(blind, [np.zeros(64), features[1], np.zeros(64)])


def test_crops_end_at_the_image():
    rgb = np.arange(20 * 30 * 3, dtype=np.uint8).reshape(20, 30, 3)
    (crop,) = crops(rgb, np.array([[25.5, 0.0, 30.0, 4.2]]), 2)
    assert np.array_equal(crop, rgb[0:7, 23:30])


def test_bad_input_is_named():
    with pytest.raises(ConfigError, match="both 0"):
        ObservationFeatures(FeatureSettings(image_weight=0, text_weight=0), WORDS)
    with pytest.raises(ConfigError, match="image_encoder is a int"):
        ObservationFeatures(FeatureSettings(), WORDS, 3)
    made = ObservationFeatures(FeatureSettings(image_weight=0.5), WORDS)
    with pytest.raises(FrameError, match=r"frame 0.*3 boxes, 1 labels"):
        made.of(FRAME, BOXES, ("cup",))
    with pytest.raises(FrameError, match=r"frame 0.*\(3, 512\).*64"):
        made.of(FRAME, BOXES, (None,) * 3, np.ones((3, 512)))
