"""Furniture for homes where no mesh is given: built of boxes, of common sizes. Base at z = 0, front to -y, back to +y; metres."""

from collections.abc import Callable, Iterator

import numpy as np

from seo_slam.simulation import textures
from seo_slam.simulation.catalogue import METAL, WHITE, Key, pose
from seo_slam.simulation.draws import generator
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.stand_in_furniture import chair, table
from seo_slam.simulation.textures import Rgb, Texture
from seo_slam.simulation.world import Part

Size = tuple[float, float, float]

_WOODS: tuple[Rgb, ...] = ((0.70, 0.53, 0.36), (0.50, 0.35, 0.24), (0.82, 0.72, 0.56), (0.60, 0.47, 0.35), (0.88, 0.86, 0.82))
_CLOTHS: tuple[Rgb, ...] = ((0.35, 0.42, 0.52), (0.55, 0.30, 0.26), (0.40, 0.48, 0.36), (0.62, 0.55, 0.44), (0.44, 0.38, 0.50))
_BOARD_M = 0.025

_SIZES_M: dict[str, tuple[Size, Size]] = {
    "table": ((1.2, 0.78, 0.72), (1.6, 0.9, 0.76)),
    "desk": ((1.15, 0.6, 0.7), (1.4, 0.72, 0.75)),
    "coffee table": ((0.9, 0.5, 0.38), (1.15, 0.62, 0.45)),
    "nightstand": ((0.42, 0.38, 0.45), (0.5, 0.44, 0.55)),
    "dresser": ((1.0, 0.45, 0.76), (1.4, 0.52, 0.88)),
    "counter": ((0.9, 0.6, 0.86), (1.2, 0.64, 0.92)),
    "tv stand": ((1.1, 0.4, 0.42), (1.4, 0.46, 0.52)),
    "bookcase": ((0.8, 0.33, 1.3), (1.0, 0.36, 1.5)),
    "shelf": ((0.7, 0.34, 0.76), (0.9, 0.38, 0.9)),
    "wardrobe": ((0.9, 0.58, 1.9), (1.1, 0.64, 2.05)),
    "refrigerator": ((0.62, 0.62, 1.65), (0.75, 0.7, 1.8)),
    "sofa": ((1.6, 0.8, 0.76), (2.0, 0.9, 0.84)),
    "bed": ((1.4, 2.0, 0.9), (1.6, 2.1, 1.05)),
}


def _size(label: str, key: Key) -> Size:
    low, high = _SIZES_M[label]
    x, y, z = (round(float(v), 3) for v in generator(*key, "size").uniform(low, high))
    return x, y, z


def _wood(key: Key) -> Texture:
    return textures.wood((*key, "wood"), _WOODS[int(generator(*key, "wood tone").integers(len(_WOODS)))], 0.7)


def _cloth(key: Key, name: str) -> Texture:
    return textures.mottled((*key, name), _CLOTHS[int(generator(*key, name).integers(len(_CLOTHS)))], 0.22, 0.3)


