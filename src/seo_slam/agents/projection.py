"""Landmarks into the image, as agents are to see them (SEO-SLAM III-C).

The paper shows a landmark where ``z_C < z_D``, its depth is less than the image's. But a landmark lies on or behind the surface that was
measured, so that it would often hide itself. Here it is hidden only where most of it lies behind something that is nearer than the whole
thing by more than a tolerance. Where the camera sees farther than the landmark, it may be gone: it gets a box, for agents to judge.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.mapping.sight import TOLERANCE_M, TOLERANCE_SIGMAS
from seo_slam.perception.boxes import areas, intersections
from seo_slam.types import BoolArray, Frame, IntArray, Landmarks

MOST_HIDDEN = 0.5
"""Share of a thing that may be behind something nearer."""

LEAST_INSIDE = 0.7
"""Share of a box that must be in the image; the projected centre of the thing must be, too (u_C, v_C in III-C)."""

NEAREST_CORNER = 0.3
"""The corners of a box are at least at this share of the depth of its centre."""

FILLS_IMAGE = 0.25
"""… or the part of it that is must take so much of the image: a table is recognised without its edges."""

LEAST_SIDE_PX = 8.0
"""A box whose longer side is shorter is left out: nobody can tell what is in it."""

LEAST_DEPTH_M = 0.1

POSITION_SIGMAS = 2.0
"""Added to the tolerance: standard deviations of a landmark's position along the line of sight."""

MOST_SIGMA_M = 0.5
"""More than this is not known of a position; it must not make everything visible."""

LEAST_SIZE_M = 0.01

MOST_SURFACE_POINTS = 32
"""Points of a surface that are looked at; of more, evenly chosen ones."""

COVERED_SHARE = 0.7
"""A box of which more than this lies in a nearer one's box is left out of a drawing ..."""

COVERED_GAP_M = 0.5
"""... if it lies so much farther away; at less, the two may be one thing twice, and agents are to see both."""

_CORNERS = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
_SIDES = _CORNERS * [1.0, 1.0, 0.0]
_GRID = np.stack(np.meshgrid(*2 * [np.linspace(0.2, 0.8, 5)]), axis=-1).reshape(-1, 2)  # shares of a box's width and height


def visible_boxes(
    landmarks: Landmarks,
    frame: Frame,
    T_world_camera: FloatArray,
    surfaces: Mapping[int, FloatArray] | None = None,
    *,
    max_depth_m: float = 6.0,
    depth_noise_at_1m_m: float = 0.0019,
) -> dict[int, FloatArray]:
    """Return the boxes of the landmarks that are to be seen in a frame.

    A box is as wide and high as the thing usually is across the line of sight (the paper's ``o_W x o_H`` at its depth), or encloses its
    projected extent where that is unknown. Left out is what is behind the camera or beyond ``max_depth_m``, what is mostly hidden or
    outside the image, and boxes of a few pixels. A frame without depth shows nothing, since nobody could tell what is hidden in it.

    Args:
        landmarks: N of them, world frame.
        frame: the image and its depth.
        T_world_camera: (4, 4) pose of its camera.
        surfaces: landmark id -> (M, 3) points of its surface, world frame; where there are none, the middle of the box is looked at.
        max_depth_m: farther landmarks are left out.
        depth_noise_at_1m_m: the sensor's noise is this times depth squared.

    Returns:
        Landmark id -> (4,) box ``x0, y0, x1, y1`` in pixels, clipped to the image; in the order of ``landmarks``.
    """
    if len(landmarks) == 0 or not frame.has_depth:
        return {}
    T_camera_world = inverse(T_world_camera)
    p_camera = transform_points(T_camera_world, landmarks.p_world)
    rows = np.flatnonzero((p_camera[:, 2] > LEAST_DEPTH_M) & (p_camera[:, 2] <= max_depth_m))
    whole = _boxes(landmarks.size_m[rows], landmarks.across_m[rows], p_camera[rows], T_camera_world, frame.camera)
    large = _large_inside(whole, frame.camera.project(p_camera[rows]), frame.camera)
    rows, clipped = rows[large], _clipped(whole[large], frame.camera)
    if len(rows) == 0:
        return {}
    ids = landmarks.ids[rows].tolist()
    size_m = np.maximum(landmarks.size_m[rows], landmarks.across_m[rows].min(axis=1)[:, None])
    front_m = p_camera[rows, 2] - 0.5 * size_m @ np.abs(T_camera_world[2, :3])
    given = [surfaces.get(landmark_id) if surfaces else None for landmark_id in ids]
    samples = _samples(clipped, front_m, given, T_camera_world, frame.camera)
    variance_m2 = (landmarks.cov_world[rows] @ T_camera_world[2, :3]) @ T_camera_world[2, :3]
    sensor_m = TOLERANCE_M + TOLERANCE_SIGMAS * depth_noise_at_1m_m * p_camera[rows, 2] ** 2
    tolerance_m = sensor_m + POSITION_SIGMAS * np.minimum(np.sqrt(np.maximum(variance_m2, 0.0)), MOST_SIGMA_M)
    hidden = _hidden_share(samples, frame, samples.front_m - tolerance_m)
    return {i: box for i, box, share in zip(ids, clipped, hidden.tolist(), strict=True) if share <= MOST_HIDDEN}


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """S pixels (S, 2) to look at, the row of each (S,), and the depth (N,) of the nearest part of each thing."""

    uv: FloatArray
    rows: IntArray
    front_m: FloatArray


