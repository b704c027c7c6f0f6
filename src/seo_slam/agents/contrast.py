"""Does something stand out in colour against what is around a box?"""

import cv2
import numpy as np

from seo_slam.agents.local_patch import Patch

SAMPLES = 100
"""Cells around a box whose colours are known to be around it, at most about twice as many."""

LEAST_SAMPLES = 20

LIGHTNESS = 0.6
"""Lightness counts less than hue: light and shadow fall unevenly on one surface."""

LEAST_UNLIKE = 3.0
"""Distance in CIE L*a*b* that noise and compression make."""

UNLIKE_TIMES = 1.5
"""A colour is another one if it is farther from all those around than so many times what those usually are from each other …"""

USUAL = 0.95
"""… where this share of them is nearer than that."""


def colour_contrast(patch: Patch) -> float | None:
    """Return the share of a box whose colour is found nowhere around it; None if too little of its surroundings is in the image.

    Surfaces with a pattern have many colours; what counts is how much farther a colour is from the nearest one around than those
    are from each other, which is how patterned the surroundings are.
    """
    row, column = np.nonzero(patch.outside)
    if len(row) < LEAST_SAMPLES or not patch.inside.any():
        return None
    lab = cv2.blur(patch.lab, (3, 3)) * np.array([LIGHTNESS, 1.0, 1.0], dtype=np.float32)
    step = max(len(row) // SAMPLES, 1)
    around, inside = lab[row[::step], column[::step]], lab[patch.inside]
    to_itself = _squared_distances(around, around)
    np.fill_diagonal(to_itself, np.inf)
    usual = np.sort(to_itself.min(axis=1))[int(USUAL * (len(around) - 1))]
    limit = max(UNLIKE_TIMES**2 * float(usual), LEAST_UNLIKE**2)
    return float((_squared_distances(inside, around).min(axis=1) > limit).mean())


def _squared_distances(a: np.typing.NDArray[np.float32], b: np.typing.NDArray[np.float32]) -> np.typing.NDArray[np.float32]:
    return np.asarray((a * a).sum(axis=1)[:, None] - 2.0 * (a @ b.T) + (b * b).sum(axis=1), dtype=np.float32)
