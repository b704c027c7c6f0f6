import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from local_scenes import BOX, CAMERA, evidence, landmark, put, surface_of, view_of, wall

from seo_slam.agents.colour_words import colour_name, colour_words, colours_of
from seo_slam.agents.crop_classifier import CropClassifier, EmbeddingClassifier, crop_of
from seo_slam.agents.local_description import SETTLED, LocalDescription
from seo_slam.agents.size_words import size_word
from seo_slam.agents.word_choice import plain_word, word_doubted
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.errors import ConfigError
from seo_slam.interfaces import ImageEmbedder
from seo_slam.records import Confirm, Relabel
from seo_slam.registry import create
from seo_slam.testing import check_agent
from seo_slam.types import Frame

SYNONYMS = ({"cup", "mug", "teacup"}, {"shoe", "sneaker"})
PAINTS = {
    "red": (180, 30, 30),
    "green": (40, 140, 50),
    "blue": (40, 60, 170),
    "yellow": (225, 200, 40),
    "orange": (235, 130, 30),
    "purple": (130, 40, 150),
    "pink": (240, 160, 175),
    "brown": (100, 65, 35),
    "black": (20, 20, 20),
    "grey": (128, 128, 128),
    "white": (240, 240, 240),
    "beige": (222, 205, 175),
}


class Folding(LabelLikelihood):
    """Knows a few synonyms."""

    def between(self, a, b):
        (x,), (y,) = a, b
        return 3.0 if any({x, y} <= group for group in SYNONYMS) else -1.0


def coloured(rgb, light=1.0):
    scene, depth_m = wall()
    scene[:60] = 250  # something white
    image, depth_m = put(scene, depth_m, colour=rgb, nearer_m=0.1)
    return np.clip(image * light, 0, 255).astype(np.uint8), depth_m


def surface_px(depth_m):
    points = surface_of(depth_m)
    u, v = np.meshgrid(np.linspace(BOX[0] + 4, BOX[2] - 4, 8), np.linspace(BOX[1] + 4, BOX[3] - 4, 8))
    return np.column_stack([u.ravel(), v.ravel(), points[:, 2]])


@pytest.mark.parametrize("light", [1.0, 0.75])
@pytest.mark.parametrize("name", PAINTS)
def test_colours_have_their_names_in_bright_and_dim_light(name, light):
    rgb, depth_m = coloured(PAINTS[name], light)
    assert colour_words(colours_of(Frame(0.0, rgb, depth_m, CAMERA), surface_px(depth_m))) == name


@given(st.floats(0, 130), st.floats(-128, 128), st.floats(-128, 128))
def test_every_colour_has_a_name(lightness, a, b):
    assert colour_name(lightness, a, b) in PAINTS


def test_two_colours_and_many():
    assert colour_words({"white": 0.5, "black": 0.4, "red": 0.1}) == "black and white"
    assert colour_words({"white": 0.3, "black": 0.3, "red": 0.2, "blue": 0.2}) == ""
    assert colour_words({}) == ""


def test_sizes_only_tell_apart():
    assert size_word(0.3, []) == ""
    assert size_word(0.3, [0.3, 0.28]) == ""
    assert size_word(0.5, [0.2, 0.25]) == "large"
    assert size_word(0.1, [0.2, 0.25]) == "small"


def test_words_of_one_meaning_count_together():
    votes = {"bowl": 7.0, "teacup": 5.4, "cup": 4.5}
    assert plain_word(votes, {}, None) == "bowl"
    assert plain_word(votes, {}, Folding()) == "teacup"
    assert plain_word({"mug": 5.0, "cup": 6.0}, {"mug": 2}, Folding()) == "mug"
    assert plain_word({"mug": 1.0, "cup": 6.0}, {"mug": 2}, Folding()) == "cup"
    assert plain_word({}, {}, Folding()) == ""


@given(st.dictionaries(st.sampled_from(["cup", "mug", "bowl", "shoe", "sneaker", "box"]), st.floats(0.1, 20), min_size=1))
def test_the_word_is_one_that_was_said_and_nothing_changes_it_without_synonyms(votes):
    assert plain_word(votes, {}, Folding()) in votes
    assert votes[plain_word(votes, {}, LabelLikelihood())] == max(votes.values())


