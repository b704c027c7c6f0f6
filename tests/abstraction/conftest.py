import pytest
from boxes_of_points import WordEmbedder

from seo_slam.settings.abstraction import AbstractionSettings

NAMES = {
    "static_names": ("table", "chair", "shelf", "wardrobe"),
    "movable_names": ("cup", "book", "shoe"),
    "static_phrases": ("furniture",),
    "movable_phrases": ("portable",),
}


@pytest.fixture
def embedder():
    return WordEmbedder()


@pytest.fixture
def settings():
    return AbstractionSettings(**NAMES)
