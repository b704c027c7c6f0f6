"""The images of all meshes of a world in one long row of texels, each with ever smaller copies of itself."""

import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.simulation.embree_scene import Floats32, Ints32
from seo_slam.simulation.meshes import MeshPaint
from seo_slam.simulation.world import Part
from seo_slam.types import IntArray

_LEVELS = 10


class PaintBox:
    """Looks up the colours of many triangles of many meshes at once.

    Attributes:
        covers: (P + 1,) which of the P parts have paint of their own; the last entry (index -1: nothing) has none.
    """

    def __init__(self, paints: list[MeshPaint | None], placed: list[tuple[Part, FloatArray]]) -> None:
        """Lay out the paint of every part."""
        self.covers = np.array([paint is not None for paint in paints] + [False])
        self._first_triangle = np.zeros(len(paints) + 1, dtype=np.int64)
        uv, image, per_m, tint = [], [], [], []
        texels, self._tables = _TexelRow(), None
        laid: dict[int, tuple[IntArray, FloatArray, MeshPaint]] = {}
        count = 0
        for index, paint in enumerate(paints):
            self._first_triangle[index] = count
            if paint is None:
                continue
            if id(paint) not in laid:
                shape_triangles = placed[index][0].shape.triangles()
                offsets = np.array([texels.add(picture) for picture in paint.images], dtype=np.int64)
                laid[id(paint)] = (offsets[paint.image], texels_per_m(paint, *shape_triangles), paint)
            images, density, _ = laid[id(paint)]
            uv.append(paint.uv)
            image.append(images)
            per_m.append(density)
            tint.append(paint.tint if paint.tint is not None else None)
            count += len(paint.uv)
        self._uv = np.concatenate(uv) if uv else np.zeros((0, 3, 2), np.float32)
        self._image = np.concatenate(image).astype(np.int32) if image else np.zeros(0, np.int32)
        self._per_m = np.concatenate(per_m).astype(np.float32) if per_m else np.zeros(0, np.float32)
        self._tint = None
        if any(part is not None for part in tint):
            self._tint = np.concatenate([np.ones((len(u), 3, 3), np.float32) if t is None else t for t, u in zip(tint, uv, strict=True)])
        self._texels, self._start, self._width, self._height, self._last = texels.finished()

    def colours(self, part: Ints32, triangle: Ints32, u: Floats32, v: Floats32, footprint_m: Floats32) -> Floats32:
        """Return (N, 3) colours in 0..1.

        Args:
            part, triangle: (N,) which triangle of which part.
            u, v: (N,) weights of its second and third corner.
            footprint_m: (N,) how much of the surface a pixel covers.
        """
        face = self._first_triangle[part] + triangle
        image = self._image[face]
        wanted = np.log2(np.maximum(footprint_m * self._per_m[face], np.float32(1.0)))
        level = np.minimum((wanted + np.float32(0.5)).astype(np.int32), self._last[image])
        row = image * _LEVELS + level
        width, height, start = self._width[row], self._height[row], self._start[row]
        corners = self._uv[face]
        w = 1 - u - v
        x = (w * corners[:, 0, 0] + u * corners[:, 1, 0] + v * corners[:, 2, 0]) * width - np.float32(0.5)
        y = (w * corners[:, 0, 1] + u * corners[:, 1, 1] + v * corners[:, 2, 1]) * height - np.float32(0.5)
        x0, y0 = np.floor(x), np.floor(y)
        fx, fy = (x - x0)[:, None], (y - y0)[:, None]
        j0, i0 = x0.astype(np.int32) % width, y0.astype(np.int32) % height
        j1, i1 = (j0 + 1) % width, (i0 + 1) % height
        upper, lower = start + i0 * width, start + i1 * width
        texels = self._texels
        top = texels[upper + j0] * (1 - fx) + texels[upper + j1] * fx
        bottom = texels[lower + j0] * (1 - fx) + texels[lower + j1] * fx
        colours = (top * (1 - fy) + bottom * fy) * np.float32(1.0 / 255.0)
        if self._tint is not None:
            tint = self._tint[face]
            colours *= w[:, None] * tint[:, 0] + u[:, None] * tint[:, 1] + v[:, None] * tint[:, 2]
        return colours


class _TexelRow:
    """Collects images and their smaller copies."""

    def __init__(self) -> None:
        self._texels: list[NDArray[np.uint8]] = []
        self._start: list[list[int]] = []
        self._size: list[list[tuple[int, int]]] = []
        self._count = 0

    def add(self, image: NDArray[np.uint8]) -> int:
        """Append an image (H, W, 3); return its number."""
        starts, sizes = [], []
        for level in shrunk(image):
            starts.append(self._count)
            sizes.append(level.shape[:2])
            self._texels.append(level.reshape(-1, 3))
            self._count += level.shape[0] * level.shape[1]
        self._start.append(starts)
        self._size.append(sizes)
        return len(self._start) - 1

    def finished(self) -> tuple[NDArray[np.uint8], Ints32, Ints32, Ints32, Ints32]:
        """Return the texels (T, 3), start, width and height of every level of every image, and the last level of each."""
        start, size = np.zeros((len(self._start), _LEVELS), np.int32), np.ones((len(self._start), _LEVELS, 2), np.int32)
        for row, (starts, sizes) in enumerate(zip(self._start, self._size, strict=True)):
            start[row, : len(starts)], size[row, : len(sizes)] = starts, sizes
        texels = np.concatenate(self._texels) if self._texels else np.zeros((1, 3), np.uint8)
        last = np.array([len(starts) - 1 for starts in self._start], dtype=np.int32)
        return texels, start.ravel(), size[..., 1].ravel(), size[..., 0].ravel(), last


def shrunk(image: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Return an image and copies of half the size each, down to one texel or ``_LEVELS`` of them."""
    levels, current = [image], image.astype(np.float32)
    while max(current.shape[:2]) > 1 and len(levels) < _LEVELS:
        height, width = current.shape[:2]
        current = np.pad(current, ((0, height % 2 if height > 1 else 1), (0, width % 2 if width > 1 else 1), (0, 0)), mode="edge")
        current = (current[0::2, 0::2] + current[1::2, 0::2] + current[0::2, 1::2] + current[1::2, 1::2]) / 4.0
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
