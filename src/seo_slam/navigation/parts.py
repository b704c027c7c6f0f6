"""What a navigator is made of, as shapes, and what it takes where nothing else is given."""

from collections.abc import Callable, Sequence
from typing import Protocol

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.geometry import FloatArray
from seo_slam.records import StepResult
from seo_slam.types import BoolArray, Frame, Landmark


class LocalMap(Protocol):
    """The concrete map of what was seen on the way, such as ``Map``; one that has ``tentative`` landmarks too is asked for them."""

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """The stable ones."""
        ...


class Mapper(Protocol):
    """Builds the local concrete map, such as ``Pipeline``. Its poses must be in the frame of the abstract map."""

    def step(self, frame: Frame) -> StepResult:
        """Process one frame."""
        ...

    def snapshot(self) -> LocalMap:
        """Return the map as it is now."""
        ...


class Grid(Protocol):
    """The free floor, such as ``NavigationGrid``; points are (2,) or (N, 2), world frame, metres."""

    def is_free(self, xy_world: FloatArray) -> BoolArray:
        """Return (N,) whether a robot's middle may be at points (N, 2)."""
        ...

    def is_clear(self, a_world: FloatArray, b_world: FloatArray) -> bool:
        """Whether it may drive straight from one point to another."""
        ...

    def nearest_free(self, xy_world: FloatArray, within_m: float) -> FloatArray | None:
        """Return the nearest point where it may be."""
        ...

    def way_in(self, xy_world: FloatArray, within_m: float) -> FloatArray | None:
        """Return where a robot that stands outside the free floor, or on an island of it, comes to the large part of it."""
        ...

    def same_part(self, a_world: FloatArray, b_world: FloatArray) -> bool:
        """Whether free floor connects two points."""
        ...


class Planner(Protocol):
    """Finds ways."""

    def path(self, start_xy: FloatArray, goal_xy: FloatArray) -> FloatArray:
        """Return a path (N, 2), both ends included.

        Raises:
            NoPathError: there is none.
        """
        ...


Abstracting = Callable[[Sequence[Landmark]], AbstractMap]
"""Landmarks of the local map to anchors (DualMap IV-A)."""
Updating = Callable[[AbstractMap, AbstractMap], AbstractMap]
"""The old abstract map and what was seen to the new one (DualMap IV-D)."""
