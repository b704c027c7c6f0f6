"""What stands in the six rooms of SEO-SLAM, Table I, and which words are right for it."""

import difflib

from seo_slam.errors import ConfigError

ROOMS = ("SM1", "SM2", "MD1", "MD2", "LG1", "LG2")
"""Names of the rooms: small (about 10 objects), medium (about 20) and large (about 30)."""

# As the table lists them: a label and how often. The listings add up to the numbers in its headings.
INVENTORIES: dict[str, dict[str, int]] = {
    "SM1": {
        "bag": 1,
        "banana": 1,
        "book": 1,
        "chair": 1,
        "fan": 1,
        "flower": 1,
        "helmet": 1,
        "scissors": 1,
        "shoe": 1,
        "racquet": 1,
        "vase": 1,
    },
    "SM2": {
        "banana": 1,
        "bin": 1,
        "book": 1,
        "chair": 1,
        "fan": 1,
        "flower": 1,
        "football": 1,
        "scissors": 1,
        "snowman": 1,
        "teacup": 1,
        "vase": 1,
    },
    "MD1": {
        "bag": 2,
        "banana": 2,
        "book": 2,
        "bottle": 2,
        "chair": 2,
        "fan": 2,
        "flower": 1,
        "helmet": 1,
        "racquet": 1,
        "scissors": 1,
        "shoe": 2,
        "snowman": 1,
        "toy car": 1,
        "vase": 1,
    },
    "MD2": {
        "banana": 2,
        "bin": 2,
        "book": 2,
        "chair": 2,
        "cup": 1,
        "fan": 1,
        "flower": 1,
        "football": 1,
        "helmet": 1,
        "scissors": 1,
        "shoe": 1,
        "snowman": 1,
        "teacup": 2,
        "racquet": 1,
        "vase": 1,
    },
    "LG1": {
        "bag": 1,
        "banana": 3,
        "bin": 3,
        "book": 3,
        "bottle": 2,
        "chair": 3,
        "cup": 1,
        "fan": 1,
        "flower": 1,
        "football": 1,
        "helmet": 1,
        "monitor": 3,
        "electric outlet": 1,
        "racquet": 1,
        "scissors": 1,
        "shoe": 2,
        "snowman": 1,
        "teacup": 2,
        "vase": 1,
    },
    "LG2": {
        "apple": 2,
        "bag": 1,
        "banana": 3,
        "bin": 2,
        "book": 1,
        "bowl": 1,
        "chair": 2,
        "Cheez-It box": 2,
        "electric outlet": 1,
        "fan": 1,
        "flower": 1,
        "football": 2,
        "hammer": 2,
        "helmet": 1,
        "racquet": 1,
        "scissors": 1,
        "shoe": 3,
        "teacup": 1,
        "vase": 1,
    },
}

# Synonyms that hold for every model of a label. Words for one model only (mug, backpack, sneaker, …) stand with the model.
SYNONYMS: dict[str, tuple[str, ...]] = {
    "Cheez-It box": ("cheez-it", "cracker box"),
    "bin": ("trash can", "waste bin"),
    "electric outlet": ("power outlet", "socket"),
    "fan": ("electric fan",),
    "football": ("soccer ball",),
    "monitor": ("screen",),
    "racquet": ("racket",),
    "shoe": ("shoes",),
}


def inventory(room: str) -> dict[str, int]:
    """Return label -> how many of it stand in a room.

    Raises:
        ConfigError: no such room.
    """
    if room not in INVENTORIES:
        near = difflib.get_close_matches(str(room).upper(), ROOMS, n=1, cutoff=0.0)
        raise ConfigError(f"room: got {room!r}, wanted one of {', '.join(ROOMS)}; did you mean {near[0]!r}?")
    return INVENTORIES[room]