def _boxes(size_m: FloatArray, across_m: FloatArray, p_camera: FloatArray, T_camera_world: FloatArray, camera: Camera) -> FloatArray:
    """(N, 4), not clipped."""
    sides = _SIDES * np.concatenate([across_m, np.zeros((len(across_m), 1))], axis=1)[:, None, :]
    extent = _CORNERS * np.maximum(size_m, LEAST_SIZE_M)[:, None, :] @ T_camera_world[:3, :3].T
    known = np.asarray((across_m > 0).all(axis=1))
    corners = p_camera[:, None, :] + np.where(known[:, None, None], sides, extent)
    # A table reaches to the camera, or behind it; its near corners are cut off where they would be thrown out of any image.
    corners[..., 2] = np.maximum(corners[..., 2], NEAREST_CORNER * p_camera[:, None, 2])
    uv = camera.project(corners)
    return np.concatenate([uv.min(axis=1), uv.max(axis=1)], axis=1)


def _clipped(boxes_px: FloatArray, camera: Camera) -> FloatArray:
    return np.clip(boxes_px, 0.0, np.array([camera.width, camera.height, camera.width, camera.height], dtype=np.float64))


def _large_inside(boxes_px: FloatArray, middles_px: FloatArray, camera: Camera) -> BoolArray:
    """Which boxes (N, 4) of things with projected centres (N, 2) lie mostly in the image, and are large enough."""
    finite = np.asarray(np.isfinite(boxes_px).all(axis=1))
    whole = np.where(finite[:, None], boxes_px, [0.0, 0.0, 1.0, 1.0])
    inside = _clipped(whole, camera)
    central = np.asarray(((middles_px >= 0) & (middles_px < [camera.width, camera.height])).all(axis=1))
    large = (inside[:, 2:] - inside[:, :2]).max(axis=1) >= LEAST_SIDE_PX
    fills = areas(inside) >= FILLS_IMAGE * camera.width * camera.height
    mostly = fills | (areas(inside) >= LEAST_INSIDE * np.maximum(areas(whole), 1e-9))
    return np.asarray(finite & central & large & mostly, dtype=np.bool_)


def _samples(
    boxes_px: FloatArray, front_m: FloatArray, surfaces: list[FloatArray | None], T_camera_world: FloatArray, camera: Camera
) -> _Samples:
    """The surface's points where they are known, and then the nearest of them, else a grid in the middle of the box."""
    bare = np.array([row for row, points in enumerate(surfaces) if points is None or len(points) == 0], dtype=np.int64)
    boxes = boxes_px[bare, None]
    uv = [(boxes[..., :2] + _GRID * (boxes[..., 2:] - boxes[..., :2])).reshape(-1, 2)]
    rows = [np.repeat(bare, len(_GRID))]
    known = [
        (row, points[:: -(-len(points) // MOST_SURFACE_POINTS)])
        for row, points in enumerate(surfaces)
        if points is not None and len(points)
    ]
    if known:
        which, counts = np.array([row for row, _ in known], dtype=np.int64), np.array([len(points) for _, points in known])
        surface_camera = transform_points(T_camera_world, np.concatenate([points for _, points in known]))
        front_m = front_m.copy()
        front_m[which] = np.minimum.reduceat(surface_camera[:, 2], np.cumsum(counts) - counts)
        uv.append(camera.project(surface_camera))
        rows.append(np.repeat(which, counts))
    return _Samples(np.concatenate(uv), np.concatenate(rows), front_m)


def _hidden_share(samples: _Samples, frame: Frame, limit_m: FloatArray) -> FloatArray:
    """(N,) share of what the depth image knows of each thing that is nearer than its limit (N,); 0 where it knows nothing."""
    at = np.round(np.nan_to_num(samples.uv, nan=-1.0, posinf=-1.0, neginf=-1.0))
    inside = np.all((at >= 0) & (at < [frame.camera.width, frame.camera.height]), axis=1)
    column, row = np.where(inside[:, None], at, 0.0).astype(np.int64).T
    depth_m = np.where(inside, frame.depth_m[row, column], 0.0)
    known = depth_m > 0
    hidden = known & (depth_m < limit_m[samples.rows])
    n = len(limit_m)
    return np.bincount(samples.rows, hidden, n) / np.maximum(np.bincount(samples.rows, known, n), 1.0)


@dataclass(frozen=True, slots=True)
class Clearing:
    """Which boxes of a drawing stay, and which are left out; both in the order given."""

    kept: tuple[int, ...]
    left_out: tuple[int, ...]


def without_covered(boxes_px: Mapping[int, FloatArray], depth_m: Mapping[int, float]) -> Clearing:
    """Leave out boxes that mostly lie in the box of something much nearer, so that a drawing can be read.

    Args:
        boxes_px: landmark id -> (4,) box.
        depth_m: landmark id -> its depth.
    """
    ids = list(boxes_px)
    if len(ids) < 2:
        return Clearing(tuple(ids), ())
    boxes = np.array([boxes_px[i] for i in ids], dtype=np.float64).reshape(-1, 4)
    depths = np.array([depth_m[i] for i in ids], dtype=np.float64)
    covered = intersections(boxes, boxes) > COVERED_SHARE * np.maximum(areas(boxes), 1e-9)[:, None]
    behind = depths[:, None] > depths[None, :] + COVERED_GAP_M
    out = np.any(covered & behind, axis=1).tolist()
    return Clearing(
        tuple(i for i, gone in zip(ids, out, strict=True) if not gone), tuple(i for i, gone in zip(ids, out, strict=True) if gone)
    )
