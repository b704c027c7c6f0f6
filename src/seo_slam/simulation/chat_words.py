"""Words of the simulated vision-language model: when a label names a thing, what it calls a thing, and what it takes it for."""

import re
from collections.abc import Mapping

import numpy as np

from seo_slam.simulation.labels import PHANTOM_LABELS
from seo_slam.simulation.world import Thing, World

NOT_TOLD = "N/A"
_COLOURLESS = ("", "black", "white", "grey")


def names(label: str, thing: Thing) -> bool:
    """Return whether a label is one of a thing's accepted labels, or has one in it as whole words: "yellow banana"."""
    words = f" {_words(label)} "
    return any(f" {accepted} " in words for accepted in map(_words, (thing.label, *thing.accepted_labels)) if accepted)


def described(thing: Thing, colour: str) -> str:
    """Return what the model calls a thing: colour and label; for black, white and grey ones also a striking shape."""
    shape = _shape(thing) if colour in _COLOURLESS else ""
    return " ".join(word for word in (shape, colour, thing.label) if word)


def look_alike(thing: Thing, world: World, look_alikes: Mapping[str, tuple[str, ...]], draws: np.random.Generator) -> str:
    """Return a label that is wrong for a thing: a look-alike's, or of another thing in the world, or of nothing."""
    alike = look_alikes.get(thing.label.casefold(), ())
    others = tuple(sorted({other.label for other in world.things}))
    for labels in (alike, others, PHANTOM_LABELS):
        wrong = [label for label in labels if not names(label, thing)]
        if wrong:
            return str(draws.choice(wrong))
    return "object"


def _words(text: str) -> str:
    return " ".join(re.findall(r"\w+", text.casefold().replace("_", " ")))


def _shape(thing: Thing) -> str:
    low, high = thing.bounds_thing
    x, y, z = (high - low).tolist()
    if z > 2.0 * max(x, y):
        return "tall"
    if z < 0.3 * min(x, y):
        return "flat"
    return "long" if max(x, y) > 3.0 * max(min(x, y), z) else ""
