"""The default lists with the MiniLM embedder, on words that are in none of them."""

import numpy as np
import pytest

from seo_slam import registry
from seo_slam.abstraction.anchors import Mobility, words_of
from seo_slam.settings.abstraction import AbstractionSettings

STATIC = (
    "ottoman", "bunk bed", "mattress", "recliner", "loveseat", "pantry cabinet", "vanity", "console table", "hutch", "display case",
    "freezer", "range hood", "microwave oven", "clothes dryer", "water heater", "urinal", "banister", "blackboard", "projector screen",
    "podium", "locker", "coat rack", "shoe rack", "wine rack", "aquarium", "grandfather clock", "treadmill", "vending machine",
    "reception desk", "trundle bed",
)  # fmt: skip
MOVABLE = (
    "spatula", "ladle", "thermos", "lunchbox", "sandwich", "cookie", "pear", "potato", "carrot", "envelope", "postcard", "ruler",
    "calculator", "flashlight", "wrench", "pliers", "earbuds", "mouse pad", "joystick", "playing cards", "dice", "frisbee", "sock",
    "scarf", "glove", "purse", "lotion", "comb", "razor", "hairdryer",
)  # fmt: skip


@pytest.fixture(scope="module")
def minilm():
    model = registry.create("embedder", "minilm")
    model.embed_text(["loads the model"])
    return model


def test_few_unknown_words_are_decided_wrongly_and_size_decides_the_rest(minilm):
    settings = AbstractionSettings()
    assert not {words_of(name) for name in (*settings.static_names, *settings.movable_names)} & {words_of(w) for w in STATIC + MOVABLE}
    mobility = Mobility(minilm, settings)
    right = sum(mobility.of_word(word) == 1 for word in STATIC) + sum(mobility.of_word(word) == -1 for word in MOVABLE)
    assert right >= 51
    nothing = np.zeros(minilm.size)
    right = sum(mobility.of_landmark({word: 1.0}, nothing, large=word in STATIC) == (word in STATIC) for word in STATIC + MOVABLE)
    assert right >= 57


def test_prototypes_are_better_than_one_template(minilm):
    def wrong(settings):
        mobility = Mobility(minilm, settings)
        return sum(mobility.of_word(word) == -1 for word in STATIC) + sum(mobility.of_word(word) == 1 for word in MOVABLE)

    assert wrong(AbstractionSettings()) < wrong(AbstractionSettings(anchor_rule="template"))
