"""The layout of the floor from the scene cloud, seen from above (DualMap IV-A).

The paper's occupancy is a histogram of the points with a threshold at its 90th percentile: good enough to see walls. For a robot that
must not bump into a stool we also keep where something stands between the floor and the robot's height, and where floor was seen.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.abstraction.extent import MOST_CELLS, within_reach
from seo_slam.abstraction.floor_height import floor_plane, heights_above
from seo_slam.abstraction.seen_over import View, low_on_rays
from seo_slam.abstraction.voxels import Voxels
from seo_slam.geometry import FloatArray
from seo_slam.settings.planning import LayoutSettings
from seo_slam.types import BoolArray, IntArray

_LOG = logging.getLogger(__name__)

_DROP_M = 0.3  # so far below the floor no noise makes points
_SQUARE = np.ones((3, 3), dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class _Raster:
    """A grid over all points, and the flat index of the cell of each of them."""

    corner_world: FloatArray
    shape: tuple[int, int]
    index: IntArray

    def counts(self, weights: IntArray | FloatArray, chosen: BoolArray) -> FloatArray:
        """Sum up the weights of the chosen points in each cell."""
        rows, columns = self.shape
        summed = np.bincount(self.index[chosen], weights[chosen], rows * columns)
        return np.asarray(summed.reshape(rows, columns), dtype=np.float64)


def layout_of(
    voxels: Voxels,
    way_world: FloatArray,
    settings: LayoutSettings,
    views: Sequence[View] = (),
    warn: Callable[[str], None] = _LOG.warning,
    most_cells: int = MOST_CELLS,
) -> Layout:
    """Return the layout of what was seen; without rooms.

    Args:
        voxels: the scene cloud.
        way_world: (N, 3) where the camera was.
        settings: see there.
        views: of which frames the points are; floor that they looked over low enough counts as seen.
        warn: is told what was left out, far off from most of what was seen, since the grid would have been too large.
        most_cells: that it may have.
    """
    if not len(voxels.p_world):
        nothing = np.zeros((1, 1), dtype=np.bool_)
        return Layout(np.zeros(2), settings.cell_m, nothing, nothing, nothing, np.zeros((1, 1), dtype=np.int16))
    voxels, way_world = _within_reach(voxels, way_world, settings, most_cells, warn)
    raster = _raster(np.concatenate([voxels.p_world, way_world])[:, :2], len(voxels.p_world), settings)
    plane = floor_plane(voxels.p_world, way_world)
    above_m = heights_above(plane, voxels.p_world)
    on_floor = raster.counts(voxels.counts, np.abs(above_m) <= settings.step_over_m)
    standing = raster.counts(voxels.counts, (above_m > settings.step_over_m) & (above_m <= settings.robot_height_m))
    obstacles = _obstacles(standing, on_floor, settings)
    floor = _without_gaps(on_floor >= settings.floor_points, settings.floor_gap_cells)
    deep = raster.counts(voxels.counts, above_m < -_DROP_M) > 0
    over = _no_drop(_seen_over(raster, views, plane, settings) & ~floor, deep)
    walls = _walls(raster, above_m, settings)
    seen = Layout(raster.corner_world, settings.cell_m, walls, obstacles, floor, np.zeros(raster.shape, dtype=np.int16))
    return replace(seen, floor=(floor | over | _walked(seen, way_world, settings)) & ~obstacles)


def _within_reach(
    voxels: Voxels, way_world: FloatArray, settings: LayoutSettings, most_cells: int, warn: Callable[[str], None]
) -> tuple[Voxels, FloatArray]:
    """What one grid can cover: a single pose that jumped would make it grow with the square of the distance."""
    xy_world, seen = np.concatenate([voxels.p_world, way_world])[:, :2], len(voxels.p_world)
    kept = within_reach(xy_world, seen, settings.cell_m * settings.bin_cells, most_cells / settings.bin_cells**2)
    if kept.all():
        return voxels, way_world
    warn(
        f"layout: {np.sum(~kept[:seen])} of {seen} places that were seen are left out: they lie so far off that it would have more than "
        f"{most_cells} cells; has a pose jumped?"
    )
    return Voxels(voxels.p_world[kept[:seen]], voxels.counts[kept[:seen]]), way_world[kept[seen:]]


def _obstacles(standing: FloatArray, on_floor: FloatArray, settings: LayoutSettings) -> BoolArray:
    """Cells with enough points above the floor; beside such a cell, where an edge of it may be seen seldom, one point is enough."""
    likely = (standing > 0) & (standing >= settings.obstacle_share * on_floor)
    sure = likely & (standing >= settings.obstacle_points)
    seen = likely & ndimage.binary_dilation(sure, _SQUARE)
    return _without_gaps(seen, settings.obstacle_gap_cells)  # a far wall is seen in pieces; no robot fits between them


def _seen_over(raster: _Raster, views: Sequence[View], plane: FloatArray, settings: LayoutSettings) -> BoolArray:
    """Cells that were looked over so low that nothing but what a robot steps over, or what is flatter than that look, can be in them."""
    passed = np.zeros(raster.shape, dtype=np.bool_)
    if not settings.seen_over_m:
        return passed
    low = low_on_rays(views, plane, settings.seen_over_m, settings.cell_m, settings.seen_over_rays)
    cells = np.floor((low - raster.corner_world) / settings.cell_m).astype(np.int64)[:, ::-1]
    inside = ((cells >= 0) & (cells < raster.shape)).all(axis=1)
    passed[tuple(cells[inside].T)] = True
    return _without_gaps(passed, settings.floor_gap_cells)


def _no_drop(over: BoolArray, deep: BoolArray) -> BoolArray:
    """Without the stretches of unseen floor beside which something deep was seen: a stair down is looked over as low as floor is."""
    labels, _ = ndimage.label(over, _SQUARE)
    drops = np.unique(labels[ndimage.binary_dilation(deep, _SQUARE, iterations=2)])
    return over & ~np.isin(labels, drops[drops > 0])


def _walls(raster: _Raster, above_m: FloatArray, settings: LayoutSettings) -> BoolArray:
    """The paper's occupancy, and what rises to its full height: where many walls are seen, nine of ten bins are no good measure."""
    low = (above_m > settings.step_over_m) & (above_m <= settings.wall_height_m)
    walls = walls_of(_binned(raster.counts(np.ones(len(above_m)), low), settings.bin_cells), settings)
    layers = np.arange(settings.wall_height_m / 2.0, settings.wall_height_m - 1e-9, settings.voxel_m)
    filled = np.zeros(walls.shape)
    for layer in layers:
        here = (above_m > layer) & (above_m <= layer + settings.voxel_m)
        filled += _binned(raster.counts(np.ones(len(above_m)), here), settings.bin_cells) > 0
    tall = _large_groups(filled >= settings.wall_fill * len(layers), settings.wall_bins)
    return _unbinned(walls | tall, settings.bin_cells)