def _box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], paint: Texture) -> Part:
    """A box between coordinates."""
    size = (x[1] - x[0], y[1] - y[0], z[1] - z[0])
    return Part(Box(size), paint, pose((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2))


def _chest(key: Key, size: Size, columns: int, rows: int, body: Texture, front: Texture, top: Texture) -> Iterator[Part]:
    """A closed chest under a top: doors or drawers with a knob each, on a plinth."""
    wide, deep, high = size[0] / 2, size[1] / 2, size[2]
    yield _box((-wide + 0.02, wide - 0.02), (-deep + 0.03, deep), (0.0, 0.06), body)
    yield _box((-wide + 0.005, wide - 0.005), (-deep + 0.02, deep), (0.06, high - 0.03), body)
    yield _box((-wide, wide), (-deep, deep), (high - 0.03, high), top)
    knob = textures.mottled((*key, "knob"), METAL, 0.1, 0.03)
    cell_x, cell_z = 2 * (wide - 0.01) / columns, (high - 0.1) / rows
    for column in range(columns):
        for row in range(rows):
            x, z = -wide + 0.01 + (column + 0.5) * cell_x, 0.065 + (row + 0.5) * cell_z
            half_x, half_z = cell_x / 2 - 0.008, cell_z / 2 - 0.008
            yield _box((x - half_x, x + half_x), (-deep + 0.004, -deep + 0.02), (z - half_z, z + half_z), front)
            yield _box((x - 0.035, x + 0.035), (-deep, -deep + 0.004), (z + 0.5 * half_z, z + 0.5 * half_z + 0.015), knob)


def _dresser(key: Key) -> tuple[Part, ...]:
    wood = _wood(key)
    return tuple(_chest(key, _size("dresser", key), 2, 4, wood, wood, wood))


def _nightstand(key: Key) -> tuple[Part, ...]:
    wood = _wood(key)
    return tuple(_chest(key, _size("nightstand", key), 1, 2, wood, wood, wood))


def _tv_stand(key: Key) -> tuple[Part, ...]:
    wood = _wood(key)
    return tuple(_chest(key, _size("tv stand", key), 3, 1, wood, textures.mottled((*key, "door"), WHITE, 0.06, 0.2), wood))


def _counter(key: Key) -> tuple[Part, ...]:
    stone = textures.mottled((*key, "stone"), (0.42, 0.42, 0.44), 0.35, 0.25)
    front = textures.mottled((*key, "door"), (0.86, 0.84, 0.78), 0.06, 0.3)
    return tuple(_chest(key, _size("counter", key), 2, 1, front, front, stone))


def _wardrobe(key: Key) -> tuple[Part, ...]:
    wood = _wood(key)
    return tuple(_chest(key, _size("wardrobe", key), 2, 1, wood, wood, wood))


def _refrigerator(key: Key) -> tuple[Part, ...]:
    steel = textures.mottled((*key, "steel"), (0.74, 0.76, 0.78), 0.07, 0.4)
    return tuple(_chest(key, _size("refrigerator", key), 1, 2, steel, steel, steel))


def _open_shelves(key: Key, size: Size, boards: int) -> Iterator[Part]:
    """Sides, a back, and boards that can be reached from the front."""
    wood = _wood(key)
    wide, deep, high = size[0] / 2, size[1] / 2, size[2]
    for x in (-wide, wide - _BOARD_M):
        yield _box((x, x + _BOARD_M), (-deep, deep), (0.0, high), wood)
    yield _box((-wide + _BOARD_M, wide - _BOARD_M), (deep - 0.01, deep), (0.0, high), wood)
    for z in np.linspace(0.05, high - _BOARD_M, boards):
        yield _box((-wide + _BOARD_M, wide - _BOARD_M), (-deep, deep - 0.01), (float(z), float(z) + _BOARD_M), wood)


def _bookcase(key: Key) -> tuple[Part, ...]:
    return tuple(_open_shelves(key, _size("bookcase", key), 4))


def _shelf(key: Key) -> tuple[Part, ...]:
    return tuple(_open_shelves(key, _size("shelf", key), 3))


def _desk(key: Key) -> tuple[Part, ...]:
    """A top on a leg panel and a block of drawers."""
    x, y, z = _size("desk", key)
    wood = _wood(key)
    drawers = tuple(
        Part(part.shape, part.texture, pose(x=x / 2 - 0.22) @ part.T_thing_part)
        for part in _chest(key, (0.4, y - 0.04, z - _BOARD_M), 1, 3, wood, wood, wood)
    )
    panel = _box((-x / 2 + 0.02, -x / 2 + 0.06), (-y / 2 + 0.02, y / 2 - 0.02), (0.0, z - _BOARD_M), wood)
    return (_box((-x / 2, x / 2), (-y / 2, y / 2), (z - _BOARD_M, z), wood), panel, *drawers)


def _sofa(key: Key) -> tuple[Part, ...]:
    x, y, z = _size("sofa", key)
    wide, deep, seat, arm = x / 2, y / 2, 0.42, 0.16
    cloth, cushion = _cloth(key, "cloth"), _cloth(key, "cushion")
    middle = wide - arm
    return (
        _box((-wide, wide), (-deep, deep), (0.06, 0.3), cloth),
        _box((-wide + 0.05, wide - 0.05), (-deep + 0.05, deep - 0.05), (0.0, 0.06), cloth),
        _box((-middle, -0.005), (-deep, deep - 0.2), (0.3, seat), cushion),
        _box((0.005, middle), (-deep, deep - 0.2), (0.3, seat), cushion),
        _box((-wide, wide), (deep - 0.2, deep), (0.3, z), cloth),
        _box((-wide, -middle), (-deep, deep - 0.2), (0.3, 0.6), cloth),
        _box((middle, wide), (-deep, deep - 0.2), (0.3, 0.6), cloth),
    )


def _bed(key: Key) -> tuple[Part, ...]:
    """Head against the back, two pillows, a cover over the rest."""
    x, y, z = _size("bed", key)
    wide, deep = x / 2, y / 2
    wood, cover = _wood(key), _cloth(key, "cover")
    linen = textures.mottled((*key, "linen"), (0.92, 0.91, 0.88), 0.06, 0.3)
    return (
        _box((-wide, wide), (deep - 0.06, deep), (0.0, z), wood),
        _box((-wide, wide), (-deep, deep - 0.06), (0.08, 0.3), wood),
        _box((-wide + 0.05, wide - 0.05), (-deep + 0.05, deep - 0.1), (0.0, 0.08), wood),
        _box((-wide + 0.03, wide - 0.03), (-deep + 0.02, deep - 0.06), (0.3, 0.48), linen),
        _box((-wide + 0.01, wide - 0.01), (-deep + 0.01, deep - 0.55), (0.35, 0.51), cover),
        *(_box((s - 0.27, s + 0.27), (deep - 0.48, deep - 0.12), (0.48, 0.58), linen) for s in (-wide / 2, wide / 2)),
    )


FURNITURE: dict[str, Callable[[Key], tuple[Part, ...]]] = {
    "bed": _bed,
    "bookcase": _bookcase,
    "chair": chair,
    "coffee table": lambda key: table(key, _size("coffee table", key)),
    "counter": _counter,
    "desk": _desk,
    "dresser": _dresser,
    "nightstand": _nightstand,
    "refrigerator": _refrigerator,
    "shelf": _shelf,
    "sofa": _sofa,
    "table": lambda key: table(key, _size("table", key)),
    "tv stand": _tv_stand,
    "wardrobe": _wardrobe,
}
"""Label -> what builds one from a key."""
