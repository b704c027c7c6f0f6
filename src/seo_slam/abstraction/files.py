"""The abstract map as a section of map.json: its model, and the way there and back.

Vectors and points are little-endian float32 in base64, a grid of yes and no is its bits, row after row; so a flat takes a few hundred kB.
The same map gives the same bytes, also after it was read and written again.
"""

import base64
import binascii
from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Place, RelationKind, Room, Volatile
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray

VERSION = 2
"""2: a volatile thing has its place, and an anchor has hints; 1 is read too."""
_MOST_CELLS = 100_000_000
Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PlaceDocument(_Model):
    """Where something was seen last."""

    p_world: tuple[Finite, Finite, Finite] = Field(description="Middle of what was seen of it, world frame, metres.")
    horizon: tuple[Finite, ...] = Field(
        min_length=1, description="Rise over run at which an eye sees it over its anchor, by direction, from -180 degrees against x on."
    )


class VolatileDocument(_Model):
    """Something that people carry about, as its anchor remembers it."""

    label: str = Field(description="A word for people; may be empty.")
    relation: RelationKind = Field(description="How it stood to the anchor.")
    landmark_id: int = Field(ge=0, description="Of the concrete map it was taken from.")
    feature: str = Field(description="Unit vector: float32, little-endian, base64.")
    place: PlaceDocument | None = Field(default=None, description="Where it was; null in a section of version 1.")


class AnchorDocument(_Model):
    """A thing that rarely moves, and what is on it."""

    id: int = Field(ge=0, description="Never reused within an abstract map; the landmark's when it was abstracted.")
    label: str = Field(description="A word for people; may be empty.")
    points: int = Field(ge=0, description="How many points stand behind the feature.")
    z_range_m: tuple[Finite, Finite] = Field(description="Lowest and highest point, world frame, metres.")
    support_z_m: Finite = Field(description="Height of the plane that carries things, world frame, metres.")
    feature: str = Field(description="Unit vector: float32, little-endian, base64.")
    footprint_world: str = Field(description="Points seen from above, [x, y] after [x, y], world frame, metres: as feature.")
    volatiles: tuple[VolatileDocument, ...] = Field(description="What belongs to it.")
    hints: tuple[VolatileDocument, ...] = Field(default=(), description="What was seen there and is not trusted.")


class RoomDocument(_Model):
    """A room of the layout."""

    id: int = Field(ge=1, le=32767, description="As in the layout's grid of rooms.")
    name: str = Field(description="What it is by its furniture.")
    area_m2: float = Field(ge=0, allow_inf_nan=False, description="Area of its floor, square metres.")


class LayoutDocument(_Model):
    """The floor from above, as grids: rows along y and columns along x."""

    corner_world: tuple[Finite, Finite] = Field(description="Low corner, world frame, metres.")
    cell_m: float = Field(gt=0, allow_inf_nan=False, description="Side of a cell, metres.")
    shape: tuple[int, int] = Field(description="Rows and columns.")
    walls: str = Field(description="Cells with walls and other high things: a bit each, highest first, row after row, base64.")
    obstacles: str = Field(description="Cells in a robot's way, written the same way.")
    floor: str = Field(description="Cells where the floor is known to be, written the same way.")
    rooms: tuple[tuple[int, int], ...] = Field(description="Id of a room, or 0, and how many cells in a row have it; row after row.")

    @model_validator(mode="after")
    def _grids_fill_the_shape(self) -> Self:
        if min(self.shape) < 0 or self.shape[0] * self.shape[1] > _MOST_CELLS:
            raise ValueError(f"layout: got {self.shape[0]} x {self.shape[1]} cells, wanted 0 to {_MOST_CELLS}")
        for name, text in (("walls", self.walls), ("obstacles", self.obstacles), ("floor", self.floor)):
            _bits_from(name, text, self.shape)
        if any(not 0 <= room <= 32767 or count < 1 for room, count in self.rooms):
            raise ValueError("rooms: wanted ids from 0 to 32767, and counts above 0")
        got, wanted = sum(count for _, count in self.rooms), self.shape[0] * self.shape[1]
        if got != wanted:
            raise ValueError(f"rooms: the counts cover {got} cells, the layout has {wanted}")
        return self


class AbstractDocument(_Model):
    """Anchors, what is on them, and the layout of the floor."""

    version: Literal[1, 2] = Field(description="Version of this section.")
    embedder: str = Field(description="Name of the model of all features.")
    anchors: tuple[AnchorDocument, ...] = Field(description="By rising id.")
    rooms: tuple[RoomDocument, ...] = Field(description="By rising id.")
    layout: LayoutDocument | None = Field(description="null where none was kept.")

    @model_validator(mode="after")
    def _anchors_are_sound(self) -> Self:
        for what, ids in (("anchor", [a.id for a in self.anchors]), ("room", [r.id for r in self.rooms])):
            if ids != sorted(set(ids)):
                raise ValueError(f"{what} ids: got {ids[:12]}, wanted rising ones")
        sizes = set()
        for anchor in self.anchors:
            if anchor.z_range_m[0] > anchor.z_range_m[1]:
                raise ValueError(f"anchor {anchor.id}: z_range_m: got {anchor.z_range_m}, wanted the lower one first")
            if not len(_floats_from(f"anchor {anchor.id}: footprint_world", anchor.footprint_world, 2)):
                raise ValueError(f"anchor {anchor.id}: footprint_world: got no point")
            carried = (*anchor.volatiles, *anchor.hints)
            for owner, text in (("", anchor.feature), *((f"volatile {v.landmark_id}: ", v.feature) for v in carried)):
                sizes.add(_floats_from(f"anchor {anchor.id}: {owner}feature", text, 1).size)
        if len(sizes) > 1:
            raise ValueError(f"features: got vectors of lengths {sorted(sizes)}, wanted one length")
        return self


