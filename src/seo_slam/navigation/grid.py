"""Where the middle of a round robot may be: the layout, grown by the robot's radius, with exact tests of points and segments."""

import math
from functools import cached_property

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, IntArray

EIGHT = np.ones((3, 3), dtype=np.bool_)
"""Cells that meet at a corner are neighbours: a robot may pass from one to the other, since both are free up to their edge."""

_CORNER = 1e-9  # of a cell: a segment that crosses two lines of the grid so near to each other goes through a corner
_END = 1.0 - 1e-12  # of a segment: a line of the grid that it ends on is not crossed
_ESCAPE_CELLS = 2


class NavigationGrid:
    """The free cells of a layout for a robot of some radius.

    A cell is traversable where floor was seen and neither obstacle nor wall; what was never seen is not. A cell is free if, wherever in
    it the robot's middle is, nothing but traversable cells lies within the radius. World frame, metres.

    Attributes:
        layout: what it was made from.
        radius_m: of the robot.
        cell_m: side of a cell.
        clearance_m: (R, C) the least distance from anywhere in a cell to a cell that is not traversable.
        free: (R, C) where the robot's middle may be.
        parts: (R, C) number of the connected part of each free cell, 0 elsewhere.
    """

    def __init__(self, layout: Layout, radius_m: float) -> None:
        """Grow the obstacles.

        Raises:
            ConfigError: the radius is not above 0.
        """
        if not (np.isfinite(radius_m) and radius_m > 0):
            raise ConfigError(f"radius_m: got {radius_m}, wanted a length above 0")
        self.layout = layout
        self.radius_m = radius_m
        self.cell_m = layout.cell_m
        shut = np.pad(~(layout.floor & ~layout.obstacles & ~layout.walls), 1, constant_values=True)
        # From anywhere in one cell to anywhere in another is as far as from its middle to the nearest middle of the 3 x 3 around that.
        apart = ndimage.distance_transform_edt(~ndimage.binary_dilation(shut, EIGHT))
        self.clearance_m: FloatArray = np.asarray(self.cell_m * apart[1:-1, 1:-1])
        self.free: BoolArray = self.clearance_m >= radius_m - 1e-9
        self.parts: IntArray = ndimage.label(self.free, EIGHT)[0].astype(np.int64)
        self._corner = (float(layout.corner_world[0]), float(layout.corner_world[1]))
        self._flat_clearance: list[float] = self.clearance_m.ravel().tolist()
        self._flat_passable: list[float] = np.where(layout.obstacles | layout.walls, 0.0, 1.0).ravel().tolist()

    @property
    def free_share(self) -> float:
        """Share of the cells that are free."""
        return float(self.free.mean()) if self.free.size else 0.0

    @cached_property
    def free_cells(self) -> IntArray:
        """(N, 2) row and column of all free cells."""
        return np.argwhere(self.free)

    @cached_property
    def _free_tree(self) -> cKDTree:
        return cKDTree(self.layout.middles(self.free_cells))

    @cached_property
    def _flat_from_solid(self) -> list[float]:
        """Of each cell, the least distance from anywhere in it to an obstacle or a wall; only a robot off the free floor asks for it."""
        solid = self.layout.obstacles | self.layout.walls
        cells = ndimage.distance_transform_edt(~ndimage.binary_dilation(solid, EIGHT)) if solid.any() else np.full(solid.shape, np.inf)
        out: list[float] = np.asarray(self.cell_m * cells).ravel().tolist()
        return out

    def is_free(self, xy_world: FloatArray) -> BoolArray:
        """Return (N,) whether the robot's middle may be at points (N, 2); never outside the grid."""
        cells = self.layout.cells(xy_world)
        inside = ((cells >= 0) & (cells < self.free.shape)).all(axis=-1)
        out = np.zeros(len(cells), dtype=np.bool_)
        out[inside] = self.free[tuple(cells[inside].T)]
        return out

    def is_clear(self, a_world: FloatArray, b_world: FloatArray, least_m: float | None = None) -> bool:
        """Return whether the robot may go straight from a (2,) to b (2,): every cell that the segment passes through is asked.

        Args:
            a_world: one end.
            b_world: the other.
            least_m: distance to keep from everything; None: the robot's radius.
        """
        least = self.radius_m if least_m is None else max(least_m, self.radius_m)
        return self._passes(a_world, b_world, self._flat_clearance, least - 1e-9)

    def clearance_along(self, points_world: FloatArray) -> FloatArray:
        """Return (N,) clearance of the cells of points (N, 2); 0 outside the grid."""
        cells = self.layout.cells(points_world)
        inside = ((cells >= 0) & (cells < self.free.shape)).all(axis=-1)
        out = np.zeros(len(cells))
        out[inside] = self.clearance_m[tuple(cells[inside].T)]
        return out

    def nearest_free(self, xy_world: FloatArray, within_m: float) -> FloatArray | None:
        """Return the free place nearest to a point (2,): the point itself, or the middle of a free cell; None if none is within reach."""
        xy = np.asarray(xy_world, dtype=np.float64)[:2]
        if self.is_free(xy[None])[0]:
            return xy
        if not len(self.free_cells):
            return None
        distance_m, index = self._free_tree.query(xy)
        return np.asarray(self._free_tree.data[index]) if distance_m <= within_m else None

    def same_part(self, a_world: FloatArray, b_world: FloatArray) -> bool:
        """Return whether a way leads from a (2,) to b (2,) over free cells; no if one of them is not free."""
        ends = np.stack([np.asarray(a_world, dtype=np.float64)[:2], np.asarray(b_world, dtype=np.float64)[:2]])
        if not self.is_free(ends).all():
            return False
        (row_a, column_a), (row_b, column_b) = self.layout.cells(ends)
        return bool(self.parts[row_a, column_a] == self.parts[row_b, column_b])

    def way_out(self, xy_world: FloatArray) -> FloatArray | None:
        """Return the nearest free place to which a robot that stands too near to something can go straight, touching no obstacle.

        A robot that overshot by a few centimetres must be able to leave. The place is within the radius and two cells; the way to it is
        through cells in which no obstacle was seen. None if there is no such place; the point itself (2,) where it is free.
        """
        xy = np.asarray(xy_world, dtype=np.float64)[:2]
        if self.is_free(xy[None])[0]:
            return xy
        return self._first_past(xy, self._within(xy, self.radius_m + _ESCAPE_CELLS * self.cell_m))

    def way_in(self, xy_world: FloatArray, within_m: float) -> FloatArray | None:
        """Return where a robot comes to the large part of the floor from a point (2,) outside of it, or on an island of its own.

        The place is of the largest part that can be come to straight within a distance; the nearest of it that the robot comes to without
        touching what was seen, else the nearest to which its middle does; that of a robot which stands in what the map holds for solid
        may first come out of it. The point itself where it is of that part already; None where no such place is so near.
        """
        xy = np.asarray(xy_world, dtype=np.float64)[:2]
        sizes = np.bincount(self.parts.ravel())
        here = self.parts[tuple(self.layout.cells(xy[None])[0])] if self.is_free(xy[None])[0] else 0
        places = self._within(xy, within_m)
        size = sizes[self.parts[tuple(self.layout.cells(places).T)]] if len(places) else np.zeros(0)
        larger = size > (sizes[here] if here else 0)
        order = np.argsort(-size[larger], kind="stable")
        places = places[larger][order]
        found = next((place for place in places if self._passes(xy, place, self._flat_from_solid, self.radius_m - 1e-9)), None)
        found = self._first_past(xy, places) if found is None else np.asarray(found)
        if found is None and not here:
            found = next((np.asarray(place) for place in places if self._comes_out(xy, place)), None)
        return xy if found is None and here else found

    def _within(self, xy: FloatArray, reach_m: float) -> FloatArray:
        """Middles (N, 2) of the free cells so near, nearest first."""
        if not len(self.free_cells):
            return np.zeros((0, 2))
        places = np.asarray(self._free_tree.data)[self._free_tree.query_ball_point(xy, reach_m)]
        return np.asarray(places[np.argsort(np.linalg.norm(places - xy, axis=1), kind="stable")])

    def _first_past(self, xy: FloatArray, places: FloatArray) -> FloatArray | None:
        return next((np.asarray(place) for place in places if self._passes(xy, place, self._flat_passable, 0.5)), None)

    def _comes_out(self, xy: FloatArray, place: FloatArray) -> bool:
        """Whether a robot in a solid cell, or off the grid, goes straight to a place, into nothing else and through no other wall."""
        points = np.linspace(xy, place, max(2, int(np.ceil(4.0 * np.linalg.norm(place - xy) / self.cell_m))))
        cells = self.layout.cells(points)
        known: BoolArray = np.asarray(((cells >= 0) & (cells < self.free.shape)).all(axis=1))
        wall, open_ground = np.zeros(len(points), dtype=np.bool_), np.zeros(len(points), dtype=np.bool_)
        wall[known] = self.layout.walls[tuple(cells[known].T)]
        open_ground[known] = ~(self.layout.walls | self.layout.obstacles)[tuple(cells[known].T)]
        out = int(np.argmax(open_ground))  # the first point past what the robot stands in; the place itself is free
        if not known[0]:  # off the grid: onto open ground, whatever is between
            return not known[:out].any() and self._passes(points[out], place, self._flat_passable, 0.5)
        deep = float(np.linalg.norm(points[out] - xy)) > self.radius_m + _ESCAPE_CELLS * self.cell_m
        if out == 0 or deep or (wall[:out].any() and not wall[0]):
            return False
        return self._passes(points[out], place, self._flat_passable, 0.5)

    def _passes(self, a_world: FloatArray, b_world: FloatArray, values: list[float], least: float) -> bool:
        """Whether all cells that a segment goes through have a value of at least so much (Amanatides and Woo 1987).

        Plain numbers in a loop: segments are short, and numpy costs more a call than a whole walk.
        """
        rows, columns = self.free.shape
        x, y = (float(a_world[0]) - self._corner[0]) / self.cell_m, (float(a_world[1]) - self._corner[1]) / self.cell_m
        to_x, to_y = (float(b_world[0]) - self._corner[0]) / self.cell_m, (float(b_world[1]) - self._corner[1]) / self.cell_m
        if not (0 <= x < columns and 0 <= to_x < columns and 0 <= y < rows and 0 <= to_y < rows):
            return False
        cell, last = int(y) * columns + int(x), int(to_y) * columns + int(to_x)
        over_x, over_y = to_x - x, to_y - y
        right, down = (1 if over_x > 0 else -1), (columns if over_y > 0 else -columns)
        each_x, each_y = (abs(1.0 / over_x) if over_x else math.inf), (abs(1.0 / over_y) if over_y else math.inf)
        next_x = (int(x) + (over_x > 0) - x) / over_x if over_x else math.inf
        next_y = (int(y) + (over_y > 0) - y) / over_y if over_y else math.inf
        corner = _CORNER * min(each_x, each_y)
        while values[cell] >= least:
            ahead = next_x - next_y
            if (next_x if ahead < 0 else next_y) >= _END:
                return bool(values[last] >= least)
            if ahead <= corner:
                cell += right
                next_x += each_x
            if ahead >= -corner:
                cell += down
                next_y += each_y
        return False
