"""Tiny worlds for checks and tests: a textured wall with two blocks before it, and a few landmarks. No files, always the same."""

from dataclasses import dataclass, replace

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, exp, inverse, transform_points
from seo_slam.interfaces import AgentView
from seo_slam.perception.cloud import Cloud
from seo_slam.types import Frame, Landmark, Landmarks, Observations

TINY_CAMERA = Camera(fx=260.0, fy=260.0, cx=159.5, cy=119.5, width=320, height=240)

# First camera: 1 m up, looking along the world's x axis, world z up.
T_WORLD_FIRST = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]])

STEP = np.array([0.01, 0.015, 0.005, 0.04, -0.01, 0.02])
"""Tangent vector of the motion from one tiny frame to the next: rotation (rad) first, then translation (m)."""

_WALL_Z_M = 2.0
# (x0, y0, x1, y1, z) in metres in the first camera's frame.
_BLOCKS = ((-0.5, -0.2, -0.1, 0.3, 1.4), (0.2, -0.3, 0.6, 0.1, 1.6))
_TILE_M = 0.05
_TILES = 128

LABELS = ("cup", "keyboard", "book", "book")
"""Labels of the tiny landmarks; their ids are 3, 5, 8 and 9. The two books stand side by side."""
_IDS = (3, 5, 8, 9)
_P_FIRST = np.array([[-0.4, 0.1, 1.2], [0.1, 0.3, 1.4], [0.35, -0.1, 1.3], [0.6, -0.1, 1.3]])
_EMBEDDING_SIZE = 8
_SIZE_M = 0.12


def tiny_trajectory(count: int = 6) -> FloatArray:
    """Return (count, 4, 4) poses ``T_world_camera``: equal steps from the first camera on."""
    poses = [T_WORLD_FIRST]
    for _ in range(count - 1):
        poses.append(poses[-1] @ exp(STEP))
    return np.array(poses)


def tiny_frames(count: int = 6) -> tuple[Frame, ...]:
    """Return frames with colour and depth as seen along ``tiny_trajectory``, a tenth of a second apart."""
    return tuple(_render(T, k) for k, T in enumerate(tiny_trajectory(count)))


def hard_frames() -> tuple[Frame, ...]:
    """Return frames that a plug-in must bear: without depth, black, white."""
    seen = tiny_frames(1)[0]
    empty = np.zeros_like(seen.depth_m)
    return (
        replace(seen, timestamp_s=10.0, depth_m=empty, index=100),
        replace(seen, timestamp_s=10.1, rgb=np.zeros_like(seen.rgb), index=101),
        replace(seen, timestamp_s=10.2, rgb=np.full_like(seen.rgb, 255), depth_m=empty, index=102),
    )


def tiny_landmarks() -> Landmarks:
    """Return four stable landmarks before the first camera, world frame, 1 cm sure of their position; of each one point is known."""
    landmarks = Landmarks.from_rows(
        [
            Landmark(
                id=landmark_id,
                label=label,
                labels={label: 1.0},
                position_m=transform_points(T_WORLD_FIRST, p_first),
                covariance_m2=1e-4 * np.eye(3),
                size_m=np.full(3, _SIZE_M),
                embedding=tiny_embedding(label),
                observations=5,
                first_seen_s=0.0,
                last_seen_s=1.0,
                state="stable",
                version=2,
            )
            for landmark_id, label, p_first in zip(_IDS, LABELS, _P_FIRST, strict=True)
        ]
    )
    return replace(landmarks, clouds=tuple(Cloud(p[None]) for p in landmarks.p_world))


def tiny_embedding(label: str) -> FloatArray:
    """Return (8,): a unit vector, the same for the same label."""
    row = np.zeros(_EMBEDDING_SIZE)
    row[sum(label.encode()) % _EMBEDDING_SIZE] = 1.0
    return row


