"""Solids that rays are cast at: box, ellipsoid, frustum, torus and the inside of a room.

Each lives in a frame of its own, with its centre at the origin; lengths in metres. A renderer asks for the distance along rays
first and for the normals of the few points that are seen afterwards.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.tessellation import Triangles, cuboid, revolved, turns_for

NEAREST_M = 1e-6  # hits closer than this are the surface that the ray starts from


class Shape(ABC):
    """A solid. Subclass it for shapes of your own."""

    is_mesh: ClassVar[bool] = False
    """Whether only the Embree renderer can draw it."""

    @abstractmethod
    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:
        """Cast rays.

        Args:
            p_shape: (3,) or (N, 3) ray starts, shape frame.
            directions: (N, 3), of any length.

        Returns:
            (N,) the least ``t > 0`` at which ``p_shape + t * directions`` lies on the surface; infinity where there is none.
        """

    @abstractmethod
    def normals(self, p_shape: FloatArray) -> FloatArray:
        """Return (N, 3) outward unit normals at points (N, 3) of the surface."""

    @abstractmethod
    def support(self, direction: FloatArray) -> float:
        """Return the largest ``p @ direction`` over the points p of the shape: how far it reaches that way."""

    def triangles(self) -> Triangles:
        """Return vertices (V, 3), shape frame, and faces (F, 3): the surface for renderers that know triangles only.

        Raises:
            ConfigError: this shape has none.
        """
        raise ConfigError(f"{type(self).__name__}: got no triangles; override triangles() to draw it with Embree")

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the low and the high corner (3,) of its box, shape frame."""
        axes = np.eye(3)
        return (
            np.array([-self.support(-axis) for axis in axes]),
            np.array([self.support(axis) for axis in axes]),
        )


def _require_positive(shape: str, *sizes: float) -> None:
    if not np.isfinite(sizes).all() or min(sizes) <= 0:
        raise ConfigError(f"{shape}: got sizes {sizes}, wanted metres above 0")


