"""Hand-made frames: a wall two metres away, with or without something in front of it or painted on it."""

import numpy as np

from seo_slam.camera import Camera
from seo_slam.interfaces import AgentView, Evidence
from seo_slam.types import Frame, Landmark, Landmarks

CAMERA = Camera(fx=260.0, fy=260.0, cx=160.0, cy=120.0, width=320, height=240)
WALL_M = 2.0
BOX = np.array([130.0, 95.0, 190.0, 145.0])
"""Where things are, pixels: 46 by 38 cm on the wall."""


def wall(seed=0, depth_noise=0.0019, tilt=0.0):
    """A grey, mottled wall; noisy colour and depth. ``tilt``: metres farther from left to right."""
    draws = np.random.default_rng(seed)
    rgb = 130.0 + 6.0 * np.repeat(np.repeat(draws.standard_normal((24, 32)), 10, axis=0), 10, axis=1)[..., None]
    rgb = rgb + draws.normal(0.0, 2.0, (240, 320, 3))
    inverse = 1.0 / (WALL_M + tilt * np.linspace(0.0, 1.0, 320))[None, :] + depth_noise * draws.standard_normal((240, 320))
    return np.clip(rgb, 0, 255).astype(np.uint8), (1.0 / inverse).astype(np.float32)


def put(rgb, depth_m, box=BOX, colour=None, nearer_m=0.0):
    """Paint a box, or put a plate of that thickness there; in place."""
    x0, y0, x1, y1 = (int(v) for v in box)
    if colour is not None:
        rgb[y0:y1, x0:x1] = np.array(colour)
    depth_m[y0:y1, x0:x1] -= np.float32(nearer_m)
    return rgb, depth_m


def surface_of(depth_m, box=BOX, n=8):
    """(n * n, 3) points of what is measured in a box, camera frame."""
    u, v = (a.ravel() for a in np.meshgrid(np.linspace(box[0] + 4, box[2] - 4, n), np.linspace(box[1] + 4, box[3] - 4, n)))
    return CAMERA.back_project(np.stack([u, v], axis=1), depth_m[v.astype(int), u.astype(int)].astype(float))


def landmark(landmark_id, label="poster", words=None, at=None, size_m=(0.46, 0.38, 0.05), observations=20, version=0, category=""):
    return Landmark(
        id=landmark_id,
        label=label,
        labels=words or {label: 1.0},
        position_m=np.array([0.0, 0.0, WALL_M] if at is None else at, dtype=float),
        covariance_m2=1e-4 * np.eye(3),
        size_m=np.array(size_m, dtype=float),
        embedding=np.zeros(4),
        observations=observations,
        first_seen_s=0.0,
        last_seen_s=1.0,
        state="stable",
        version=version,
        category=category,
    )


def evidence(surface_world, weights=None, apart=None, existence=0.9):
    return Evidence(existence, 5, 1, weights or {"poster": 4.0}, surface_world, apart or {})


def view_of(rgb, depth_m, rows=None, boxes=None, known=None, camera_at=(0.0, 0.0, 0.0), keyframe=1, evidences=None, labels=()):
    """A view of landmarks (one in ``BOX`` by default); the world is the camera's frame, moved by ``camera_at``."""
    rows = rows or [landmark(1)]
    boxes = boxes or {row.id: BOX for row in rows}
    T_world_camera = np.eye(4)
    T_world_camera[:3, 3] = camera_at
    shift = np.array(camera_at)
    landmarks = Landmarks.from_rows(rows, 4)
    landmarks = landmarks.__class__(**{f: getattr(landmarks, f) for f in landmarks.__slots__} | {"p_world": landmarks.p_world + shift})
    evidences = evidences or {i: evidence(surface_of(depth_m, box) + shift) for i, box in boxes.items()}
    return AgentView(
        Frame(float(keyframe), rgb, depth_m, CAMERA), T_world_camera, landmarks, boxes, keyframe, tuple(boxes), tuple(labels), evidences
    )
