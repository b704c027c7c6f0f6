"""Where a robot may stand in a world: found by rays, from the world itself and not from the plan it was built by.

A grid over the floor, rows along y and columns along x of the world frame. A cell is free if nothing between the floor and the robot's
height is in it.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.casting import Caster, PrimitiveCaster, RayHits, caster_for, parts_of
from seo_slam.simulation.world import World
from seo_slam.types import BoolArray, IntArray

ROBOT_RADIUS_M = 0.18
ROBOT_HEIGHT_M = 1.5
CELL_M = 0.05

_STEP_OVER_M = 0.05  # a carpet or a threshold is no obstacle
_SOLID_M = 1.5  # no cupboard is deeper or wider on either side
_SKY_M = 20.0
_SLICES_M = (0.12, 0.3, 0.5, 0.7, 0.9, 1.1, 1.35)
_MOST_SURFACES = 400  # along one ray; a bookcase full of books has about a hundred


@dataclass(frozen=True, eq=False)
class FreeSpace:
    """A grid of the floor.

    Attributes:
        occupied: (rows, columns) whether something is in a cell.
        corner_world: (2,) low corner of the grid, world frame, metres.
        cell_m: side of a cell.
    """

    occupied: BoolArray
    corner_world: FloatArray
    cell_m: float = CELL_M

    @cached_property
    def clearance_m(self) -> FloatArray:
        """(rows, columns) metres from the middle of each cell to what is nearest, on the safe side by up to half a cell."""
        padded = np.pad(~self.occupied, 1)
        distance = ndimage.distance_transform_edt(padded)[1:-1, 1:-1]
        return np.asarray(np.maximum(self.cell_m * (distance - 0.5), 0.0))

    def standing(self, radius_m: float = ROBOT_RADIUS_M) -> BoolArray:
        """Return (rows, columns) where the middle of a robot of that radius may be."""
        return np.asarray(self.clearance_m >= radius_m)

    def main_part(self, radius_m: float = ROBOT_RADIUS_M) -> BoolArray:
        """Return (rows, columns) the largest connected part of ``standing``."""
        labels, count = ndimage.label(self.standing(radius_m))
        if not count:
            return np.zeros_like(self.occupied)
        return np.asarray(labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]))

    def connected_share(self, radius_m: float = ROBOT_RADIUS_M) -> float:
        """Return which share of ``standing`` is one connected part; 0 if a robot can stand nowhere."""
        standing = int(self.standing(radius_m).sum())
        return float(self.main_part(radius_m).sum()) / standing if standing else 0.0

    def middles(self, cells: IntArray) -> FloatArray:
        """Return (N, 2) the middles of cells (N, 2) given as row and column, world frame."""
        return np.asarray(self.corner_world + self.cell_m * (cells[..., ::-1] + 0.5))

    def cells(self, p_world: FloatArray) -> IntArray:
        """Return (N, 2) row and column of points (N, 2 or 3), world frame; points outside go to the nearest cell."""
        index = np.floor((np.asarray(p_world)[..., :2] - self.corner_world) / self.cell_m).astype(np.int64)
        return np.clip(index[..., ::-1], 0, np.array(self.occupied.shape) - 1)

    def clearance_at(self, p_world: FloatArray) -> FloatArray:
        """Return (N,) metres of clearance at points (N, 2 or 3), world frame; interpolated between cells, 0 outside."""
        at = ((np.asarray(p_world)[..., :2] - self.corner_world) / self.cell_m - 0.5)[..., ::-1]
        return np.asarray(ndimage.map_coordinates(self.clearance_m, np.moveaxis(at, -1, 0), order=1, mode="constant"))


def free_space(world: World, cell_m: float = CELL_M, height_m: float = ROBOT_HEIGHT_M) -> FreeSpace:
    """Return the free floor of a world.

    Rays from above find what stands on the floor; rays along the floor, at several heights, find thin walls that those miss.

    Args:
        world: its ``structure`` holds a thing called "floor", over which the grid is laid.
        cell_m: side of a cell.
        height_m: what is higher than this is no obstacle.

    Raises:
        ConfigError: the world has no floor.
        MissingBackendError: the world holds meshes and the extra ``sim`` is not installed.
    """
    low, high = floor_bounds(world)
    caster = home_caster(without_ceiling(obstacles_of(world)))
    columns, rows = (np.ceil((high - low)[:2] / cell_m - 1e-6)).astype(np.int64)
    empty = FreeSpace(np.zeros((rows, columns), dtype=np.bool_), low[:2], cell_m)
    blocked = _blocked_from_above(empty, caster, float(high[2]), height_m)
    for axis in (0, 1):
        blocked |= _crossed(empty, caster, axis, [float(high[2]) + z for z in _SLICES_M if z < height_m])
    return replace(empty, occupied=blocked)


def home_caster(world: World) -> Caster:
    """Return Embree's caster for meshes, else the exact one, also where Embree is installed: a layout shall not depend on that.

    Raises:
        MissingBackendError: the world holds meshes and the extra ``sim`` is not installed.
    """
    return caster_for(world) if any(part.shape.is_mesh for _, part in parts_of(world)) else PrimitiveCaster(world)


def floor_bounds(world: World) -> tuple[FloatArray, FloatArray]:
    """Return the low and high corner (3,) of the floor, world frame.

    Raises:
        ConfigError: there is none.
    """
    floors = [thing.bounds_world for thing in world.structure if thing.label == "floor"]
    if not floors:
        raise ConfigError(f"world: got structure {sorted({t.label for t in world.structure})}, wanted a floor in it")
    return np.min([low for low, _ in floors], axis=0), np.max([high for _, high in floors], axis=0)


def without_ceiling(world: World) -> World:
    """Return the world as it is seen from above."""
    return replace(world, structure=tuple(thing for thing in world.structure if thing.label != "ceiling"))


def obstacles_of(world: World) -> World:
    """Return the world without what is carried about and stands on something else: that is over an obstacle already."""
    floor_m = float(floor_bounds(world)[1][2])
    things = tuple(t for t in world.things if t.kind != "volatile" or t.bounds_world[0][2] < floor_m + 0.1)
    return replace(world, things=things)


def _blocked_from_above(grid: FreeSpace, caster: Caster, z_floor_m: float, height_m: float) -> BoolArray:
    """Which cells hold something with a top, or lie inside a solid, or have no floor."""
    xy = grid.middles(np.argwhere(np.ones_like(grid.occupied)))
    top_m = _SKY_M - _cast(caster, xy, _SKY_M, (0.0, 0.0, -1.0)).t - z_floor_m
    blocked = (top_m > _STEP_OVER_M) | ~np.isfinite(top_m)
    tall = np.flatnonzero(np.isfinite(top_m) & (top_m > height_m))
    if len(tall):
        head_m = z_floor_m + height_m
        stands_m = height_m - _cast(caster, xy[tall], head_m, (0.0, 0.0, -1.0)).t
        blocked[tall] = (stands_m > _STEP_OVER_M) | _inside_a_solid(caster, xy[tall], head_m)
    return blocked.reshape(grid.occupied.shape)


def _inside_a_solid(caster: Caster, xy: FloatArray, z: float) -> BoolArray:
    """Whether points are shut in by one and the same part, above and on all sides nearby: a cupboard without a gap."""
    above = _cast(caster, xy, z, (0.0, 0.0, 1.0))
    shut = np.isfinite(above.t)
    for direction in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        beside = _cast(caster, xy, z, direction)
        shut &= (beside.part == above.part) & (beside.t < _SOLID_M)
    return shut


def _cast(caster: Caster, xy: FloatArray, z: float, direction: tuple[float, float, float]) -> RayHits:
    return caster.cast(np.column_stack([xy, np.full(len(xy), z)]), np.tile(direction, (len(xy), 1)))


def _crossed(grid: FreeSpace, caster: Caster, axis: int, heights: list[float]) -> BoolArray:
    """Which cells a surface passes through, along rays through the middles of all rows (axis 0) or columns (axis 1)."""
    lines, length = grid.occupied.shape[axis], grid.occupied.shape[1 - axis]
    across = grid.corner_world[1 - axis] + grid.cell_m * (np.arange(lines) + 0.5)
    line = np.tile(np.arange(lines), len(heights))
    p = np.zeros((len(line), 3))
    p[:, 1 - axis] = across[line]
    p[:, axis] = grid.corner_world[axis] - 1e-3
    p[:, 2] = np.repeat(heights, lines)
    direction = np.eye(3)[axis]
    crossed = np.zeros((lines, length), dtype=np.bool_)
    going = np.arange(len(line))
    for _ in range(_MOST_SURFACES):
        t = caster.cast(p[going], np.tile(direction, (len(going), 1))).t
        hit = np.isfinite(t)
        going, t = going[hit], t[hit]
        p[going, axis] += t
        index = np.floor((p[going, axis] - grid.corner_world[axis]) / grid.cell_m).astype(np.int64)
        inside = (index >= 0) & (index < length)
        crossed[line[going[inside]], index[inside]] = True
        p[going, axis] += 1e-3  # on, behind this surface
        going = going[index < length]
        if not len(going):
            break
    return crossed if axis == 0 else crossed.T
