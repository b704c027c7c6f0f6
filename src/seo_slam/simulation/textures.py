"""Painted surfaces: small images that repeat over a shape, each with ever more blurred copies of itself.

A pixel that covers much of the surface takes its colour from a blurred copy, so that textures neither flicker nor alias when the
camera moves; that matters to visual odometry as much as to the eye.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.simulation.draws import generator

Rgb = tuple[float, float, float]
Pixels = NDArray[np.float32]
Mapping = Literal["box", "wrap"]

_SIZE = 128
_BLURS_TEXELS = (0.0, 0.8, 1.8, 3.6, 7.2, 15.0)


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """An image laid over a shape.

    Attributes:
        levels: (L, S, S, 3) float32 in 0..1, ever more blurred; they tile without a seam.
        tile_m: width and height on the surface of one repetition, metres.
        mapping: "box" looks along the axis that the normal is nearest to; "wrap" goes around z, its width being one turn.
        offset: shift of the image, in repetitions.
    """

    levels: Pixels
    tile_m: tuple[float, float]
    mapping: Mapping = "box"
    offset: tuple[float, float] = (0.0, 0.0)

    def colours(self, p_shape: FloatArray, normals: FloatArray, footprint_m: FloatArray) -> FloatArray:
        """Return (N, 3) colours in 0..1.

        Args:
            p_shape: (N, 3) points of the surface, shape frame.
            normals: (N, 3) their normals.
            footprint_m: (N,) how much of the surface a pixel covers.
        """
        count, size = self.levels.shape[:2]
        texel_m = max(self.tile_m) / size
        level = np.clip(np.round(np.log2(np.maximum(footprint_m / texel_m, 1e-6)) + 0.5), 0, count - 1).astype(np.int64)
        u, v = self.coordinates(p_shape, normals)
        x, y = u * size - 0.5, v * size - 0.5
        x0, y0 = np.floor(x), np.floor(y)
        fx, fy = (x - x0)[:, None], (y - y0)[:, None]
        i0, j0 = y0.astype(np.int64) % size, x0.astype(np.int64) % size
        i1, j1 = (i0 + 1) % size, (j0 + 1) % size
        image = self.levels
        upper = image[level, i0, j0] * (1.0 - fx) + image[level, i0, j1] * fx
        lower = image[level, i1, j0] * (1.0 - fx) + image[level, i1, j1] * fx
        return np.asarray(upper * (1.0 - fy) + lower * fy, dtype=np.float64)

    def coordinates(self, p: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return where points (N, 3) of the shape lie in the image, in repetitions: (N,) to the right and (N,) down."""
        width, height = self.tile_m
        if self.mapping == "wrap":
            u, v = np.arctan2(p[:, 1], p[:, 0]) / (2.0 * np.pi) + 0.5, 0.5 - p[:, 2] / height
        else:
            x, y, z = (np.abs(normals[:, k]) for k in range(3))
            u = np.where((x > y) & (x > z), p[:, 1], p[:, 0]) / width + 0.5
            v = 0.5 - np.where((z >= x) & (z >= y), p[:, 1], p[:, 2]) / height
        return u + self.offset[0], v + self.offset[1]


def from_image(image: Pixels, tile_m: tuple[float, float], mapping: Mapping = "box") -> Texture:
    """Return the texture of a square image (S, S, 3), values in 0..1, that repeats every ``tile_m``."""
    size = image.shape[0]
    squared = np.fft.fftfreq(size)[:, None] ** 2 + np.fft.rfftfreq(size)[None, :] ** 2
    spectrum = np.fft.rfft2(image.astype(np.float32), axes=(0, 1))
    levels = []
    for sigma in _BLURS_TEXELS:
        gauss = np.exp(-2.0 * (np.pi * sigma) ** 2 * squared)[:, :, None].astype(np.float32)
        levels.append(np.fft.irfft2(spectrum * gauss, s=(size, size), axes=(0, 1)))
    return Texture(np.clip(np.stack(levels), 0.0, 1.0).astype(np.float32), tile_m, mapping)


def noise(key: tuple[int | str, ...], stretch: tuple[float, float] = (1.0, 1.0), smoothness: float = 1.4) -> FloatArray:
    """Return a (S, S) cloud of mean 0 and standard deviation 1 that tiles: white noise with a 1/f^smoothness spectrum."""
    frequency = np.fft.fftfreq(_SIZE) * _SIZE
    radius = np.hypot(frequency[None, :] * stretch[0], frequency[:, None] * stretch[1])
    radius[0, 0] = np.inf
    white = np.fft.fft2(generator(*key, "noise").normal(size=(_SIZE, _SIZE)))
    cloud = np.fft.ifft2(white / np.maximum(radius, 2.0) ** smoothness).real
    return np.asarray((cloud - cloud.mean()) / cloud.std())


