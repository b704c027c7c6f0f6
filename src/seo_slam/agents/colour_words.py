"""Names of colours, from the pixels of a thing's own surface."""

from collections import Counter

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.types import Frame

WHITE_QUANTILE = 0.95
"""This part of the image is taken to be darker than something white in its light."""

LEAST_WHITE = 60.0
"""A darker image is a dark scene, not a dimly lit bright one."""

MAIN_SHARE = 0.5
"""A thing has a colour if it is that of half of it …"""

TWO_SHARE, SECOND_SHARE = 0.75, 0.3
"""… or two, if they are that of most of it, and neither is a detail."""

NEAR_M = 0.04
"""A surface point is seen where the image's depth is this near to its own."""

LEAST_POINTS = 12

_HUES = ((20.0, "red"), (75.0, "orange"), (105.0, "yellow"), (190.0, "green"), (310.0, "blue"), (340.0, "purple"), (361.0, "red"))
"""Hue in CIE L*a*b*, degrees, up to which each name goes."""


def colours_of(frame: Frame, surface_px: FloatArray) -> dict[str, float]:
    """Return colour name -> share of a thing's surface that is seen, the most frequent first; empty if too little is seen.

    Lightness is taken relative to the brightest part of the image, so that a white cup in a dim room is white.

    Args:
        frame: colour and depth.
        surface_px: (M, 3) points of the surface: pixel column, row, and depth in metres.
    """
    height, width = frame.depth_m.shape
    at = np.round(surface_px[:, :2])
    within = np.asarray(((at >= 0) & (at < [width, height])).all(axis=1))
    column, row = np.where(within[:, None], at, 0.0).astype(np.int64).T
    depth = frame.depth_m[row, column]
    seen = within & (depth > 0) & (np.abs(depth - surface_px[:, 2]) <= NEAR_M)
    if seen.sum() < LEAST_POINTS:
        return {}
    lab = _lab(frame.rgb[row[seen], column[seen]][None])[0].astype(np.float64)
    white = max(float(np.quantile(_lab(np.ascontiguousarray(frame.rgb[::16, ::16]))[..., 0], WHITE_QUANTILE)), LEAST_WHITE)
    counts = Counter(colour_name(light * 100.0 / white, a, b) for light, a, b in lab.tolist())
    total = sum(counts.values())
    return {name: number / total for name, number in sorted(counts.items(), key=lambda item: (-item[1], item[0]))}


def colour_words(shares: dict[str, float]) -> str:
    """Return the colour of a thing in words: "red", "black and white"; "" if it has no main colour."""
    ranked = list(shares.items())
    if len(ranked) > 1 and ranked[1][1] >= SECOND_SHARE and ranked[0][1] + ranked[1][1] >= TWO_SHARE:
        return " and ".join(sorted((ranked[0][0], ranked[1][0])))
    return ranked[0][0] if ranked and ranked[0][1] >= MAIN_SHARE else ""


def colour_name(lightness: float, a: float, b: float) -> str:
    """Return the name of a colour in CIE L*a*b*, lightness from 0 to 100 where 100 is white in this light."""
    chroma, hue = float(np.hypot(a, b)), float(np.degrees(np.arctan2(b, a)) % 360.0)
    if lightness < 18.0 or (chroma < 10.0 and lightness < 32.0):
        return "black"
    if chroma < 10.0:
        return "white" if lightness >= 78.0 else "grey"
    if 20.0 <= hue < 100.0:
        if chroma < 28.0:
            return "beige" if lightness >= 65.0 else "brown"
        if lightness < 50.0 and hue >= 35.0:
            return "brown"
    name = next(name for end, name in _HUES if hue < end)
    pale_red = name == "red" and lightness >= 65.0 and chroma < 50.0
    return "pink" if pale_red else ("red" if name == "orange" and hue < 45.0 and lightness < 58.0 else name)


def _lab(rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.asarray(cv2.cvtColor(rgb.astype(np.float32) * np.float32(1.0 / 255.0), cv2.COLOR_RGB2Lab), dtype=np.float32)
