"""A tiny recording with two blocks before a wall, and a detector that knows where they are."""

from dataclasses import replace

import numpy as np

from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.geometry import inverse, transform_points
from seo_slam.pipeline import Pipeline
from seo_slam.records import Trajectory
from seo_slam.testing.worlds import T_WORLD_FIRST, TINY_CAMERA, tiny_frames, tiny_trajectory
from seo_slam.types import Detections

# Low and high corner of each block's front, in the first camera's frame.
FRONTS = {"cup": ((-0.5, -0.2, 1.4), (-0.1, 0.3, 1.4)), "book": ((0.2, -0.3, 1.6), (0.6, 0.1, 1.6))}
EVERY_SECOND = {
    "runner": {"view_period_s": 0.0},
    "keyframes": {"distance_m": 9.0, "angle_deg": 90.0, "period_s": 0.2},
    "embedder": {"name": "hashed"},
}
"""Settings under which every second tiny frame is a keyframe."""


def centre_world(label):
    low, high = np.array(FRONTS[label])
    return transform_points(T_WORLD_FIRST, 0.5 * (low + high))


class BlockDetector:
    """Returns the box of each block as projected from the true pose, clipped to the image."""

    def __init__(self, poses, labels=("cup", "book")):
        self.poses = poses
        self.labels = labels
        self.calls = 0

    def detect(self, frame):
        self.calls += 1
        boxes, labels = [], []
        for label in self.labels:
            (x0, y0, z), (x1, y1, _) = FRONTS[label]
            corners = np.array([[x, y, z] for x in (x0, x1) for y in (y0, y1)])
            T_camera_first = inverse(self.poses[frame.index]) @ T_WORLD_FIRST
            uv = frame.camera.project(transform_points(T_camera_first, corners))
            box = np.concatenate([uv.min(axis=0), uv.max(axis=0)])
            box = np.clip(box, 0, [frame.camera.width, frame.camera.height] * 2)
            if (box[2:] - box[:2] > 8).all():
                boxes.append(box)
                labels.append(label)
        return Detections(np.array(boxes).reshape(-1, 4), tuple(labels), np.full(len(labels), 0.9))


def trajectory(count):
    return Trajectory(np.round(0.1 * np.arange(count), 6), tiny_trajectory(count))


def recorded(count, **noise):
    return RecordedOdometry(trajectory(count), sigma_m=0.002, sigma_deg=0.05, **noise)


def pipeline(count=8, config=None, **parts):
    """A pipeline over ``tiny_frames(count)``; parts replace its own."""
    parts = {"detector": BlockDetector(tiny_trajectory(count)), "odometry": recorded(count), **parts}
    return Pipeline({**EVERY_SECOND, **(config or {})}, **parts)


def frames(count=8, without_depth=()):
    empty = np.zeros((TINY_CAMERA.height, TINY_CAMERA.width), np.float32)
    return [replace(frame, depth_m=empty) if frame.index in without_depth else frame for frame in tiny_frames(count)]
