"""The abstract map: anchors with the features of what is on them, the layout of the floor, and rooms (DualMap IV-A).

Everything is in the world frame, metres, z up. Nothing here changes; an update makes another map.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import MapError
from seo_slam.geometry import FloatArray
from seo_slam.records import FeatureRecipe
from seo_slam.types import BoolArray, IntArray

RelationKind = Literal["on", "in", "next to"]


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where something was seen last.

    Attributes:
        p_world: (3,) middle of what was seen of it.
        horizon: (S,) for as many directions around it, from -180 degrees against x on: the least slope, rise over run, at which an eye
            there sees it over its anchor.
    """

    p_world: FloatArray
    horizon: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Volatile:
    """Something that people carry about, as its anchor remembers it.

    Attributes:
        label: a word for people.
        feature: (D,) unit vector.
        relation: how it stood to the anchor.
        landmark_id: of the concrete map it was taken from.
        place: where it was; None in a map that was saved without.
    """

    label: str
    feature: FloatArray
    relation: RelationKind
    landmark_id: int
    place: Place | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Anchor:
    """A thing that rarely moves, and what is on it.

    Attributes:
        id: never reused within a map; the landmark's when it was abstracted.
        label: a word for people.
        feature: (D,) unit vector, f of Eq 5.
        footprint_world: (M, 2) points of its cloud seen from above, voxel-averaged.
        points: how many points of its cloud stand behind the feature, |P| of Eq 7.
        z_range_m: lowest and highest point.
        support_z_m: height of the plane that carries things.
        volatiles: F of the paper.
        hints: what was seen there and is not trusted; asked for where nothing trusted is like the query.
    """

    id: int
    label: str
    feature: FloatArray
    footprint_world: FloatArray
    points: int
    z_range_m: tuple[float, float]
    support_z_m: float
    volatiles: tuple[Volatile, ...] = ()
    hints: tuple[Volatile, ...] = ()

    @property
    def bounds_world(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (2,) of the footprint."""
        return self.footprint_world.min(axis=0), self.footprint_world.max(axis=0)

    @property
    def xy_world(self) -> FloatArray:
        """(2,) middle of the footprint's box."""
        low, high = self.bounds_world
        return np.asarray(0.5 * (low + high))


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The floor from above: a grid, rows along y and columns along x of the world frame.

    Attributes:
        corner_world: (2,) low corner of the grid.
        cell_m: side of a cell.
        walls: (R, C) the paper's occupancy: cells in which more points are piled up than in nine of ten.
        obstacles: (R, C) something between the floor and a robot's height was seen there.
        floor: (R, C) the floor was seen there, or looked over low enough, or a robot stood there.
        rooms: (R, C) int16, the id of the room of each cell; 0 for none.
    """

    corner_world: FloatArray
    cell_m: float
    walls: BoolArray
    obstacles: BoolArray
    floor: BoolArray
    rooms: NDArray[np.int16]

    def __post_init__(self) -> None:
        shapes = {grid.shape for grid in (self.walls, self.obstacles, self.floor, self.rooms)}
        if len(shapes) != 1 or self.cell_m <= 0:
            raise MapError(f"layout: got grids of {sorted(shapes)} and cells of {self.cell_m} m, wanted grids of one size, cells above 0")

    def cells(self, p_world: FloatArray) -> IntArray:
        """Return (N, 2) row and column of points (N, 2 or 3), world frame; may lie outside the grid."""
        index = np.floor((np.asarray(p_world, dtype=np.float64)[..., :2] - self.corner_world) / self.cell_m).astype(np.int64)
        return np.asarray(index[..., ::-1])

    def middles(self, cells: IntArray) -> FloatArray:
        """Return (N, 2) middles, world frame, of cells (N, 2) given as row and column."""
        return np.asarray(self.corner_world + self.cell_m * (np.asarray(cells)[..., ::-1] + 0.5))


@dataclass(frozen=True, slots=True)
class Room:
    """A room of the layout.

    Attributes:
        id: 1, 2, … in ``Layout.rooms``.
        name: what it is by its furniture, for example "kitchen"; "room 3" where nothing tells.
        area_m2: of its floor.
    """

    id: int
    name: str
    area_m2: float


@dataclass(frozen=True, slots=True, eq=False)
class AbstractMap:
    """What is needed to decide where to go.

    Attributes:
        anchors: by rising id.
        layout: None where no scene cloud was kept.
        rooms: by rising id.
        embedder: name of the model of all features.
        features: how they were made; None if that is not known.
    """

    anchors: tuple[Anchor, ...]
    layout: Layout | None = None
    rooms: tuple[Room, ...] = ()
    embedder: str = ""
    features: FeatureRecipe | None = None