def _slabs(p: FloatArray, d: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where rays enter and leave a box (Kay and Kajiya's slabs); entered after left means missed."""
    enter, leave = np.full(len(d), -np.inf), np.full(len(d), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):  # axis by axis: many times faster than reducing rows of three
            inverse = 1.0 / d[:, axis]
            a, b = (-half[axis] - p[..., axis]) * inverse, (half[axis] - p[..., axis]) * inverse
            # fmin and fmax pass over 0 * inf: the ray runs in the face itself; the other axes decide.
            enter, leave = np.fmax(enter, np.fmin(a, b)), np.fmin(leave, np.fmax(a, b))
    return enter, leave


def _face_normals(p: FloatArray, half: FloatArray) -> FloatArray:
    x, y, z = (np.abs(p[:, k]) / half[k] for k in range(3))
    axis = np.where(x > y, np.where(x > z, 0, 2), np.where(y > z, 1, 2))
    out = np.zeros_like(p)
    rows = np.arange(len(p))
    out[rows, axis] = np.where(p[rows, axis] < 0, -1.0, 1.0)
    return out


@dataclass(frozen=True, slots=True)
class Box(Shape):
    """A cuboid with edges ``size_m`` (x, y, z)."""

    size_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        _require_positive("box", *self.size_m)

    @property
    def _half(self) -> FloatArray:
        return np.array(self.size_m) / 2.0

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:  # noqa: D102
        enter, leave = _slabs(p_shape, directions, self._half)
        t = np.where(enter > NEAREST_M, enter, leave)
        return np.where((enter <= leave) & (t > NEAREST_M), t, np.inf)

    def normals(self, p_shape: FloatArray) -> FloatArray:  # noqa: D102
        return _face_normals(p_shape, self._half)

    def triangles(self) -> Triangles:  # noqa: D102
        return cuboid(self.size_m)

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        return float(np.abs(direction) @ self._half)


@dataclass(frozen=True, slots=True)
class RoomBox(Shape):
    """The inside of a cuboid: walls, floor and ceiling, seen from within. Rays from outside pass the near walls."""

    size_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        _require_positive("room", *self.size_m)

    @property
    def _half(self) -> FloatArray:
        return np.array(self.size_m) / 2.0

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:  # noqa: D102
        enter, leave = _slabs(p_shape, directions, self._half)
        return np.where((enter <= leave) & (leave > NEAREST_M), leave, np.inf)

    def normals(self, p_shape: FloatArray) -> FloatArray:  # noqa: D102
        return -_face_normals(p_shape, self._half)

    def triangles(self) -> Triangles:
        """See ``Shape``; faces turn inward."""
        vertices, faces = cuboid(self.size_m)
        return vertices, faces[:, ::-1]

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        return float(np.abs(direction) @ self._half)


@dataclass(frozen=True, slots=True)
class Ellipsoid(Shape):
    """An ellipsoid with half axes ``radii_m``; a ball if they are equal.

    With ``flat_bottom`` only its upper half is there (z >= 0), closed by nothing below: it is made to stand on something.
    """

    radii_m: tuple[float, float, float]
    flat_bottom: bool = False

    def __post_init__(self) -> None:
        _require_positive("ellipsoid", *self.radii_m)

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:  # noqa: D102
        radii = np.array(self.radii_m)
        o, d = p_shape / radii, directions / radii
        near, far = _quadratic_roots(row_dots(d, d), row_dots(d, o), row_dots(o, o) - 1.0)
        if not self.flat_bottom:
            return _first(near, far)
        with np.errstate(invalid="ignore"):  # a level ray that misses: infinity times 0
            return _first(*(np.where(p_shape[..., 2] + t * directions[:, 2] >= 0, t, np.inf) for t in (near, far)))

    def normals(self, p_shape: FloatArray) -> FloatArray:  # noqa: D102
        return _unit(p_shape / np.square(self.radii_m))

    def triangles(self) -> Triangles:  # noqa: D102
        turns = turns_for(max(self.radii_m))
        low = 0.0 if self.flat_bottom else -np.pi / 2
        angle = np.linspace(low, np.pi / 2, turns // (4 if self.flat_bottom else 2) + 1)
        vertices, faces = revolved(np.cos(angle), np.sin(angle), turns)
        return vertices * np.array(self.radii_m), faces

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        reach = np.array(self.radii_m) * direction
        if self.flat_bottom and direction[2] < 0:
            reach[2] = 0.0  # the widest circle is the rim of the flat bottom
        return float(np.linalg.norm(reach))


@dataclass(frozen=True, slots=True)
class Frustum(Shape):
    """A cone cut off twice, its axis along z: cylinder, cup, lamp shade.

    Attributes:
        bottom_radius_m, top_radius_m, height_m: its size; the walls have no thickness.
        bottom, top: whether it is closed there. An open one can be looked into.
    """

    bottom_radius_m: float
    top_radius_m: float
    height_m: float
    bottom: bool = True
    top: bool = True

    def __post_init__(self) -> None:
        _require_positive("frustum", self.bottom_radius_m, self.top_radius_m, self.height_m)

    @property
    def _slope(self) -> float:
        return (self.top_radius_m - self.bottom_radius_m) / self.height_m

    @property
    def _middle_radius_m(self) -> float:
        return (self.top_radius_m + self.bottom_radius_m) / 2.0

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:  # noqa: D102
        k, half = self._slope, self.height_m / 2.0
        (ox, oy, oz), (dx, dy, dz) = np.moveaxis(p_shape, -1, 0), np.moveaxis(directions, -1, 0)
        radius = self._middle_radius_m + k * oz
        near, far = _quadratic_roots(
            dx * dx + dy * dy - (k * dz) ** 2,
            ox * dx + oy * dy - k * dz * radius,
            ox * ox + oy * oy - radius**2,
        )
        with np.errstate(invalid="ignore"):  # a level ray that misses: infinity times 0, which is nowhere on the wall
            best = _first(*(np.where(np.abs(oz + t * dz) <= half, t, np.inf) for t in (near, far)))
        caps = ((self.bottom, -half, self.bottom_radius_m), (self.top, half, self.top_radius_m))
        for closed, z, cap_radius in caps:
            if closed:
                with np.errstate(divide="ignore", invalid="ignore"):
                    t = (z - oz) / dz
                    inside = (t > NEAREST_M) & ((ox + t * dx) ** 2 + (oy + t * dy) ** 2 <= cap_radius**2)
                best = np.where(inside, np.minimum(best, t), best)
        return best

    def normals(self, p_shape: FloatArray) -> FloatArray:  # noqa: D102
        x, y, z = p_shape.T
        across = np.hypot(x, y)
        wall = np.abs(across - (self._middle_radius_m + self._slope * z))
        side = np.stack([x, y, -self._slope * across], axis=-1)
        cap = np.stack([np.zeros_like(z), np.zeros_like(z), np.sign(z)], axis=-1)
        on_cap = np.abs(np.abs(z) - self.height_m / 2.0) < wall
        return np.where(on_cap[:, None], cap, _unit(side))

    def triangles(self) -> Triangles:  # noqa: D102
        low, high, half = self.bottom_radius_m, self.top_radius_m, self.height_m / 2.0
        profile = [(0.0, -half)] * self.bottom + [(low, -half), (high, half)] + [(0.0, half)] * self.top
        radius, z = np.array(profile).T
        return revolved(radius, z, turns_for(max(low, high)))

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        across, up = float(np.hypot(direction[0], direction[1])), float(direction[2]) * self.height_m / 2.0
        return max(self.bottom_radius_m * across - up, self.top_radius_m * across + up)


def cylinder(radius_m: float, height_m: float) -> Frustum:
    """Return a closed cylinder along z."""
    return Frustum(radius_m, radius_m, height_m)


@dataclass(frozen=True, slots=True)
class Torus(Shape):
    """A ring around the z axis: ``ring_radius_m`` to the middle of a tube of ``tube_radius_m``."""

    ring_radius_m: float
    tube_radius_m: float

    def __post_init__(self) -> None:
        _require_positive("torus", self.ring_radius_m, self.tube_radius_m)

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:
        """See ``Shape``. Walks along the ray by the distance to the surface, to within 1e-6 m."""
        length = np.sqrt(row_dots(directions, directions))
        d = directions / length[:, None]
        low, high = self.bounds()
        enter, leave = _slabs(p_shape, d, (high - low) / 2.0 + 1e-3)
        walking, hit = (enter <= leave) & (leave > 0), np.zeros(len(d), dtype=np.bool_)
        t = np.maximum(np.where(walking, enter, 0.0), 2.0 * NEAREST_M)
        for _ in range(64):
            if not walking.any():
                break
            gap = self._distance(p_shape + t[:, None] * d)
            hit |= walking & (gap < 1e-6)
            walking &= ~hit & (t <= leave)
            t = np.where(walking, t + gap, t)
        return np.where(hit, t / length, np.inf)

    def _distance(self, p: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(np.hypot(p[:, 0], p[:, 1]) - self.ring_radius_m, p[:, 2]) - self.tube_radius_m)

    def normals(self, p_shape: FloatArray) -> FloatArray:  # noqa: D102
        across = np.maximum(np.hypot(p_shape[:, 0], p_shape[:, 1]), 1e-12)
        middle = p_shape * np.array([1.0, 1.0, 0.0]) * (self.ring_radius_m / across)[:, None]
        return _unit(p_shape - middle)

    def triangles(self) -> Triangles:  # noqa: D102
        angle = np.linspace(0.0, 2.0 * np.pi, turns_for(self.tube_radius_m) + 1)
        radius = self.ring_radius_m + self.tube_radius_m * np.cos(angle)
        return revolved(radius, self.tube_radius_m * np.sin(angle), turns_for(self.ring_radius_m + self.tube_radius_m))

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        across = float(np.hypot(direction[0], direction[1]))
        return self.ring_radius_m * across + self.tube_radius_m * float(np.linalg.norm(direction))


def _quadratic_roots(a: FloatArray, half_b: FloatArray, c: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Both roots of ``a t^2 + 2 half_b t + c``, without cancellation; infinity where there are none."""
    under = half_b * half_b - a * c
    with np.errstate(invalid="ignore", divide="ignore"):
        q = -(half_b + np.copysign(np.sqrt(under), half_b))
        first, second = q / a, c / q
    missed = under < 0
    return (
        np.where(missed | ~np.isfinite(first), np.inf, first),
        np.where(missed | ~np.isfinite(second), np.inf, second),
    )


def _first(*roots: FloatArray) -> FloatArray:
    return np.asarray(np.minimum.reduce([np.where(t > NEAREST_M, t, np.inf) for t in roots]))


def row_dots(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the dot products (N,) of the rows of two arrays, either (3,) or (N, 3)."""
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def _unit(v: FloatArray) -> FloatArray:
    return np.asarray(v / np.maximum(np.sqrt(row_dots(v, v)), 1e-12)[:, None])