def described(rgb, depth_m, agent=None, rows=None, weights=None, labels=()):
    given = {1: evidence(surface_of(depth_m), weights or {"cup": 5.0})}
    rows = rows or [landmark(1, "cup")]
    view = view_of(rgb, depth_m, rows=rows, boxes={1: BOX}, evidences=given, labels=labels)
    (edit,) = (agent or LocalDescription(Folding())).propose(view)
    return edit


def test_a_label_has_colour_and_category():
    edit = described(*coloured(PAINTS["red"]))
    assert (edit.label, edit.category) == ("red cup", "cup")


def test_what_has_its_label_is_confirmed():
    assert isinstance(described(*coloured(PAINTS["red"]), rows=[landmark(1, "red cup", category="cup")]), Confirm)


def test_what_was_seen_too_seldom_to_have_a_word_is_not_described():
    seldom = view_of(*coloured(PAINTS["red"]), rows=[landmark(1, "cup", observations=SETTLED - 1)], boxes={1: BOX})
    assert LocalDescription(Folding()).propose(seldom) == []


def test_a_known_label_is_used_again_where_it_fits():
    rgb, depth_m = coloured(PAINTS["red"])
    x0, y0, x1, y1 = BOX.astype(int)
    rgb[y0 : (y0 + y1) // 2, x0:x1] = PAINTS["blue"]
    assert described(rgb, depth_m).label == "blue and red cup"
    assert described(rgb, depth_m, labels=("red cup",)).label == "red cup"
    assert described(rgb, depth_m, labels=("green cup",)).label == "blue and red cup"


def test_size_tells_alike_ones_apart():
    rows = [landmark(1, "cup", size_m=(0.3, 0.3, 0.3)), landmark(2, "red cup", size_m=(0.1, 0.1, 0.1), category="cup")]
    assert described(*coloured(PAINTS["red"]), rows=rows).label == "large red cup"


class Says:
    """An image model."""

    def classify(self, rgb, words):
        assert rgb.ndim == 3
        assert "cup" in words
        return {"vase": 1.0}


def test_a_classifier_votes_beside_the_detector():
    agent = LocalDescription(Folding(), classifier=Says())
    assert described(*coloured(PAINTS["red"]), agent, weights={"cup": 5.0, "vase": 4.0}).category == "vase"
    assert described(*coloured(PAINTS["red"]), agent, weights={"cup": 5.0}).category == "cup"
    assert isinstance(Says(), CropClassifier)


class Vectors:
    """An ``ImageEmbedder`` in which every picture is a vase."""

    name, size = "vectors", 2

    def embed_image(self, images):
        assert [image.ndim for image in images] == [3]
        return np.array([[0.0, 1.0]])

    def embed_text(self, texts):
        return np.array([[0.0, 1.0] if "vase" in text else [1.0, 0.0] for text in texts])


def test_an_image_text_embedder_is_a_classifier():
    scores = EmbeddingClassifier(Vectors()).classify(np.zeros((4, 4, 3), np.uint8), ["cup", "vase"])
    assert scores["vase"] > 0.99
    assert sum(scores.values()) == pytest.approx(1.0)
    assert isinstance(Vectors(), ImageEmbedder)
    assert EmbeddingClassifier(Vectors()).classify(np.zeros((4, 4, 3), np.uint8), []) == {}


def test_a_classifier_is_named_or_refused():
    with pytest.raises(ConfigError, match="cannot be made"):
        LocalDescription(classifier="no.such:thing")
    with pytest.raises(ConfigError, match="has no classify"):
        LocalDescription(classifier="builtins:dict")


def test_crops_are_within_the_image():
    view = view_of(*wall(), boxes={1: np.array([300.0, 220.0, 320.0, 240.0])})
    assert crop_of(1, view).shape[0] >= 20


def test_a_word_is_doubted_only_if_another_leads_clearly():
    _, depth_m = wall()
    surface = surface_of(depth_m)

    def doubted(weights):
        rows = [landmark(1, "red cup", category="cup")]
        return word_doubted(1, view_of(*wall(), rows=rows, evidences={1: evidence(surface, weights)}), {}, None)

    assert doubted({"cup": 5.0, "vase": 8.0}) == "vase"
    assert doubted({"cup": 5.0, "vase": 5.2}) == ""
    assert doubted({"cup": 5.0}) == ""


def test_contract():
    check_agent(create("agent", "local_description"))
    assert isinstance(described(*coloured(PAINTS["red"])), Relabel)
