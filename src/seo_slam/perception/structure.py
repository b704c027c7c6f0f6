"""Segments that are walls, floor or ceiling, told by their shape: otherwise a map of everything fills with pieces of wall.

A segment is structure if it is flat, and one of these holds:

1. it, with all segments in the same plane, is larger both ways than any furniture;
2. it is large both ways, and cut by a border of the image;
3. nothing that the camera sees lies behind its plane (a room's walls, floor and ceiling bound what is seen; the top of a table has the
   floor behind it, the front of a cupboard the wall), and it is not small;
4. it lies in the plane of one that is structure by 1 to 3.

The plane is told from depth in the camera frame, so that neither a pose nor gravity is needed. What is left are small pieces of walls seen
through a door, and the reveals of doors. What is lost: a flat thing without a word that fills the view, such as a table top seen from
close by, in that frame; and what lies flat against a wall or on the floor, such as a poster, for good, unless the detector has a word
for it.
"""

from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.settings.hybrid import StructureSettings
from seo_slam.types import BoolArray, Frame, IntArray

_GRID_POINTS = 20_000
_SEGMENT_POINTS = 250
_IMAGE_POINTS = 2500
_FEWEST_POINTS = 12
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
    points, per_mask = _points(masks, frame)
    planes = {}
    for row, pixels in enumerate(per_mask):
        plane = _flat(points[pixels], settings)
        if plane is not None:
            planes[row] = plane
    if not planes:
        return out
    scene = points[:: max(1, len(points) // _IMAGE_POINTS)]
    together = {row: [other for other in planes if _coplanar(plane, planes[other], settings)] for row, plane in planes.items()}
    for row, plane in planes.items():
        out[row] = _bounds_the_view(plane, masks[row], scene, settings)
        if not out[row]:
            whole = np.concatenate([planes[other].p_camera for other in together[row]])
            out[row] = _extents_m(whole, plane.normal)[1] >= settings.large_m
    for found in np.flatnonzero(out).tolist():
        out[together[found]] = True
    return out


def _bounds_the_view(plane: _Plane, mask: BoolArray, scene: FloatArray, settings: StructureSettings) -> bool:
    """Whether a flat segment is cut by a border and large, or has nothing behind it and is not small."""
    long_m, short_m = _extents_m(plane.p_camera, plane.normal)
    is_cut = bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())
    if short_m >= settings.cut_m and is_cut:
        return True
    return long_m >= settings.outermost_m and _share_behind(plane, scene, settings) <= settings.behind_share


def _points(masks: BoolArray, frame: Frame) -> tuple[FloatArray, list[IntArray]]:
    """Points (M, 3) on a grid over the image, camera frame, and for each mask the rows of some that are in it."""
    step = max(1, round(float(np.sqrt(frame.depth_m.size / _GRID_POINTS))))
    depth_m = frame.depth_m[::step, ::step]
    known = depth_m > 0
    z = depth_m[known].astype(np.float64)
    points = np.column_stack([frame.camera.rays()[::step, ::step][known] * z[:, None], z])
    inside = [np.flatnonzero(own) for own in masks[:, ::step, ::step][:, known]]
    return points, [rows[:: max(1, -(-len(rows) // _SEGMENT_POINTS))] for rows in inside]


def _flat(p_camera: FloatArray, settings: StructureSettings) -> _Plane | None:
    """The plane of points, if so many lie in it; fitted once more without those that do not."""
    if len(p_camera) < _FEWEST_POINTS:
        return None
    near_m = _tolerance_m(p_camera, settings)
    plane = _fitted(p_camera)
    off_m = np.abs(plane.heights_m(p_camera))
    fits = off_m <= np.maximum(near_m, np.median(off_m))
    if not fits.all():
        plane = _fitted(p_camera[fits])
        off_m = np.abs(plane.heights_m(p_camera))
    is_flat = np.count_nonzero(off_m <= near_m) >= settings.planar_share * len(p_camera)
    return _Plane(p_camera, plane.normal, plane.offset_m) if is_flat else None


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
