"""Ways to where something can be seen, and to right before it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor, Layout, Place
from seo_slam.abstraction.joined_layouts import joined
from seo_slam.errors import NoPathError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.looking import Eye, places_near, viewpoints
from seo_slam.navigation.motion import path_length_m
from seo_slam.navigation.parts import Grid, Planner

_WORSE_VIEW_M = 0.5  # the next best place to look from is taken if its way is so much shorter
_PLACES_TO_STOP = 3
_BLUR_M = 0.1  # by so much the cells of a thing reach beyond its box
_LOCAL_M = 2.5  # what is farther off is not the last stretch


@dataclass(slots=True, eq=False)
class Ways:
    """The floor, and those who find ways over it.

    Attributes:
        layout: what hides as its walls, see ``looking.what_hides``; and rooms.
        grid: where the robot may be.
        far: the global planner (Voronoi).
        near: the local planner (RRT*).
        floor: what ``grid`` was made of, where it grows with what is seen.
        plan: makes grid and planners of a layout; None: the floor stays as it is.
    """

    layout: Layout
    grid: Grid
    far: Planner
    near: Planner
    floor: Layout | None = None
    plan: Callable[[Layout], tuple[Grid, Planner, Planner]] | None = None

    def grow(self, seen: Layout) -> bool:
        """Take in floor that was seen on the way and that the map does not know; return whether there is any.

        What the map calls an obstacle or a wall stays one, and so does what is seen to be one now.
        """
        if self.plan is None or self.floor is None:
            return False
        grown = joined(self.floor, seen)
        if all(getattr(grown, name).sum() == getattr(self.floor, name).sum() for name in ("floor", "obstacles", "walls")):
            return False
        self.floor = grown
        self.grid, self.far, self.near = self.plan(grown)
        return True

    def to_see(
        self,
        anchor: Anchor,
        eye: Eye,
        from_xy: FloatArray,
        before: Sequence[FloatArray] = (),
        z_m: float | None = None,
        last_seen: Place | None = None,
    ) -> FloatArray:
        """Return a path (N, 2) to a place from which an anchor's top is seen.

        Args:
            anchor: what to look at.
            eye: of the robot.
            from_xy: (2,) where the robot is.
            before: places that it was looked at from.
            z_m: height that is to be in view; None: that of its top.
            last_seen: where on it something was seen last.

        Raises:
            NoPathError: there is no such place, or no way leads to any.
        """
        places = viewpoints(anchor, eye, from_xy, self.grid, self.layout, before, z_m, last_seen)
        if not len(places):
            raise NoPathError(f"no free floor from which the {anchor.label} {anchor.id} is seen can be come to")
        paths: list[tuple[float, FloatArray]] = []
        reason = ""
        for rank, place in enumerate(places):
            try:
                path = self.far.path(from_xy, place)
                paths.append((path_length_m(path) + rank * _WORSE_VIEW_M, path))
            except NoPathError as error:
                reason = reason or str(error)
        if not paths:
            raise NoPathError(reason)
        return min(paths, key=lambda pair: pair[0])[1]

    def to_stop(
        self, target_xy: FloatArray, from_xy: FloatArray, within_m: float, box: tuple[FloatArray, FloatArray] | None = None
    ) -> FloatArray:
        """Return a path (N, 2) to the free place nearest to a thing: by the local planner, from where the robot is.

        The global planner is asked where that finds none among its samples, and first where the thing is far off. ``box`` is the thing's
        own, low and high corner (2,).

        Raises:
            NoPathError: there is no free place within ``within_m``, or no way leads to the nearest few.
        """
        places = places_near(target_xy, within_m, from_xy, self.grid, self.layout, _grown(box))
        if not len(places):
            raise NoPathError(f"no free floor within {within_m} m of ({target_xy[0]:.2f}, {target_xy[1]:.2f}) can be come to")
        reason = ""
        for place in places[:_PLACES_TO_STOP]:
            if np.linalg.norm(place - from_xy) < 1e-6:
                return np.stack([from_xy, place])
            last_stretch = np.linalg.norm(place - from_xy) <= _LOCAL_M
            for planner in (self.near, self.far) if last_stretch else (self.far, self.near):
                try:
                    return planner.path(from_xy, place)
                except NoPathError as error:
                    reason = reason or str(error)
        raise NoPathError(reason)


def _grown(box: tuple[FloatArray, FloatArray] | None) -> tuple[FloatArray, FloatArray] | None:
    return None if box is None else (box[0] - _BLUR_M, box[1] + _BLUR_M)
