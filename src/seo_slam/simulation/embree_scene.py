"""Triangles of a world in Embree's tree, and rays at them. Needs the extra ``sim``."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.simulation.primitives import RoomBox
from seo_slam.simulation.world import Part
from seo_slam.types import BoolArray

Floats32 = NDArray[np.float32]
Ints32 = NDArray[np.int32]

_STEP_M = 1e-4  # beyond a wall that is passed from outside


@dataclass(frozen=True, slots=True, eq=False)
class TriangleHits:
    """The nearest triangle of each of N rays.

    Attributes:
        t: (N,) in lengths of the direction; infinity where there is none.
        geometry: (N,) index of the shape in the order given; -1 where there is none.
        triangle: (N,) index of the triangle in its shape.
        u, v: (N,) barycentric weights of its second and third corner.
        normals: (N, 3) at right angles to the triangle, of any length.
    """

    t: Floats32
    geometry: Ints32
    triangle: Ints32
    u: Floats32
    v: Floats32
    normals: Floats32

    def take(self, others: "TriangleHits", where: BoolArray) -> None:
        """Take over some hits (N,) of others, in place; ``geometry`` then counts in two scenes."""
        for own, other in ((self.t, others.t), (self.geometry, others.geometry), (self.triangle, others.triangle)):
            np.copyto(own, other, where=where)
        np.copyto(self.u, others.u, where=where)
        np.copyto(self.v, others.v, where=where)
        np.copyto(self.normals, others.normals, where=where[:, None])


class RayScene:
    """A tree over the triangles of shapes, each at its own pose."""

    def __init__(self, placed: list[tuple[Part, FloatArray]]) -> None:
        """Build it once: parts, each with ``T_scene_part`` (4, 4)."""
        self._scene = EmbreeScene()
        self._meshes = []
        for part, T in placed:
            vertices, faces = part.shape.triangles()
            corners = np.empty((len(vertices), 3), dtype=np.float32)
            for axis in range(3):
                corners[:, axis] = vertices[:, 0] * T[axis, 0] + vertices[:, 1] * T[axis, 1] + vertices[:, 2] * T[axis, 2] + T[axis, 3]
            self._meshes.append(TriangleMesh(self._scene, corners, faces.astype(np.int32)))
        self._one_sided = np.array([isinstance(part.shape, RoomBox) for part, _ in placed] + [False])
        if placed:
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds the tree here, not in some thread

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to hit."""
        return not self._meshes

    def cast(self, origins: Floats32, directions: Floats32) -> TriangleHits:
        """Return the nearest hits of rays from (N, 3) along (N, 3); a room's walls are passed from outside."""
        hits = self._nearest(origins, directions)
        if self._one_sided.any():
            for _ in range(8):
                outside = np.flatnonzero(self._one_sided[hits.geometry])
                d, n = directions[outside], hits.normals[outside]
                outside = outside[d[:, 0] * n[:, 0] + d[:, 1] * n[:, 1] + d[:, 2] * n[:, 2] > 0]
                if not len(outside):
                    break
                self._pass(hits, outside, origins, directions)
        return hits

    def blocked(self, origins: Floats32, directions: Floats32) -> BoolArray:
        """Return (N,) whether anything at all lies on each ray from (N, 3) along (N, 3), or (3,) if all are parallel."""
        if not self._meshes or not len(origins):
            return np.zeros(len(origins), dtype=np.bool_)
        along = np.empty_like(origins)
        along[:] = directions
        return np.asarray(self._scene.run(origins, along, query="OCCLUDED") >= 0)

    def _nearest(self, origins: Floats32, directions: Floats32) -> TriangleHits:
        count = len(origins)
        if not self._meshes or not count:
            none = np.zeros(count, dtype=np.float32)
            nothing = np.full(count, -1, dtype=np.int32)
            return TriangleHits(none + np.float32(np.inf), nothing, nothing.copy(), none, none.copy(), np.zeros((count, 3), np.float32))
        found = self._scene.run(origins, directions, output=True)
        t = np.where(found["geomID"] < 0, np.float32(np.inf), found["tfar"])
        return TriangleHits(t, found["geomID"], found["primID"], found["u"], found["v"], found["Ng"])

    def _pass(self, hits: TriangleHits, rows: NDArray[np.int64], origins: Floats32, directions: Floats32) -> None:
        """Cast some rays again from beyond their hit, in place."""
        d = directions[rows]
        length = np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2 + d[:, 2] ** 2)
        start = hits.t[rows] + np.float32(_STEP_M) / length
        beyond = self._nearest(origins[rows] + d * start[:, None], d)
        hits.t[rows] = beyond.t + start
        hits.geometry[rows], hits.triangle[rows] = beyond.geometry, beyond.triangle
        hits.u[rows], hits.v[rows], hits.normals[rows] = beyond.u, beyond.v, beyond.normals


@lru_cache(maxsize=512)
def own_scene(parts: tuple[Part, ...]) -> RayScene:
    """Return the tree of one thing's parts in its own frame; made once for all things and worlds that share the parts."""
    return RayScene([(part, part.T_thing_part) for part in parts])


def turned(v: NDArray[np.floating], R: FloatArray) -> FloatArray:
    """Return ``R @ v`` for rows v (N, 3), written out: a matrix product would wake the threads of the linear algebra library."""
    out = np.empty((3, len(v)))
    for row, (a, b, c) in zip(out, R, strict=True):
        np.multiply(v[:, 0], a, out=row)
        row += b * v[:, 1]
        row += c * v[:, 2]
    return out.T
