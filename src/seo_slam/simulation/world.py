"""A world: things made of painted parts, and the structure around them.

World frame: z up, metres. A world never changes; a scene change makes another one (``without``, ``with_thing``).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray, require_transform
from seo_slam.simulation.primitives import Shape
from seo_slam.simulation.textures import Texture

ThingKind = Literal["volatile", "anchor", "fixed"]
"""volatile: people carry it about; anchor: furniture on which things stand; fixed: part of the building."""

STRUCTURE_ID = 0
"""In an instance image: no thing, but floor, wall, furniture, or nothing at all."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A shape, its paint, and where it sits in its thing.

    Attributes:
        shape, texture: what it looks like.
        T_thing_part: (4, 4).
        glow: share of its colour that needs no light (a screen).
    """

    shape: Shape
    texture: Texture
    T_thing_part: FloatArray
    glow: float = 0.0


@dataclass(frozen=True, eq=False)
class Thing:
    """An object with a name, or a piece of structure.

    Attributes:
        id: 1, 2, … in the instance image; ``STRUCTURE_ID`` for structure.
        label: its name.
        accepted_labels: other words that are right for it too.
        parts: what it is made of. The thing's frame has its base at z = 0 and its middle at x = y = 0.
        T_world_thing: (4, 4).

    Raises:
        ConfigError: no parts.
        FrameError: the pose is not rigid.
    """

    id: int
    label: str
    parts: tuple[Part, ...]
    T_world_thing: FloatArray
    accepted_labels: tuple[str, ...] = ()
    kind: ThingKind = "volatile"
    model: str = ""

    def __post_init__(self) -> None:
        if not self.parts:
            raise ConfigError(f"thing {self.id} ({self.label}): got no parts, wanted at least one")
        object.__setattr__(self, "T_world_thing", require_transform(self.T_world_thing, f"T_world_thing of {self.label}"))

    def at(self, T_world_thing: FloatArray) -> "Thing":
        """Return it at another pose."""
        return replace(self, T_world_thing=T_world_thing)

    @cached_property
    def bounds_thing(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (3,) of its box, thing frame."""
        return _bounds(self.parts, np.eye(4))

    @cached_property
    def bounds_world(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (3,) of its tight axis-aligned box, world frame."""
        return _bounds(self.parts, self.T_world_thing)

    @property
    def p_world(self) -> FloatArray:
        """(3,) centre of ``bounds_world``."""
        low, high = self.bounds_world
        return np.asarray((low + high) / 2.0)

    def corners_world(self) -> FloatArray:
        """Return the (8, 3) corners of its box (the one along its own axes), world frame."""
        low, high = self.bounds_thing
        corners = box_corners(low, high)
        return corners @ self.T_world_thing[:3, :3].T + self.T_world_thing[:3, 3]


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Parallel light and what comes from all around.

    Attributes:
        direction_world: (3,) unit vector towards the light.
        ambient: share of the brightness that reaches every surface, also in shadow.
    """

    direction_world: FloatArray
    ambient: float = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Everything there is.

    Attributes:
        things: what can be found, with ids 1, 2, …, all different.
        structure: what is only looked at: room, floor, desk; ``STRUCTURE_ID`` in the instance image.
        light: where the light comes from.
        gaze_world: (3,) point that a camera should look at, metres.

    Raises:
        ConfigError: an id is used twice, or is not above 0.
    """

    things: tuple[Thing, ...]
    structure: tuple[Thing, ...]
    light: Light
    gaze_world: FloatArray

    def __post_init__(self) -> None:
        ids = [thing.id for thing in self.things]
        if len(set(ids)) != len(ids) or any(i <= STRUCTURE_ID for i in ids):
            raise ConfigError(f"world: got ids {ids}, wanted different ones above {STRUCTURE_ID}")

    def thing(self, thing_id: int) -> Thing:
        """Return a thing by its id.

        Raises:
            ConfigError: there is none.
        """
        for thing in self.things:
            if thing.id == thing_id:
                return thing
        raise ConfigError(f"world: got thing {thing_id}, wanted one of {[thing.id for thing in self.things]}")

    def without(self, thing_id: int) -> "World":
        """Return the world with a thing taken away."""
        gone = self.thing(thing_id)
        return replace(self, things=tuple(thing for thing in self.things if thing is not gone))

    def with_thing(self, thing: Thing) -> "World":
        """Return the world with a thing added, or moved if its id is known."""
        return replace(self, things=(*(old for old in self.things if old.id != thing.id), thing))

    def __iter__(self) -> Iterator[Thing]:
        return iter((*self.structure, *self.things))


def box_corners(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the (8, 3) corners between two opposite ones."""
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def _bounds(parts: tuple[Part, ...], T: FloatArray) -> tuple[FloatArray, FloatArray]:
    lows, highs = [], []
    for part in parts:
        T_part = T @ part.T_thing_part
        lows.append([T_part[i, 3] - part.shape.support(-T_part[i, :3]) for i in range(3)])
        highs.append([T_part[i, 3] + part.shape.support(T_part[i, :3]) for i in range(3)])
    return np.min(lows, axis=0), np.max(highs, axis=0)
