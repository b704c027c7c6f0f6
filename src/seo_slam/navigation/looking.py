"""Where to stand and where to turn, so that the top of an anchor comes into view, or so that the robot is before a thing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor, Layout, Place
from seo_slam.abstraction.horizon import shows
from seo_slam.abstraction.room_finding import room_of
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.navigation.motion import turned_by, wrapped
from seo_slam.navigation.parts import Grid
from seo_slam.types import BoolArray

_FARTHEST_M = 2.4  # from a footprint, to look at it
_NEAR_M, _FAR_M = 0.5, 1.7  # the distance to look from is between these
_STEP_M = 0.15
_EDGE_RAD = 0.1  # what is so near to the edge of the image does not count as in view
_APART_M = 0.4  # two places to look from
_OTHER_SIDE_RAD = 0.7  # seen from the anchor, another view is at least so far round
_PLACES = 6
_TOO_NEAR, _TOO_FAR, _WAY = 2.0, 0.7, 0.1  # costs by the metre
_EQUALLY_NEAR = 0.01  # of two places as near to a thing, the one on the way
_HIDDEN, _OTHER_ROOM = 5.0, 3.0  # and of a view that is blocked, and of another room
_WALL_CELLS = 1.5  # less than this of a wall is the ragged edge of one
_STOP_STEP_M, _STOP_APART_M = 0.05, 0.15
_LOOKED_OVER_M = 1.2
_INNER = np.array([[0.0, 0.0], [0.35, 0.35], [0.35, -0.35], [-0.35, 0.35], [-0.35, -0.35]])  # of a box
_HALF_HIDDEN = 0.4
_IN_PASSING_M = 0.5  # a place to look from in passing is at most so much farther off than the nearest
_SAMPLE_M = 0.3
_SMALL_M = 0.05  # as high as this is what must be seen over the edge of a top
_SHARE_OF_VIEW = 0.75  # one look takes in so much of the view's width


@dataclass(frozen=True, slots=True)
class Eye:
    """A camera on a robot, as far as looking goes.

    Attributes:
        z_m: its height in the world frame.
        up_rad, down_rad: elevation of the upper and lower edge of its view; negative is down.
        half_width_rad: half of its view across.
    """

    z_m: float
    up_rad: float
    down_rad: float
    half_width_rad: float

    @classmethod
    def of(cls, T_world_camera: FloatArray, camera: Camera) -> "Eye":
        """Return the eye of a camera at a pose (4, 4)."""
        pitch = float(np.arcsin(np.clip(T_world_camera[2, 2], -1.0, 1.0)))
        above, below = np.arctan(camera.cy / camera.fy), np.arctan((camera.height - 1 - camera.cy) / camera.fy)
        half_width = np.arctan(min(camera.cx, camera.width - 1 - camera.cx) / camera.fx)
        return cls(float(T_world_camera[2, 3]), pitch + float(above), pitch - float(below), float(half_width))

    def nearest_m(self, z_m: float) -> float:
        """Return the distance on the floor from which on something at a height comes into view."""
        over = self.z_m - z_m
        steepest = self.down_rad + _EDGE_RAD if over > 0 else self.up_rad - _EDGE_RAD
        if over == 0.0:
            return 0.0
        if over * steepest >= 0:  # it is on the side of the view that reaches beyond the horizon: seen from afar only, if at all
            return _FAR_M
        return float(abs(over) / np.tan(abs(steepest)))


def viewpoints(
    anchor: Anchor,
    eye: Eye,
    from_xy: FloatArray,
    grid: Grid,
    layout: Layout,
    before: Sequence[FloatArray] = (),
    z_m: float | None = None,
    last_seen: Place | None = None,
) -> FloatArray:
    """Return (N, 2) places on the free floor to look at an anchor from, best first, connected with where the robot is.

    A good place is as near as the whole near edge of the top is still in view, in the anchor's own room, without a wall between, and not
    a long way off.

    Args:
        anchor: what to look at.
        eye: of the robot.
        from_xy: (2,) where the robot is.
        grid: the free floor.
        layout: its walls and rooms.
        before: places it was looked at from; another one is from another side.
        z_m: height that is to be in view; None: that of its top.
        last_seen: where on it something was seen last: neither the anchor nor a wall is to hide that.
    """
    low, high = anchor.bounds_world
    xy = _free_around(low - _FARTHEST_M, high + _FARTHEST_M, _STEP_M, grid)
    rows = anchor.footprint_world[:: max(len(anchor.footprint_world) // 64, 1)]
    away = np.linalg.norm(xy[:, None] - rows, axis=2).min(axis=1, initial=np.inf)
    best_m = float(np.clip(eye.nearest_m(anchor.support_z_m if z_m is None else z_m), _NEAR_M, _FAR_M))
    kept = (away <= _FARTHEST_M) & _from_another_side(xy, anchor.xy_world, before)
    xy, away = xy[kept], away[kept]
    cost = _TOO_NEAR * np.maximum(best_m - away, 0.0) + _TOO_FAR * np.maximum(away - best_m, 0.0)
    if last_seen is not None:
        target = last_seen.p_world[:2]
        cost += _HIDDEN * (~shows(last_seen, xy, eye.z_m) | (_walls_m(xy, target, layout, (low, high)) > _WALL_CELLS * layout.cell_m))
    cost += _WAY * np.linalg.norm(xy - from_xy, axis=1) + _HIDDEN * hidden_share(xy, anchor, layout)
    room = room_of(layout, anchor.footprint_world)
    if room:
        cost += _OTHER_ROOM * (rooms_of(xy, layout) != room)
    return _best(xy, cost, from_xy, grid, _PLACES, _APART_M)


def places_near(
    target_xy: FloatArray,
    within_m: float,
    from_xy: FloatArray,
    grid: Grid,
    layout: Layout,
    box: tuple[FloatArray, FloatArray] | None = None,
) -> FloatArray:
    """Return (N, 2) places to stop before a thing, best first: as near as the free floor allows, on the robot's side of walls.

    Args:
        target_xy: (2,) middle of the thing.
        within_m: farthest place.
        from_xy: (2,) where the robot is; it sees the thing from there.
        grid: the free floor.
        layout: its walls and rooms.
        box: low and high corner (2,) of the thing itself, which does not hide its own middle.
    """
    xy = _free_around(target_xy - within_m, target_xy + within_m, _STOP_STEP_M, grid)
    away = np.linalg.norm(xy - target_xy, axis=1)
    xy, away = xy[away <= within_m], away[away <= within_m]
    walls_m = _walls_m(xy, target_xy, layout, box)  # the bookcase that a thing is in hides it from everywhere: only more than that counts
    hidden = walls_m > walls_m.min(initial=np.inf) + _WALL_CELLS * layout.cell_m
    cost = away + _EQUALLY_NEAR * np.linalg.norm(xy - from_xy, axis=1) + _HIDDEN * hidden
    here = int(rooms_of(from_xy[None], layout)[0])
    if here:
        rooms = rooms_of(xy, layout)
        cost += _OTHER_ROOM * ((rooms != here) & (rooms > 0)) * (walls_along(from_xy, target_xy, layout) > _WALL_CELLS * layout.cell_m)
    return _best(xy, cost, from_xy, grid, _PLACES, _STOP_APART_M)


def headings_over(anchor: Anchor, from_xy: FloatArray, eye: Eye) -> tuple[float, ...]:
    """Return the headings in which an anchor is seen wholly from a place (2,): one, or several for one wider than the view."""
    to = anchor.footprint_world - from_xy
    middle_rad = float(np.arctan2(*(anchor.xy_world - from_xy)[::-1]))
    off = (np.arctan2(to[:, 1], to[:, 0]) - middle_rad + np.pi) % (2.0 * np.pi) - np.pi
    first, last = float(off.min()), float(off.max())
    wide = 2.0 * _SHARE_OF_VIEW * eye.half_width_rad
    count = max(int(np.ceil((last - first) / wide)), 1)
    shares = (np.arange(count) + 0.5) / count
    return tuple(wrapped(middle_rad + first + float(share) * (last - first)) for share in shares)


def in_sight(anchors: Sequence[Anchor], from_xy: FloatArray, eye: Eye, range_m: float, layout: Layout) -> tuple[Anchor, ...]:
    """Return the anchors that a turn on the spot brings into view: within a distance, not too near below, and behind no wall."""
    found = []
    for anchor in anchors:
        away = float(np.linalg.norm(anchor.footprint_world - from_xy, axis=1).mean())
        hidden = hidden_share(from_xy[None], anchor, layout)[0]
        if eye.nearest_m(anchor.support_z_m) <= away <= range_m and hidden <= _HALF_HIDDEN:
            found.append(anchor)
    return tuple(found)


def legs_to_look(path_world: FloatArray, anchors: Sequence[Anchor], eye: Eye, range_m: float, layout: Layout) -> tuple[FloatArray, ...]:
    """Cut a path at as few places as it takes to see each of some anchors in passing, from about as near as the path comes to it.

    Args:
        path_world: (N, 2) the way, world frame.
        anchors: what to look at; those that come into sight at the end of the path, or never, need no place.
        eye: of the robot.
        range_m: farthest place to look at an anchor from.
        layout: its walls.

    Returns:
        Pieces (M, 2) of the path; the robot is to look around at the end of each but the last.
    """
    xy, at = _samples(path_world)
    gone = np.linalg.norm(xy - xy[0], axis=1) > _IN_PASSING_M  # where it stands now it has looked around
    open_places = []
    for anchor in anchors:
        away = np.linalg.norm(anchor.footprint_world - xy[:, None], axis=2).mean(axis=1)
        seen = (away >= eye.nearest_m(anchor.support_z_m)) & (away <= range_m) & gone
        seen[seen] = hidden_share(xy[seen], anchor, layout) <= _HALF_HIDDEN
        if seen.any() and not seen[-1]:
            open_places.append(seen & (away <= away[seen].min() + _IN_PASSING_M))
    cuts = []
    while open_places:
        cuts.append(int(np.argmax(np.sum(open_places, axis=0))))
        open_places = [places for places in open_places if not places[cuts[-1]]]
    legs, first = [], 0
    for cut in (*sorted(cuts), len(xy) - 1):
        legs.append(
            np.concatenate(
                [
                    xy[first : first + 1],
                    path_world[(at[first] < np.arange(len(path_world))) & (np.arange(len(path_world)) < at[cut])],
                    xy[cut : cut + 1],
                ]
            )
        )
        first = cut
    return tuple(legs)


def shows_its_top(anchor: Anchor, eye: Eye) -> bool:
    """Whether something small in the middle of an anchor's top can be seen from the floor; a low robot sees nothing on a wardrobe.

    The near edge of a top above the eye hides what lies behind it, the more the higher and the deeper the top is.
    """
    low, high = anchor.bounds_world
    behind_edge_m = 0.5 * float((high - low).min())
    return bool(behind_edge_m * (anchor.support_z_m - eye.z_m) / _FARTHEST_M <= _SMALL_M)


def all_around(yaw_rad: float, eye: Eye) -> tuple[float, ...]:
    """Return the headings of a whole turn, beginning with a heading, that leave nothing out."""
    count = int(np.ceil(2.0 * np.pi / max(2.0 * _SHARE_OF_VIEW * eye.half_width_rad, _OTHER_SIDE_RAD)))
    return tuple(wrapped(yaw_rad + 2.0 * np.pi * k / count) for k in range(1, count + 1))


def heading_to(target_xy: FloatArray, from_xy: FloatArray) -> float:
    """Return the heading from one point (2,) to another."""
    way = target_xy - from_xy
    return float(np.arctan2(way[1], way[0]))


def nearest_turn(headings_rad: Sequence[float], yaw_rad: float) -> float:
    """Return the heading that takes the smallest turn."""
    return min(headings_rad, key=lambda heading: (abs(turned_by(yaw_rad, heading)), heading))


def rooms_of(xy_world: FloatArray, layout: Layout) -> FloatArray:
    """Return (N,) ids of the rooms that points (N, 2) are in, 0 for none."""
    cells = layout.cells(xy_world)
    inside = ((cells >= 0) & (cells < layout.rooms.shape)).all(axis=-1)
    out = np.zeros(len(cells))
    out[inside] = layout.rooms[tuple(cells[inside].T)]
    return out


def walls_along(a_world: FloatArray, b_world: FloatArray, layout: Layout) -> float:
    """Return how many metres of wall lie on a straight line between two points (2,)."""
    return float(_walls_m(a_world[None], b_world, layout)[0])


def hidden_share(xy_world: FloatArray, anchor: Anchor, layout: Layout) -> FloatArray:
    """Return (N,) which share of a few points of an anchor is hidden from points (N, 2) by walls; the anchor itself hides none."""
    low, high = anchor.bounds_world
    targets = anchor.xy_world + _INNER * (high - low)
    walls_m = np.stack([_walls_m(xy_world, target, layout, (low, high)) for target in targets])
    return np.asarray((walls_m > _WALL_CELLS * layout.cell_m).mean(axis=0))


def what_hides(layout: Layout, anchors: Sequence[Anchor], over_m: float = _LOOKED_OVER_M) -> Layout:
    """Return the layout with all as ``walls`` that one cannot look past: walls and obstacles that are no low furniture.

    The histogram of DualMap's layout calls only the densest cells walls; a wall seen from afar is an obstacle like any other.

    Args:
        layout: of the map.
        anchors: of the map.
        over_m: furniture up to this height can be looked over.
    """
    opaque = layout.walls | layout.obstacles
    for anchor in anchors:
        if anchor.z_range_m[1] - anchor.z_range_m[0] <= over_m:
            low, high = anchor.bounds_world
            window = _window(layout, low - layout.cell_m, high + layout.cell_m)
            opaque[window] = layout.walls[window]  # a wall between two shelves may be in the boxes of both, and it stays
    return replace(layout, walls=opaque)


def _window(layout: Layout, low: FloatArray, high: FloatArray) -> tuple[slice, slice]:
    first, last = np.maximum(layout.cells(np.stack([low, high])), -1)
    return slice(max(first[0], 0), last[0] + 1), slice(max(first[1], 0), last[1] + 1)


def _walls_m(xy_world: FloatArray, target_xy: FloatArray, layout: Layout, but: tuple[FloatArray, FloatArray] | None = None) -> FloatArray:
    if not len(xy_world):
        return np.zeros(0)
    way = target_xy - xy_world
    lengths = np.linalg.norm(way, axis=1)
    count = max(int(np.ceil(lengths.max() / (0.75 * layout.cell_m))), 1) + 1
    points = xy_world[:, None] + way[:, None] * np.linspace(0.0, 1.0, count)[:, None]
    cells = layout.cells(points)
    inside = ((cells >= 0) & (cells < layout.walls.shape)).all(axis=-1)
    wall = np.zeros(inside.shape, dtype=np.bool_)
    wall[inside] = layout.walls[tuple(cells[inside].T)]
    if but is not None:
        wall &= ~((points >= but[0]) & (points <= but[1])).all(axis=-1)
    return np.asarray(wall.mean(axis=1) * lengths)


def _free_around(low: FloatArray, high: FloatArray, step_m: float, grid: Grid) -> FloatArray:
    """(N, 2) free points of a lattice over a box; the lattice is that of the world, so that the same places come up again."""
    ticks = [(np.arange(np.floor(a / step_m), np.floor(b / step_m) + 1) + 0.5) * step_m for a, b in zip(low, high, strict=True)]
    xy = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    return xy[grid.is_free(xy)] if len(xy) else xy


def _samples(path_world: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points (N, 2) along a path, and where each is, as a fractional index of the path's points."""
    lengths_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path_world, axis=0), axis=1))])
    walked_m = np.linspace(0.0, lengths_m[-1], max(int(np.ceil(lengths_m[-1] / _SAMPLE_M)), 1) + 1)
    at = np.interp(walked_m, lengths_m, np.arange(len(path_world)))
    return np.column_stack([np.interp(walked_m, lengths_m, path_world[:, k]) for k in range(2)]), at


def _from_another_side(xy: FloatArray, middle: FloatArray, before: Sequence[FloatArray]) -> BoolArray:
    bearing = np.arctan2(xy[:, 1] - middle[1], xy[:, 0] - middle[0])
    other = np.ones(len(xy), dtype=np.bool_)
    for place in before:
        off = (bearing - heading_to(place, middle) + np.pi) % (2.0 * np.pi) - np.pi
        other &= np.abs(off) >= _OTHER_SIDE_RAD
    return other


def _best(xy: FloatArray, cost: FloatArray, from_xy: FloatArray, grid: Grid, most: int, apart_m: float) -> FloatArray:
    """The cheapest places that can be come to and are not side by side."""
    chosen: list[FloatArray] = []
    start = grid.nearest_free(from_xy, np.inf)
    for k in np.argsort(cost, kind="stable"):
        if len(chosen) == most or start is None:
            break
        if all(np.linalg.norm(xy[k] - other) >= apart_m for other in chosen) and grid.same_part(start, xy[k]):
            chosen.append(xy[k])
    return np.array(chosen).reshape(-1, 2)
