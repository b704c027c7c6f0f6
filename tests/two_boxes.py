"""A camera that stands before two boxes, and a detector that is told what to call them."""

import numpy as np

from seo_slam.camera import Camera
from seo_slam.config import Config
from seo_slam.pipeline import Pipeline
from seo_slam.types import Detections, Frame, Motion

CAMERA = Camera(fx=100.0, fy=100.0, cx=79.5, cy=59.5, width=160, height=120)
LEFT, RIGHT = (20, 40, 60, 80), (100, 40, 140, 80)


class Standing:
    """Odometry of a camera 1.2 m above the ground that looks along y; lost in some frames, when its guess drifts."""

    def __init__(self, at_x_m=0.0, lost=(), drift_m=0.0):
        self.at_x_m, self.lost, self.drift_m = at_x_m, set(lost), drift_m

    def update(self, frame):
        T = np.array([[1.0, 0, 0, self.at_x_m], [0, 0, 1, 0], [0, -1, 0, 1.2], [0, 0, 0, 1]])
        lost = frame.index in self.lost
        step = np.eye(4)
        if lost:
            step[0, 3] = self.drift_m
            T = None
        return Motion(step, 1e-6 * np.eye(6), status="lost" if lost else "ok", T_world_camera=T)


class Says:
    """``words(index)`` gives [(word, box), …] of a frame; masks fill the boxes."""

    def __init__(self, words):
        self.words = words

    def detect(self, frame):
        rows = self.words(frame.index)
        masks = np.zeros((len(rows), CAMERA.height, CAMERA.width), dtype=np.bool_)
        for mask, (_, (x0, y0, x1, y1)) in zip(masks, rows, strict=True):
            mask[y0:y1, x0:x1] = True
        boxes = np.array([box for _, box in rows], dtype=np.float64).reshape(-1, 4)
        return Detections(boxes, tuple(word for word, _ in rows), np.full(len(rows), 0.9), masks)


def frames(count, first=0):
    depth = np.full((CAMERA.height, CAMERA.width), 3.0, dtype=np.float32)
    depth[40:80, 20:60] = depth[40:80, 100:140] = 1.5
    depth[100:] = 1.2 * 100.0 / (np.arange(100, 120) - 59.5)[:, None]  # the floor
    for index in range(first, first + count):
        yield Frame(0.5 * index, np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8), depth, CAMERA, index)


def pipeline(words, *settings, preset="dualmap", odometry=None, **parts):
    config = Config.preset(preset).with_settings(settings)
    given = {"embedder": "hashed"} | parts
    return Pipeline(config, detector=Says(words), odometry=odometry or Standing(), **given)


def mapped(running, count=20):
    """Run some frames and return the map."""
    with running:
        for frame in frames(count):
            running.step(frame)
        return running.result().map
