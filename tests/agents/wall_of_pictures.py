"""A wall with a grid of pictures, each a thing of its own, before a camera that stands still."""

from dataclasses import replace

import numpy as np

import tiny_run
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.records import Trajectory
from seo_slam.testing.worlds import T_WORLD_FIRST, TINY_CAMERA, tiny_frames
from seo_slam.types import Detections

NAMES = ("picture", "poster", "mirror", "clock", "calendar", "chart", "mask", "plate")


def frames(count):
    """The same view, a tenth of a second apart; each is a keyframe."""
    seen = replace(tiny_frames(1)[0], depth_m=np.full((TINY_CAMERA.height, TINY_CAMERA.width), 2.0, np.float32))
    return tuple(replace(seen, timestamp_s=round(0.1 * k, 6), index=k) for k in range(count))


class GridDetector:
    """Finds the pictures, each in a cell of its own."""

    def __init__(self, rows, columns):
        self.cells = [(row, column) for row in range(rows) for column in range(columns)]
        self.size = np.array([TINY_CAMERA.width / columns, TINY_CAMERA.height / rows])

    def detect(self, frame):
        corner = np.array([[column, row] for row, column in self.cells])
        boxes = np.concatenate([(corner + 0.1) * self.size, (corner + 0.9) * self.size], axis=1)
        labels = tuple(NAMES[(row + 3 * column) % len(NAMES)] for row, column in self.cells)
        return Detections(boxes, labels, np.full(len(labels), 0.9))


def pipeline(rows, columns, agents=(), *, most_frames=64, mode="inline", drain_s=30.0, store=None, **settings):
    """A pipeline over ``frames(…)``."""
    path = Trajectory(np.round(0.1 * np.arange(most_frames), 6), np.tile(T_WORLD_FIRST, (most_frames, 1, 1)))
    config = {
        "runner": {"view_period_s": 0.0, "mode": mode, "in_flight": 64, "drain_s": drain_s},
        "keyframes": {"period_s": 0.1},
        **settings,
    }
    odometry = RecordedOdometry(path, sigma_m=0.002, sigma_deg=0.05)
    return tiny_run.pipeline(
        config=config,
        detector=GridDetector(rows, columns),
        odometry=odometry,
        agents=list(agents),
        **({} if store is None else {"store": store}),
    )
