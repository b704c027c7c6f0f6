"""The paint of all triangles of a world, looked up for many pixels at once.

All images lie in one long row of texels, each followed by ever coarser copies of itself. A shape that is flat triangle by triangle can be
painted so, be it with the images of a mesh or with a texture that is laid over it; round ones with an exact normal cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.simulation.meshes import MeshPaint, MeshShape
from seo_slam.simulation.primitives import Box, RoomBox
from seo_slam.simulation.textures import Texture
from seo_slam.simulation.world import Part
from seo_slam.types import BoolArray, IntArray

Floats32 = NDArray[np.float32]
Ints32 = NDArray[np.int32]
Packed = NDArray[np.uint32]

_LEVELS = 10  # of one image
_HALF_STEP = np.float32(np.sqrt(2.0))  # a level is twice as coarse as the one before; half way to it in the exponent
_RED_BLUE, _LOW = np.uint32(0xFF00FF), np.uint32(0xFFFF)


@dataclass(frozen=True, slots=True, eq=False)
class _Painted:
    """One part: a row of 8 numbers a triangle, and images.

    Attributes:
        rows: (F, 8): place of the first corner in its image, from there to the second and the third, texels a metre, number of the image.
        images: the levels of each image, packed texels (H, W).
        tint: (F, 3, 3) of the corners, or None.
    """

    rows: Floats32
    images: tuple[tuple[Packed, ...], ...]
    tint: Floats32 | None


class FacePaint:
    """Colours of triangles.

    Attributes:
        covers: (P + 1,) which of the P parts are painted here; the last entry (index -1: nothing) is not.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        """Lay out the paint of every part that can be painted triangle by triangle."""
        pieces = [_painted(part) for part in parts]
        self.covers: BoolArray = np.array([piece is not None for piece in pieces] + [False])
        self._first_row = np.zeros(len(parts) + 1, dtype=np.int32)
        store = _TexelRow()
        rows, tints, count = [np.zeros((0, 8), np.float32)], [np.zeros((0, 3, 3), np.float32)], 0
        tinted = any(piece is not None and piece.tint is not None for piece in pieces)
        for index, piece in enumerate(pieces):
            if piece is None:
                continue
            numbers = np.array([store.add(levels) for levels in piece.images], dtype=np.float32)
            own = piece.rows.copy()
            own[:, 7] = numbers[piece.rows[:, 7].astype(np.int64)]
            rows.append(own)
            if tinted:
                tints.append(piece.tint if piece.tint is not None else np.ones((len(own), 3, 3), np.float32))
            self._first_row[index] = count
            count += len(own)
        self._rows = np.concatenate(rows)
        self._tint = np.concatenate(tints) if tinted else None
        self._texels, self._start, self._width, self._height, self._last = store.finished()

    def colours(self, part: Ints32, triangle: Ints32, weights: tuple[Floats32, Floats32], footprint_m: Floats32) -> Floats32:
        """Return (3, N) colours, 0 to 255.

        Args:
            part: (N,) which part.
            triangle: (N,) which triangle of it.
            weights: of its second and its third corner, (N,) each.
            footprint_m: (N,) how much of the surface a pixel covers.
        """
        face = self._first_row[part] + triangle
        row, (u, v) = np.take(self._rows, face, axis=0), weights
        image = row[:, 7].astype(np.int32)
        coarseness = np.maximum(footprint_m * row[:, 6], np.float32(1.0)) * _HALF_STEP
        level = np.minimum((coarseness.view(np.int32) >> 23) - 127, np.take(self._last, image))  # the exponent: exact everywhere
        at = image * _LEVELS + level
        width, height = np.take(self._width, at), np.take(self._height, at)
        x = (row[:, 0] + u * row[:, 2] + v * row[:, 4]) * width - np.float32(0.5)
        y = (row[:, 1] + u * row[:, 3] + v * row[:, 5]) * height - np.float32(0.5)
        out = self._between_texels(np.take(self._start, at), width, height, x, y)
        if self._tint is not None:
            tint = np.take(self._tint, face, axis=0)
            for channel in range(3):
                out[channel] *= (1 - u - v) * tint[:, 0, channel] + u * tint[:, 1, channel] + v * tint[:, 2, channel]
        return out

    def _between_texels(self, start: Ints32, width: Ints32, height: Ints32, x: Floats32, y: Floats32) -> Floats32:
        """Return the bilinear mean of four texels, in whole numbers: weights of 16 x 16, red and blue together in 32 bits."""
        x0, y0 = np.floor(x), np.floor(y)
        right = ((x - x0) * np.float32(16.0)).astype(np.uint32)
        down = ((y - y0) * np.float32(16.0)).astype(np.uint32)
        left, up = np.uint32(16) - right, np.uint32(16) - down
        j0, i0 = x0.astype(np.int32) % width, y0.astype(np.int32) % height
        j1, i1 = j0 + 1, i0 + 1
        j1[j1 == width] = 0
        i1[i1 == height] = 0
        upper, lower = start + i0 * width, start + i1 * width
        red_blue = np.zeros(len(x), dtype=np.uint32)
        green = np.zeros(len(x), dtype=np.uint32)
        for at, weight in ((upper + j0, left * up), (upper + j1, right * up), (lower + j0, left * down), (lower + j1, right * down)):
            texel = np.take(self._texels, at)
            red_blue += (texel & _RED_BLUE) * weight
            green += ((texel >> np.uint32(8)) & np.uint32(0xFF)) * weight
        out = np.empty((3, len(x)), dtype=np.float32)
        out[0], out[1], out[2] = red_blue & _LOW, green, red_blue >> np.uint32(16)
        out *= np.float32(1.0 / 256.0)
        return out