def walls_of(counts: FloatArray, settings: LayoutSettings) -> BoolArray:
    """Return the paper's occupancy (R, C): more points than ``wall_percentile`` of the bins that have any, cleaned up.

    Groups of fewer than ``wall_bins`` bins are dropped, and gaps of one bin are closed.
    """
    if not counts.any():
        return np.zeros(counts.shape, dtype=np.bool_)
    piled = counts > np.percentile(counts[counts > 0], settings.wall_percentile)
    large = _large_groups(piled, settings.wall_bins)
    return np.asarray(ndimage.binary_closing(np.pad(large, 1), _SQUARE)[1:-1, 1:-1])


def _large_groups(bins: BoolArray, least: int) -> BoolArray:
    """The joined groups of at least so many bins."""
    labels, number = ndimage.label(bins, _SQUARE)
    large = np.bincount(labels.ravel(), minlength=number + 1) >= least
    large[0] = False
    return np.asarray(large[labels])


def _raster(xy_world: FloatArray, points: int, settings: LayoutSettings) -> _Raster:
    """A grid of whole bins over all that is given, aligned to multiples of a bin; the index is of the first ``points`` rows."""
    side_m = settings.cell_m * settings.bin_cells
    low, high = np.floor(xy_world.min(axis=0) / side_m), np.floor(xy_world.max(axis=0) / side_m)
    columns, rows = ((high - low).astype(int) + 1) * settings.bin_cells
    corner = low * side_m
    cells = np.clip(np.floor((xy_world[:points] - corner) / settings.cell_m).astype(np.int64), 0, [columns - 1, rows - 1])
    return _Raster(corner, (int(rows), int(columns)), cells[:, 1] * columns + cells[:, 0])


def _binned(counts: FloatArray, cells: int) -> FloatArray:
    rows, columns = counts.shape
    return np.asarray(counts.reshape(rows // cells, cells, columns // cells, cells).sum(axis=(1, 3)))


def _unbinned(bins: BoolArray, cells: int) -> BoolArray:
    return np.repeat(np.repeat(bins, cells, axis=0), cells, axis=1)


def _without_gaps(seen: BoolArray, cells: int) -> BoolArray:
    """Close gaps between the sparse points on something far."""
    if not cells:
        return seen
    disc = np.hypot(*np.indices((2 * cells + 1, 2 * cells + 1)) - cells) <= cells + 0.5
    return np.asarray(ndimage.binary_closing(np.pad(seen, cells), disc)[cells:-cells, cells:-cells])


def _walked(layout: Layout, way_world: FloatArray, settings: LayoutSettings) -> BoolArray:
    """Which cells lie under the camera's way, or near beside it."""
    walked = np.zeros(layout.floor.shape, dtype=np.bool_)
    if not len(way_world) or not settings.path_radius_m:
        return walked
    walked[tuple(layout.cells(way_world).T)] = True
    return np.asarray(ndimage.distance_transform_edt(~walked) * layout.cell_m <= settings.path_radius_m)
