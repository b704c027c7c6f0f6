"""The colours of what a band of rays meets.

Coordinates and colours are kept in rows of one kind each and in single precision: several times faster than rows of three.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.simulation.embree_scene import Floats32, Ints32, RayScene, TriangleHits, turned
from seo_slam.simulation.face_paint import FacePaint
from seo_slam.simulation.renderer import SKY
from seo_slam.simulation.world import Light, Part
from seo_slam.types import BoolArray, IntArray

Axes = tuple[Floats32, Floats32, Floats32]
"""x, y and z, (N,) each."""

_LIFT_M = np.float32(3e-4)  # rays towards the light start this far above the surface
_STEEPEST = np.float32(0.1)


@dataclass(slots=True, eq=False)
class Band:
    """N rays and what they meet; world frame.

    Attributes:
        start: (3,) where all rays start.
        directions: their directions.
        hits: the triangles they meet.
        part: (N,) which part that is; -1 for none.
        pixel_at_1m: width of a pixel at 1 m, metres.
        t: (N,) in lengths of the direction; 1 where nothing is met.
        normals: unit normals: of the triangle, until ``paint_round`` puts exact ones in place.
        slant: (N,) cosine between ray and normal.
        colours: (3, N), 0 to 255.
    """

    start: Floats32
    directions: Axes
    hits: TriangleHits
    part: Ints32
    pixel_at_1m: float
    t: Floats32
    normals: Axes
    slant: Floats32
    colours: Floats32

    @classmethod
    def of(cls, start: Floats32, directions: Floats32, hits: TriangleHits, part: Ints32, pixel_at_1m: float) -> "Band":
        """Return the band of rays (N, 3) and their hits, not yet painted."""
        along, normals = _axes(directions), _axes(hits.normals)
        shrink = 1 / np.sqrt(np.maximum(_dots(normals, normals), np.float32(1e-30)))
        for row in normals:
            row *= shrink
        slant = np.asarray(np.abs(_dots(normals, along)) / np.sqrt(_dots(along, along)), dtype=np.float32)
        t = np.where(part >= 0, hits.t, np.float32(1.0))
        return cls(start, along, hits, part, pixel_at_1m, t, normals, slant, np.empty((3, len(part)), dtype=np.float32))

    def footprint_m(self, rows: IntArray | slice) -> Floats32:
        """Return how much of the surface a pixel covers, for some rays."""
        return np.asarray(self.t[rows] * np.float32(self.pixel_at_1m) / np.sqrt(np.clip(self.slant[rows], _STEEPEST, np.float32(1.0))))


def paint_sky(band: Band) -> None:
    """Fill in the colours of rays that meet nothing."""
    band.colours[:, band.part < 0] = (255.0 * SKY)[:, None]


def paint_flat(band: Band, paint: FacePaint) -> None:
    """Fill in the colours of what is painted triangle by triangle."""
    covered = paint.covers[band.part]
    if not covered.any():
        return
    rows = slice(None) if covered.all() else np.flatnonzero(covered)
    weights = (band.hits.u[rows], band.hits.v[rows])
    band.colours[:, rows] = paint.colours(band.part[rows], band.hits.triangle[rows], weights, band.footprint_m(rows))


def paint_round(band: Band, covered: BoolArray, parts: Sequence[Part], poses: Sequence[FloatArray]) -> None:
    """Fill in the colours of the other shapes, one after the other, and their exact normals in place of the triangles'.

    Args:
        band: the rays.
        covered: (P + 1,) the parts that ``paint_flat`` paints.
        parts: all parts.
        poses: ``T_world_part`` (4, 4) of each.
    """
    rows = np.flatnonzero((band.part >= 0) & ~covered[band.part])
    rows = rows[np.argsort(band.part[rows], kind="stable")]
    for some in np.split(rows, np.flatnonzero(np.diff(band.part[rows])) + 1):
        if len(some):
            index = band.part[some[0]]
            _paint_one(band, some, parts[index], poses[index])


def _paint_one(band: Band, rows: IntArray, part: Part, T_world_part: FloatArray) -> None:
    R, far = T_world_part[:3, :3], band.t[rows].astype(np.float64)
    p_world = np.stack([start + d[rows] * far for start, d in zip(band.start, band.directions, strict=True)], axis=-1)
    p_part = turned(p_world - T_world_part[:3, 3], R.T)
    if part.shape.is_mesh:
        n_part = turned(np.stack([n[rows] for n in band.normals], axis=-1), R.T)
    else:
        n_part = part.shape.normals(p_part)
        exact = _axes(turned(n_part, R).astype(np.float32))
        along = tuple(d[rows] for d in band.directions)
        for row, values in zip(band.normals, exact, strict=True):
            row[rows] = values
        band.slant[rows] = np.abs(_dots(exact, along)) / np.sqrt(_dots(along, along))
    band.colours[:, rows] = 255.0 * part.texture.colours(p_part, n_part, band.footprint_m(rows).astype(np.float64)).T


def light_up(band: Band, light: Light, glow: Floats32, shading: RayScene | None) -> BoolArray:
    """Make colours as bright as they are in the light (Lambert's, hard shadows), in place.

    Args:
        band: painted.
        light: where it comes from.
        glow: (P + 1,) of each part.
        shading: what throws shadows; None for no shadows.

    Returns:
        (N,) whether light falls on each point.
    """
    to_light = light.direction_world.astype(np.float32)
    sign = np.where(_dots(band.normals, band.directions) > 0, np.float32(-1.0), np.float32(1.0))  # both sides of a triangle are seen
    facing = np.clip(_dots(band.normals, to_light) * sign, np.float32(0.0), np.float32(1.0))
    facing[band.part < 0] = 0.0
    lit = facing > 0
    if shading is not None:
        rows = np.flatnonzero(lit)
        lifted = np.empty((len(rows), 3), dtype=np.float32)
        lift, far = _LIFT_M * sign[rows], band.t[rows]
        for axis, (d, n) in enumerate(zip(band.directions, band.normals, strict=True)):
            lifted[:, axis] = band.start[axis] + d[rows] * far + n[rows] * lift
        lit[rows] = ~shading.blocked(lifted, to_light)
    own_light, ambient = glow[band.part], np.float32(light.ambient)
    brightness = ambient + (1 - ambient) * np.float32(1.25) * facing * lit
    band.colours *= own_light + (1 - own_light) * brightness
    return lit


def _axes(rows: Floats32) -> Axes:
    x, y, z = (np.ascontiguousarray(rows[:, axis]) for axis in range(3))
    return x, y, z


def _dots(a: Sequence[Floats32] | Floats32, b: Sequence[Floats32] | Floats32) -> Floats32:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2], dtype=np.float32)
