"""Segments that are walls, floor or ceiling, told by their shape: otherwise a map of everything fills with pieces of wall.

A segment is structure if it is flat, and either

1. it, with all segments in the same plane, is larger both ways than any furniture; or
2. nothing that the camera sees lies behind its plane (a room's walls, floor and ceiling bound what is seen; the top of a table has the
   floor behind it, the front of a cupboard the wall), and it is not small.

The plane is told from depth in the camera frame, so that neither a pose nor gravity is needed. A wall seen with an open door in view is
told by the first rule only. A flat thing that covers the view, such as a table top seen from close by, is taken for structure in that
frame: it has a word in others, or is seen from farther away.
"""

from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.settings.hybrid import StructureSettings
from seo_slam.types import BoolArray, Frame

_SEGMENT_POINTS = 250
_IMAGE_POINTS = 2500
_FEWEST_POINTS = 12
_REFITS = 2
_LIKE_NORMALS = float(np.cos(np.radians(6.0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    """Points (M, 3), and the plane ``normal @ p + offset = 0`` through them, the camera on its positive side."""

    p_camera: FloatArray
    normal: FloatArray
    offset_m: float

    def heights_m(self, p_camera: FloatArray) -> FloatArray:
        """(M,) how far points (M, 3) are on the camera's side of it."""
        return np.asarray(p_camera @ self.normal + self.offset_m, dtype=np.float64)


def is_structure(masks: BoolArray, frame: Frame, settings: StructureSettings) -> BoolArray:
    """Return (N,) which masks (N, H, W) of a frame are walls, floor or ceiling. Without depth: none."""
    out = np.zeros(len(masks), dtype=np.bool_)
    planes = {}
    for row, points in enumerate(_points_of(masks, frame)):
        plane = _flat(points, settings)
        if plane is not None:
            planes[row] = plane
    if not planes:
        return out
    scene = _points_of(np.ones((1, *frame.depth_m.shape), dtype=np.bool_), frame, _IMAGE_POINTS)[0]
    for row, plane in planes.items():
        together = [other.p_camera for other in planes.values() if _coplanar(plane, other, settings)]
        short_m = _extents_m(np.concatenate(together), plane.normal)[1]
        own_m = _extents_m(plane.p_camera, plane.normal)[0]
        outermost = own_m >= settings.outermost_m and _share_behind(plane, scene, settings) <= settings.behind_share
        out[row] = short_m >= settings.large_m or outermost
    return out


def _points_of(masks: BoolArray, frame: Frame, most: int = _SEGMENT_POINTS) -> list[FloatArray]:
    """Some points (M, 3) of each mask, camera frame."""
    rays = frame.camera.rays()
    known = frame.depth_m > 0
    points = []
    for mask in masks:
        pixels = np.flatnonzero(mask & known)
        chosen = pixels[:: max(1, -(-len(pixels) // most))]
        z = frame.depth_m.ravel()[chosen].astype(np.float64)
        xy = rays.reshape(-1, 2)[chosen] * z[:, None]
        points.append(np.column_stack([xy, z]))
    return points


def _flat(p_camera: FloatArray, settings: StructureSettings) -> _Plane | None:
    """The plane of points, if so many lie in it; fitted again without those that do not."""
    if len(p_camera) < _FEWEST_POINTS:
        return None
    near_m = _tolerance_m(p_camera, settings)
    plane = _fitted(p_camera)
    for _ in range(_REFITS):
        off_m = np.abs(plane.heights_m(p_camera))
        fits = off_m <= np.maximum(near_m, np.median(off_m))
        plane = _fitted(p_camera[fits])
    fits = np.abs(plane.heights_m(p_camera)) <= near_m
    return _Plane(p_camera, plane.normal, plane.offset_m) if fits.mean() >= settings.planar_share else None


def _fitted(p_camera: FloatArray) -> _Plane:
    middle = p_camera.mean(axis=0)
    off = p_camera - middle
    normal = np.linalg.eigh(off.T @ off)[1][:, 0]
    offset_m = float(-normal @ middle)
    side = -1.0 if offset_m < 0 else 1.0  # the camera is at the origin
    return _Plane(p_camera, side * normal, side * offset_m)


def _tolerance_m(p_camera: FloatArray, settings: StructureSettings) -> FloatArray:
    return np.maximum(settings.plane_m, settings.plane_share * p_camera[:, 2])


def _coplanar(a: _Plane, b: _Plane, settings: StructureSettings) -> bool:
    if a is b:
        return True
    if a.normal @ b.normal < _LIKE_NORMALS:
        return False
    near_m = 2.0 * _tolerance_m(b.p_camera, settings)
    return bool((np.abs(a.heights_m(b.p_camera)) <= near_m).mean() >= settings.planar_share)


def _extents_m(p_camera: FloatArray, normal: FloatArray) -> tuple[float, float]:
    """The longer and shorter extent of points (M, 3) in a plane, along their own axes, without the outermost twentieth."""
    across = np.linalg.svd(normal[None, :])[2][1:]
    flat = (p_camera - p_camera.mean(axis=0)) @ across.T
    axes = np.linalg.eigh(flat.T @ flat)[1]
    low, high = np.quantile(flat @ axes, (0.025, 0.975), axis=0)
    short_m, long_m = sorted((high - low).tolist())
    return long_m, short_m


def _share_behind(plane: _Plane, scene: FloatArray, settings: StructureSettings) -> float:
    """Share of the image's points behind a plane."""
    behind_m = np.maximum(settings.behind_m, 2.0 * settings.plane_share * scene[:, 2])
    return float((plane.heights_m(scene) < -behind_m).mean())
