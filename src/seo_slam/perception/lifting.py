"""From boxes or masks and a depth image to 3D measurements (SEO-SLAM III-A).

A box contains background. What belongs to the object is found in depth: pixels are weighted by a Gaussian around the box's centre
(an object fills the middle of its box, the corners show what is behind it), and of all depth windows as long as the object is wide the
one with the most weight is the object. A mask, where there is one, is used as it is, with the same window against its frayed edge.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from seo_slam.camera import Camera
from seo_slam.config import LiftingSettings
from seo_slam.geometry import FloatArray
from seo_slam.perception.boxes import truncated_sides
from seo_slam.perception.fusion import coincident, distinct
from seo_slam.perception.hidden_sides import hidden_sides
from seo_slam.types import BoolArray, Detections, Frame, Observations

CLOUD_POINTS = 200
"""Surface points kept of each object."""

UNSEEN_SIGMA_M = 0.05
"""How far the part of a thing outside the image may shift its centre, however little of it is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class _Lifted:
    p_camera: FloatArray
    cov_camera: FloatArray
    size_m: FloatArray
    cloud: FloatArray


def observe(detections: Detections, frame: Frame, settings: LiftingSettings) -> tuple[Observations, tuple[str, ...]]:
    """Measure every detected object in 3D.

    Returns:
        The observations, camera frame, without embeddings (``features`` makes them), and warnings in words (objects left out for want of
        depth are counted, not named).
    """
    chosen = np.flatnonzero((detections.scores >= settings.min_score) & distinct(detections, settings.duplicate_iou))
    if not len(chosen):
        return Observations.empty(), ()
    boxes = detections.boxes_px
    truncated = truncated_sides(boxes, frame.camera.width, frame.camera.height)
    rows: list[int] = []
    lifted: list[_Lifted] = []
    for row in chosen:
        mask = None if detections.masks is None or not detections.masks[row].any() else detections.masks[row]
        if mask is not None:
            truncated[row] |= hidden_sides(mask, frame.depth_m, boxes[row])
        one = _lift(boxes[row], mask, truncated[row], frame, settings)
        if one is not None:
            rows.append(int(row))
            lifted.append(one)
    left_out = len(chosen) - len(rows)
    warnings = (f"{left_out} of {len(chosen)} detections have too little depth to be placed",) if left_out else ()
    if not rows:
        return Observations.empty(), warnings
    labels = tuple(detections.labels[row] for row in rows)
    observations = Observations(
        p_camera=np.array([one.p_camera for one in lifted]),
        cov_camera=np.array([one.cov_camera for one in lifted]),
        size_m=np.array([one.size_m for one in lifted]),
        labels=labels,
        scores=detections.scores[rows].astype(np.float64),
        embeddings=np.zeros((len(rows), 0)),
        boxes_px=boxes[rows],
        truncated=truncated[rows],
        clouds=tuple(one.cloud for one in lifted),
        rows=np.array(rows, dtype=np.int64),
    )
    return (observations[~coincident(observations)] if settings.one_box_a_place else observations), warnings


def _lift(box_px: FloatArray, mask: BoolArray | None, truncated: BoolArray, frame: Frame, settings: LiftingSettings) -> _Lifted | None:
    camera = frame.camera
    side_px = box_px[2:] - box_px[:2]
    for step in _grid_steps(box_px, mask, frame, settings):
        uv, depth_m, weight, centre_px = _object_pixels(box_px, mask, frame, settings, step)
        inside = _surface(depth_m, weight, side_px, camera)
        if inside.stop - inside.start >= settings.min_points:
            break
    else:
        return None
    surface_m = _weighted_median(depth_m[inside], weight[inside])
    size_m = side_px / (camera.fx, camera.fy) * surface_m
    cloud = _cloud(uv[inside], depth_m[inside], camera)
    z = surface_m + (0.0 if mask is None else _behind_m(cloud, size_m))  # a box holds what lies behind as well
    x, y = _ray(centre_px, camera)
    return _Lifted(
        p_camera=np.array([x * z, y * z, z]),
        cov_camera=_covariance(x, y, z, size_m, truncated, settings),
        size_m=size_m,
        cloud=cloud,
    )


def _grid_steps(box_px: FloatArray, mask: BoolArray | None, frame: Frame, settings: LiftingSettings) -> Iterator[int]:
    """How many pixels apart to look: as far as suits the box, then nearer by, since a thin mask (a broom) fills little of its box."""
    x0, y0, x1, y1 = _patch(box_px, frame)
    step = max(1, int(np.ceil(np.sqrt(max(x1 - x0, 0) * max(y1 - y0, 0) / settings.max_points))))
    yield step
    while mask is not None and step > 1:
        step = (step + 1) // 2
        yield step


def _surface(depth_m: FloatArray, weight: FloatArray, side_px: FloatArray, camera: Camera) -> slice:
    """Which of the rising depths (M,) are the object's."""
    if not len(depth_m):
        return slice(0, 0)
    rough_m = float(np.sqrt(np.prod(side_px / (camera.fx, camera.fy)))) * _weighted_median(depth_m, weight)
    return densest_window(depth_m, weight, length_m=float(np.clip(0.5 * rough_m, 0.05, 1.0)))