class _TexelRow:
    """Collects images, each once."""

    def __init__(self) -> None:
        self._number: dict[int, int] = {}
        self._levels: list[tuple[Packed, ...]] = []

    def add(self, levels: tuple[Packed, ...]) -> int:
        """Append an image, if it is not there yet; return its number."""
        if id(levels) not in self._number:
            self._number[id(levels)] = len(self._levels)
            self._levels.append(levels)
        return self._number[id(levels)]

    def finished(self) -> tuple[Packed, Ints32, Ints32, Ints32, Ints32]:
        """Return the texels (T,), start, width and height of every level of every image, and the last level of each image."""
        shape = (len(self._levels), _LEVELS)
        start, width, height = np.zeros(shape, np.int32), np.ones(shape, np.int32), np.ones(shape, np.int32)
        flat, count = [np.zeros(0, np.uint32)], 0
        for image, levels in enumerate(self._levels):
            for level, texels in enumerate(levels):
                start[image, level] = count
                height[image, level], width[image, level] = texels.shape
                flat.append(texels.ravel())
                count += texels.size
        last = np.array([len(levels) - 1 for levels in self._levels], dtype=np.int32)
        return np.concatenate(flat), start.ravel(), width.ravel(), height.ravel(), last


def _painted(part: Part) -> _Painted | None:
    shape = part.shape
    if isinstance(shape, MeshShape) and shape.paint is not None:
        return _own_paint(shape, shape.paint)
    flat = shape.is_mesh or isinstance(shape, Box | RoomBox)
    if flat and type(part.texture) is Texture and part.texture.mapping == "box":
        return _laid_over(part)
    return None


@lru_cache(maxsize=1024)
def _own_paint(shape: MeshShape, paint: MeshPaint) -> _Painted:
    rows = _rows(paint.uv, texels_per_m(paint, shape.vertices, shape.faces), paint.image)
    return _Painted(rows, tuple(tuple(_packed(level) for level in shrunk(image)) for image in paint.images), paint.tint)


def _laid_over(part: Part) -> _Painted:
    """Lay a texture over triangles: the axis that it is seen along depends on the normal alone, so one triangle has one."""
    vertices, faces = part.shape.triangles()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    if isinstance(part.shape, RoomBox):
        normals = -normals
    uv = np.stack([np.stack(part.texture.coordinates(corner, normals), axis=-1) for corner in (a, b, c)], axis=1)
    uv -= np.floor(uv.min(axis=1, keepdims=True))  # near 0, where float32 is finest; textures repeat
    levels = _texture_levels(part.texture)
    size = part.texture.levels.shape[1]
    density = np.full(len(faces), np.sqrt(2.0) * size / max(part.texture.tile_m))  # sqrt(2): Texture.colours takes the coarser level
    return _Painted(_rows(uv, density, np.zeros(len(faces), dtype=np.int64)), (levels,), None)


@lru_cache(maxsize=1024)
def _texture_levels(texture: Texture) -> tuple[Packed, ...]:
    return tuple(_packed(np.round(255.0 * level).astype(np.uint8)) for level in texture.levels)


def _rows(uv: NDArray[np.floating], density: FloatArray, image: IntArray) -> Floats32:
    rows = np.empty((len(uv), 8), dtype=np.float32)
    rows[:, 0:2], rows[:, 2:4], rows[:, 4:6] = uv[:, 0], uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    rows[:, 6], rows[:, 7] = density, image
    return rows


def _packed(image: NDArray[np.uint8]) -> Packed:
    red, green, blue = (image[..., k].astype(np.uint32) for k in range(3))
    return np.asarray(red | (green << np.uint32(8)) | (blue << np.uint32(16)))


def shrunk(image: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return an image (H, W, 3) and copies of half the size each, down to one texel or ``_LEVELS`` of them."""
    levels, current = [image], image.astype(np.float32)
    while max(current.shape[:2]) > 1 and len(levels) < _LEVELS:
        height, width = current.shape[:2]
        current = np.pad(current, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        current = (current[0::2, 0::2] + current[1::2, 0::2] + current[0::2, 1::2] + current[1::2, 1::2]) / np.float32(4.0)
        levels.append(np.round(current).astype(np.uint8))
    return levels


def texels_per_m(paint: MeshPaint, vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return (F,) how many texels of its image a triangle shows a metre, in the mean over directions."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area_m2 = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    side, up = paint.uv[:, 1] - paint.uv[:, 0], paint.uv[:, 2] - paint.uv[:, 0]
    sizes = np.array([image.shape[0] * image.shape[1] for image in paint.images], dtype=np.float64)
    area_texels = np.abs(side[:, 0] * up[:, 1] - side[:, 1] * up[:, 0]) * sizes[paint.image]
    return np.asarray(np.sqrt(area_texels / np.maximum(area_m2, 1e-12)))