def _grid() -> tuple[FloatArray, FloatArray]:
    """Coordinates 0..1 of texel centres: u to the right, v down."""
    at = (np.arange(_SIZE) + 0.5) / _SIZE
    u, v = np.meshgrid(at, at)
    return u, v


def _shade(base: Rgb, brightness: FloatArray) -> Pixels:
    return np.clip(np.array(base)[None, None, :] * brightness[:, :, None], 0.0, 1.0).astype(np.float32)


def mottled(key: tuple[int | str, ...], base: Rgb, contrast: float = 0.12, tile_m: float = 0.25, mapping: Mapping = "box") -> Texture:
    """One colour with cloudy variation: plastic, paint, card."""
    return from_image(_shade(base, 1.0 + contrast * noise(key)), (tile_m, tile_m), mapping)


def wood(key: tuple[int | str, ...], base: Rgb, tile_m: float = 0.9) -> Texture:
    """Long grain along u with fine lines across."""
    grain = noise(key, stretch=(6.0, 0.8), smoothness=1.2)
    _, v = _grid()
    rings = np.sin(2.0 * np.pi * (9.0 * v + 0.35 * noise((*key, "bend"), stretch=(3.0, 1.0), smoothness=1.8)))
    return from_image(_shade(base, 1.0 + 0.13 * grain + 0.07 * rings), (tile_m, tile_m))


def planks(key: tuple[int | str, ...], base: Rgb, tile_m: float = 1.2, rows: int = 8) -> Texture:
    """Floor boards: wood in strips of different brightness with dark joints."""
    u, v = _grid()
    row = np.floor(v * rows).astype(np.int64)
    draws = generator(*key, "planks")
    tone, shift = draws.uniform(0.8, 1.15, rows)[row], draws.uniform(0, 1, rows)[row]
    joint = (v * rows % 1.0 < 0.09) | ((u + shift) % 1.0 < 0.012)
    grain = noise(key, stretch=(5.0, 1.0), smoothness=1.2)
    return from_image(_shade(base, np.where(joint, 0.45, tone * (1.0 + 0.12 * grain))), (tile_m, tile_m))


def wallpaper(key: tuple[int | str, ...], base: Rgb, ink: Rgb, tile_m: float = 0.48) -> Texture:
    """A faint pattern of leaves on a mottled ground; irregular, so that a matcher does not mistake one leaf for the next."""
    u, v = _grid()
    image = _shade(base, 1.0 + 0.05 * noise(key))
    draws = generator(*key, "leaves")
    for x, y, turn, length in zip(*draws.uniform(0, 1, (3, 26)), draws.uniform(0.03, 0.075, 26), strict=True):
        du, dv = (u - x + 0.5) % 1.0 - 0.5, (v - y + 0.5) % 1.0 - 0.5
        c, s = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
        leaf = ((c * du + s * dv) / length) ** 2 + ((c * dv - s * du) / (0.38 * length)) ** 2 < 1.0
        image[leaf] = 0.45 * image[leaf] + 0.55 * np.array(ink, dtype=np.float32)
    return from_image(image, (tile_m, tile_m))


def bands(
    key: tuple[int | str, ...],
    base: Rgb,
    ink: Rgb,
    height_m: float,
    rows: tuple[tuple[float, float], ...] = ((0.3, 0.7),),
    blots: int = 9,
) -> Texture:
    """Bands around a cup, a bottle or a ball, broken by blots of the ground colour. ``rows`` are from the top, as shares of the height."""
    u, v = _grid()
    image = _shade(base, 1.0 + 0.07 * noise(key))
    inked = np.zeros((_SIZE, _SIZE), dtype=np.bool_)
    for start, end in rows:
        inked |= (v >= start) & (v < end)
    for x, y in generator(*key, "blots").uniform(0, 1, (blots, 2)):
        du, dv = (u - x + 0.5) % 1.0 - 0.5, (v - y + 0.5) % 1.0 - 0.5
        inked ^= np.hypot(du, dv) < 0.05
    image[inked] = _shade(ink, 1.0 + 0.07 * noise((*key, "ink")))[inked]
    return from_image(image, (height_m, height_m), "wrap")