def _patch(box_px: FloatArray, frame: Frame) -> tuple[int, int, int, int]:
    """Whole pixels of a box in the image: x0, y0, x1, y1."""
    height, width = frame.depth_m.shape
    x0, y0 = max(int(np.floor(box_px[0])), 0), max(int(np.floor(box_px[1])), 0)
    return x0, y0, min(int(np.ceil(box_px[2])), width), min(int(np.ceil(box_px[3])), height)


def _behind_m(cloud: FloatArray, size_m: FloatArray) -> float:
    """How far a thing's centre is expected behind its seen surface (M, 3).

    A flat surface is a sheet, or the face of a box: nothing is known. One that bulges is a body: half as far again as it bulges, at most
    a quarter of the shorter side. The bulge is the extent across the plane that fits best, as of points spread evenly.
    """
    bulge_m = float(np.sqrt(12.0 * max(np.linalg.eigvalsh(np.cov(cloud.T))[0], 0.0)))
    return 0.5 * min(bulge_m, 0.5 * float(size_m.min()))


def _object_pixels(
    box_px: FloatArray, mask: BoolArray | None, frame: Frame, settings: LiftingSettings, step: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Every ``step``-th pixel (M, 2) of box or mask that has depth, by rising depth; depths (M,), weights (M,), image centre (2,)."""
    x0, y0, x1, y1 = _patch(box_px, frame)
    patch = frame.depth_m[y0:y1:step, x0:x1:step]
    usable = (patch > 0) & (patch <= settings.max_depth_m)
    centre_px = 0.5 * (box_px[:2] + box_px[2:])
    if mask is not None:
        own = mask[y0:y1:step, x0:x1:step]
        if own.any():
            v_own, u_own = np.nonzero(own)
            centre_px = np.array([x0 + step * u_own.mean(), y0 + step * v_own.mean()])
        usable &= own
    v, u = np.nonzero(usable)
    depth_m = patch[v, u]
    order = np.argsort(depth_m, kind="stable")
    v, u = v[order], u[order]
    uv = np.stack([x0 + step * u, y0 + step * v], axis=1).astype(np.float64)
    spread_px = np.maximum(0.25 * (box_px[2:] - box_px[:2]), 1.0)
    off = (uv - 0.5 * (box_px[:2] + box_px[2:])) / spread_px
    weight = np.ones(len(uv)) if mask is not None else np.exp(-0.5 * np.sum(off * off, axis=1))
    return uv, depth_m[order].astype(np.float64), weight, centre_px


def densest_window(depth_m: FloatArray, weight: FloatArray, length_m: float) -> slice:
    """Return the range of the rising depths (M,) within ``length_m`` that holds the most weight (M,); the nearer one on a tie."""
    total = np.concatenate([[0.0], np.cumsum(weight)])
    ends = np.searchsorted(depth_m, depth_m + length_m, side="right")
    start = int(np.argmax(total[ends] - total[:-1]))
    return slice(start, int(ends[start]))


def _weighted_median(rising: FloatArray, weight: FloatArray) -> float:
    total = np.cumsum(weight)
    return float(rising[int(np.searchsorted(total, 0.5 * total[-1]))])


def _covariance(x: float, y: float, z: float, size_m: FloatArray, truncated: BoolArray, settings: LiftingSettings) -> FloatArray:
    """Gamma of Eq 2: box noise across the line of sight; depth noise and the unknown half-depth along it.

    The depth of the surface is measured, the object's centre lies behind it by an unknown amount, taken as uniform between
    nothing (a sheet) and half the shorter side (a box): standard deviation side / sqrt(48). Where the image border cuts the box,
    the true edge lies somewhere outside: about a third of what is seen, and at least ``UNSEEN_SIGMA_M``, since of a large thing only a
    sliver may be seen.
    """
    sigma_z = settings.depth_noise_at_1m_m * z * z
    half_depth = float(size_m.min()) / np.sqrt(48.0)
    cut = np.array([truncated[0] or truncated[2], truncated[1] or truncated[3]])
    across = settings.box_noise_share * size_m / np.sqrt(2.0)
    across = np.hypot(across, np.where(cut, np.hypot(size_m / 3.0, UNSEEN_SIGMA_M), 0.0))
    variance = np.array([across[0] ** 2, across[1] ** 2, sigma_z**2 + half_depth**2])
    J = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    return np.asarray(J @ np.diag(variance) @ J.T + settings.min_sigma_m**2 * np.eye(3), dtype=np.float64)


def _ray(uv_px: FloatArray, camera: Camera) -> FloatArray:
    """The normalised ray (2,) of one image point: that of its pixel, and the rest of a pixel as if there were no distortion."""
    u = int(np.clip(round(float(uv_px[0])), 0, camera.width - 1))
    v = int(np.clip(round(float(uv_px[1])), 0, camera.height - 1))
    return np.asarray(camera.rays()[v, u] + (uv_px - (u, v)) / (camera.fx, camera.fy), dtype=np.float64)


def _cloud(uv: FloatArray, depth_m: FloatArray, camera: Camera) -> FloatArray:
    keep = np.linspace(0, len(uv) - 1, min(CLOUD_POINTS, len(uv))).astype(np.int64)
    rays = camera.rays()[uv[keep, 1].astype(np.int64), uv[keep, 0].astype(np.int64)]
    z = depth_m[keep]
    return np.concatenate([rays * z[:, None], z[:, None]], axis=1)
