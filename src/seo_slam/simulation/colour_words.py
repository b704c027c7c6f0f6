"""Names of colours, as people would say them."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from seo_slam.types import IntArray

COLOURS = ("black", "white", "grey", "red", "orange", "brown", "yellow", "green", "blue", "purple", "pink")
"""Every word that is used."""

_HUE_ENDS_DEG = (15.0, 42.0, 70.0, 170.0, 260.0, 295.0, 345.0, 360.0)
_HUE_WORDS = ("red", "orange", "yellow", "green", "blue", "purple", "pink", "red")
_MIXED_BELOW = 0.3  # share of the pixels below which even the commonest colour does not stand for a thing


def colour_indices(rgb: NDArray[np.uint8]) -> IntArray:
    """Return (N,) the index in ``COLOURS`` of the colour of each pixel (N, 3)."""
    value = rgb.max(axis=1) / 255.0
    chroma = value - rgb.min(axis=1) / 255.0
    hue_deg = _hue_deg(rgb.astype(np.float64) / 255.0, value, chroma)
    words = np.array([COLOURS.index(word) for word in _HUE_WORDS])
    found = words[np.searchsorted(_HUE_ENDS_DEG[:-1], hue_deg, side="right")]
    warm = (hue_deg < 50.0) & (value < 0.55)
    found[warm & (hue_deg >= 12.0)] = COLOURS.index("brown")
    found[(chroma < 0.1) | (chroma < 0.18 * value)] = COLOURS.index("grey")
    found[(chroma < 0.12) & (value > 0.78)] = COLOURS.index("white")
    found[value < 0.17] = COLOURS.index("black")
    return np.asarray(found, dtype=np.int64)


@cache
def _table() -> NDArray[np.uint8]:
    """Index of the colour of each of 32 x 32 x 32 shades: a look-up is much quicker than the arithmetic."""
    shades = np.arange(32, dtype=np.uint8) * 8 + 4
    rgb = np.stack(np.meshgrid(shades, shades, shades, indexing="ij"), axis=-1).reshape(-1, 3)
    return colour_indices(rgb).astype(np.uint8)


def colours_of_things(rgb: NDArray[np.uint8], instance_ids: NDArray[np.int32]) -> dict[int, str]:
    """Return id -> the colour that most of its pixels have, or "colourful", for every id above 0 in an image (H, W)."""
    here = instance_ids > 0
    ids = instance_ids[here]
    if not len(ids):
        return {}
    red, green, blue = (rgb[here] >> 3).astype(np.intp).T
    words = _table()[(red * 32 + green) * 32 + blue]
    counts = np.bincount(ids * len(COLOURS) + words, minlength=(int(ids.max()) + 1) * len(COLOURS))
    counts = counts.reshape(-1, len(COLOURS))
    totals, most = counts.sum(axis=1), counts.max(axis=1)
    return {
        int(k): COLOURS[int(counts[k].argmax())] if most[k] >= _MIXED_BELOW * totals[k] else "colourful" for k in np.flatnonzero(totals)
    }


def _hue_deg(rgb: NDArray[np.float64], value: NDArray[np.float64], chroma: NDArray[np.float64]) -> NDArray[np.float64]:
    red, green, blue = rgb.T
    safe = np.where(chroma > 0, chroma, 1.0)
    sixths = np.select(
        [value == red, value == green],
        [(green - blue) / safe % 6.0, (blue - red) / safe + 2.0],
        (red - green) / safe + 4.0,
    )
    return np.asarray(60.0 * sixths % 360.0)