def patches(key: tuple[int | str, ...], base: Rgb, ink: Rgb, height_m: float) -> Texture:
    """A ball with dark patches around it."""
    u, v = _grid()
    image = _shade(base, 1.0 + 0.05 * noise(key))
    for row, (y, count) in enumerate(((0.0, 1), (0.28, 5), (0.5, 5), (0.72, 5), (1.0, 1))):
        stretch = max(np.sin(np.pi * min(max(y, 0.08), 0.92)), 0.25)
        for k in range(count):
            du = (u - (k + 0.5 * (row % 2)) / count + 0.5) % 1.0 - 0.5
            image[np.hypot(2.0 * du * stretch, v - y) < 0.085] = ink
    return from_image(image, (height_m, height_m), "wrap")


def cover(key: tuple[int | str, ...], base: Rgb, ink: Rgb, size_m: tuple[float, float]) -> Texture:
    """A book cover or a carton: a frame, a title of a few lines and a picture, once over ``size_m``."""
    u, v = _grid()
    draws = generator(*key, "cover")
    image = _shade(base, 1.0 + 0.06 * noise(key))
    edge = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    image[(edge > 0.05) & (edge < 0.08)] = ink
    for line in range(int(draws.integers(2, 4))):
        top, left, right = 0.14 + 0.11 * line, draws.uniform(0.14, 0.28), draws.uniform(0.6, 0.86)
        image[(v > top) & (v < top + 0.065) & (u > left) & (u < right)] = ink
    x, y, r = draws.uniform(0.35, 0.65), draws.uniform(0.64, 0.72), draws.uniform(0.12, 0.19)
    accent = np.array(ink) * 0.5 + np.roll(np.array(base), 1) * 0.5
    image[np.hypot(u - x, v - y) < r] = accent.astype(np.float32)
    image[np.hypot(u - x - 0.3 * r, v - y + 0.3 * r) < 0.35 * r] = ink
    return from_image(image, size_m)


def keys(key: tuple[int | str, ...], base: Rgb, cap: Rgb, size_m: tuple[float, float], columns: int = 15, rows: int = 5) -> Texture:
    """The keys of a keyboard, once over ``size_m``."""
    u, v = _grid()
    margin_u, margin_v = 0.03, 0.07
    x, y = (u - margin_u) / (1 - 2 * margin_u) * columns, (v - margin_v) / (1 - 2 * margin_v) * rows
    inside = (x > 0) & (x < columns) & (y > 0) & (y < rows)
    keycap = inside & (np.abs(x % 1 - 0.5) < 0.39) & (np.abs(y % 1 - 0.5) < 0.4)
    keycap |= inside & (y > rows - 1) & (np.abs(y % 1 - 0.5) < 0.4) & (x > 4) & (x < 10)  # the space bar
    tones = generator(*key, "keys").uniform(0.75, 1.2, (rows + 1, columns + 1))
    tone = tones[np.clip(y, 0, rows).astype(np.int64), np.clip(x, 0, columns).astype(np.int64)]
    image = _shade(base, 1.0 + 0.05 * noise(key))
    image[keycap] = _shade(cap, tone)[keycap]
    return from_image(image, size_m)


def screen(key: tuple[int | str, ...], size_m: tuple[float, float]) -> Texture:
    """A monitor's picture: a few windows with lines of text on a blue ground, once over ``size_m``."""
    u, v = _grid()
    draws = generator(*key, "screen")
    image = _shade((0.16, 0.33, 0.55), 1.0 + 0.25 * noise(key, smoothness=2.0))
    for left, top, wide, high in ((0.06, 0.1, 0.42, 0.6), (0.4, 0.28, 0.5, 0.55), (0.66, 0.06, 0.28, 0.18)):
        window = (u > left) & (u < left + wide) & (v > top) & (v < top + high)
        image[window] = draws.uniform(0.85, 0.97)
        image[window & (v < top + 0.05)] = (0.3, 0.3, 0.36)
        for line in np.arange(top + 0.09, top + high - 0.05, 0.06):
            end = left + 0.03 + draws.uniform(0.3, 0.9) * (wide - 0.06)
            image[(v > line) & (v < line + 0.022) & (u > left + 0.03) & (u < end)] = draws.uniform(0.1, 0.6, 3)
    edge = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    image[edge < 0.012] = 0.03
    return from_image(image, size_m)