def abstract_document(source: AbstractMap) -> AbstractDocument:
    """Return the section of a map.

    Raises:
        ValidationError: it holds what a file may not: NaN, ids that do not rise, features of several lengths.
    """
    return AbstractDocument.model_validate(
        {
            "version": VERSION,
            "embedder": source.embedder,
            "anchors": [_anchor_fields(anchor) for anchor in source.anchors],
            "rooms": [{"id": int(room.id), "name": room.name, "area_m2": _rounded(room.area_m2)} for room in source.rooms],
            "layout": None if source.layout is None else _layout_fields(source.layout),
        }
    )


def abstract_map_from(document: AbstractDocument) -> AbstractMap:
    """Return the map of a section."""
    return AbstractMap(
        anchors=tuple(_anchor_from(row) for row in document.anchors),
        layout=None if document.layout is None else _layout_from(document.layout),
        rooms=tuple(Room(row.id, row.name, row.area_m2) for row in document.rooms),
        embedder=document.embedder,
    )


def _anchor_fields(anchor: Anchor) -> dict[str, object]:
    return {
        "id": int(anchor.id),
        "label": anchor.label,
        "points": int(anchor.points),
        "z_range_m": [_rounded(z) for z in anchor.z_range_m],
        "support_z_m": _rounded(anchor.support_z_m),
        "feature": _floats(anchor.feature),
        "footprint_world": _floats(anchor.footprint_world),
        "volatiles": [_volatile_fields(volatile) for volatile in anchor.volatiles],
        "hints": [_volatile_fields(volatile) for volatile in anchor.hints],
    }


def _volatile_fields(volatile: Volatile) -> dict[str, object]:
    place = volatile.place
    return {
        "label": volatile.label,
        "relation": volatile.relation,
        "landmark_id": int(volatile.landmark_id),
        "feature": _floats(volatile.feature),
        "place": None if place is None else {"p_world": _short(place.p_world, 4), "horizon": _short(place.horizon, 2)},
    }


def _anchor_from(row: AnchorDocument) -> Anchor:
    return Anchor(
        id=row.id,
        label=row.label,
        feature=_floats_from("feature", row.feature, 1)[:, 0],
        footprint_world=_floats_from("footprint_world", row.footprint_world, 2),
        points=row.points,
        z_range_m=row.z_range_m,
        support_z_m=row.support_z_m,
        volatiles=tuple(_volatile_from(volatile) for volatile in row.volatiles),
        hints=tuple(_volatile_from(volatile) for volatile in row.hints),
    )


def _volatile_from(row: VolatileDocument) -> Volatile:
    place = None if row.place is None else Place(np.array(row.place.p_world), np.array(row.place.horizon))
    return Volatile(row.label, _floats_from("feature", row.feature, 1)[:, 0], row.relation, row.landmark_id, place)


def _layout_fields(layout: Layout) -> dict[str, object]:
    rooms = np.asarray(layout.rooms).ravel()
    starts = np.flatnonzero(np.r_[True, rooms[1:] != rooms[:-1]]) if rooms.size else np.zeros(0, dtype=np.int64)
    counts = np.diff(np.r_[starts, rooms.size])
    return {
        "corner_world": [_rounded(x) for x in layout.corner_world],
        "cell_m": float(layout.cell_m),
        "shape": [int(side) for side in layout.walls.shape],
        "walls": _bits(layout.walls),
        "obstacles": _bits(layout.obstacles),
        "floor": _bits(layout.floor),
        "rooms": [[int(room), int(count)] for room, count in zip(rooms[starts], counts, strict=True)],
    }


def _layout_from(row: LayoutDocument) -> Layout:
    rooms = np.repeat(np.array([room for room, _ in row.rooms], dtype=np.int16), [count for _, count in row.rooms])
    grids = (_bits_from(name, text, row.shape) for name, text in (("walls", row.walls), ("obstacles", row.obstacles), ("floor", row.floor)))
    walls, obstacles, floor = grids
    return Layout(np.array(row.corner_world), row.cell_m, walls, obstacles, floor, rooms.reshape(row.shape))


def _floats(values: FloatArray) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def _floats_from(name: str, text: str, columns: int) -> FloatArray:
    """(N, columns) float64.

    Raises:
        ValueError: not base64, cut off, or not finite; names what.
    """
    data = _decoded(name, text)
    if len(data) % (4 * columns):
        raise ValueError(f"{name}: got {len(data)} bytes, wanted a multiple of {4 * columns}")
    values = np.frombuffer(data, dtype="<f4").astype(np.float64).reshape(-1, columns)
    if not np.isfinite(values).all():
        raise ValueError(f"{name}: holds NaN or infinity")
    return values


def _bits(grid: NDArray[np.bool_]) -> str:
    return base64.b64encode(np.packbits(np.asarray(grid, dtype=np.bool_)).tobytes()).decode("ascii")


def _bits_from(name: str, text: str, shape: Sequence[int]) -> BoolArray:
    data, cells = _decoded(name, text), shape[0] * shape[1]
    if len(data) != (cells + 7) // 8:
        raise ValueError(f"{name}: got {len(data)} bytes, wanted {(cells + 7) // 8} for {cells} cells")
    return np.unpackbits(np.frombuffer(data, dtype=np.uint8), count=cells).astype(np.bool_).reshape(shape[0], shape[1])


def _decoded(name: str, text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"{name}: not base64: {error}") from error


def _short(values: FloatArray, digits: int) -> list[float]:
    return [round(float(x), digits) + 0.0 for x in values]


def _rounded(x: float) -> float:
    return round(float(x), 9) + 0.0  # + 0.0 turns -0.0 into 0.0