def tiny_observations(
    p_world: FloatArray, labels: tuple[str | None, ...], T_world_camera: FloatArray = T_WORLD_FIRST, sigma_m: float = 0.01
) -> Observations:
    """Return exact measurements of points (K, 3) in the world from a camera, with a standard deviation of ``sigma_m``."""
    K = len(labels)
    p_camera = transform_points(inverse(T_world_camera), np.asarray(p_world, dtype=np.float64).reshape(K, 3))
    half_px = 0.5 * _SIZE_M * TINY_CAMERA.fx / p_camera[:, 2:]
    centre_px = TINY_CAMERA.project(p_camera)
    return Observations(
        p_camera=p_camera,
        cov_camera=np.tile(sigma_m**2 * np.eye(3), (K, 1, 1)),
        size_m=np.full((K, 2), _SIZE_M),
        labels=labels,
        scores=np.full(K, 0.9),
        embeddings=np.array([tiny_embedding(label or "") for label in labels]).reshape(K, _EMBEDDING_SIZE),
        boxes_px=np.concatenate([centre_px - half_px, centre_px + half_px], axis=1),
        truncated=np.zeros((K, 4), dtype=np.bool_),
        clouds=tuple(p[None] for p in p_camera),
        rows=np.arange(K, dtype=np.int64),
    )


def tiny_boxes(landmarks: Landmarks, T_world_camera: FloatArray = T_WORLD_FIRST) -> dict[int, FloatArray]:
    """Return the box (4,) in pixels of each landmark as seen by a tiny camera."""
    boxes_px = tiny_observations(landmarks.p_world, (None,) * len(landmarks), T_world_camera).boxes_px
    return {int(i): box for i, box in zip(landmarks.ids, boxes_px, strict=True)}


def tiny_view(asked: tuple[int, ...] = ()) -> AgentView:
    """Return what an agent is shown of the tiny landmarks by the first tiny camera; ``asked`` as in ``AgentView``."""
    landmarks = tiny_landmarks()
    return AgentView(tiny_frames(1)[0], T_WORLD_FIRST, landmarks, tiny_boxes(landmarks), asked=asked)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    rgb: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
    depth_m: FloatArray


def _render(T_world_camera: FloatArray, index: int) -> Frame:
    T_first_camera = inverse(T_WORLD_FIRST) @ T_world_camera
    shape = (TINY_CAMERA.height, TINY_CAMERA.width)
    ray = np.concatenate([TINY_CAMERA.rays(), np.ones((*shape, 1))], axis=2) @ T_first_camera[:3, :3].T
    origin = T_first_camera[:3, 3]
    tiles = np.random.default_rng(0).integers(30, 226, (_TILES, _TILES, 3), dtype=np.uint8)
    seen = _look_at(
        tiles, ray, origin, (-np.inf, -np.inf, np.inf, np.inf, _WALL_Z_M), _Seen(np.zeros((*shape, 3), np.uint8), np.full(shape, np.inf))
    )
    for block in _BLOCKS:
        seen = _look_at(tiles[::-1], ray, origin, block, seen)
    return Frame(round(0.1 * index, 6), seen.rgb, seen.depth_m.astype(np.float32), TINY_CAMERA, index)


def _look_at(
    tiles: np.ndarray[tuple[int, ...], np.dtype[np.uint8]],
    ray: FloatArray,
    origin: FloatArray,
    rectangle: tuple[float, float, float, float, float],
    seen: _Seen,
) -> _Seen:
    """Draw a tiled rectangle, parallel to the first image plane, where it is nearer than what is seen already."""
    x0, y0, x1, y1, z = rectangle
    depth_m = (z - origin[2]) / ray[..., 2]  # rays have length 1 along the camera's z axis, so this is depth
    x, y = (origin[axis] + depth_m * ray[..., axis] for axis in (0, 1))
    nearer = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1) & (depth_m < seen.depth_m) & (depth_m > 0)
    colours = tiles[np.floor(y / _TILE_M).astype(np.int64) % _TILES, np.floor(x / _TILE_M).astype(np.int64) % _TILES]
    return _Seen(np.where(nearer[..., None], colours, seen.rgb), np.where(nearer, depth_m, seen.depth_m))
