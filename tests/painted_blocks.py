"""Blocks before a wall, painted into depth images from a camera that slides sideways, and boxes of those that a detector finds."""

from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import exp, transform_points
from seo_slam.testing.worlds import T_WORLD_FIRST, TINY_CAMERA
from seo_slam.types import Detections, Frame

WALL_M = 2.5
FAR_ASIDE_M = 4.0
"""From here a camera sees none of the blocks around x = 0."""


@dataclass(frozen=True)
class Block:
    """A block that faces the first camera; the place of its front's middle in that camera's frame, metres."""

    label: str
    x: float
    y: float = 0.1
    z: float = 1.3
    half_m: float = 0.06

    @property
    def p_world(self):
        return transform_points(T_WORLD_FIRST, np.array([self.x, self.y, self.z]))

    def box_px(self, aside_m=0.0):
        """Corners (4,) in the image of a camera that stands ``aside_m`` to the right of the first one, not clipped."""
        low, high = (np.array([self.x - aside_m + side, self.y + side, self.z]) for side in (-self.half_m, self.half_m))
        return TINY_CAMERA.project(np.array([low, high])).ravel()


def pose(aside_m=0.0):
    """T_world_camera of a camera that stands to the right of the first one and looks the same way."""
    return T_WORLD_FIRST @ exp([0, 0, 0, aside_m, 0, 0])


def paint(blocks, aside_m=0.0, wall_m=WALL_M):
    """Depth image (H, W) of blocks before a wall."""
    depth_m = np.full((TINY_CAMERA.height, TINY_CAMERA.width), wall_m, dtype=np.float32)
    for block in blocks:
        u0, v0, u1, v1 = np.clip(np.round(block.box_px(aside_m)), 0, [TINY_CAMERA.width, TINY_CAMERA.height] * 2).astype(int)
        depth_m[v0:v1, u0:u1] = np.minimum(depth_m[v0:v1, u0:u1], block.z)
    return depth_m


def frame(index, blocks, aside_m=0.0, period_s=0.5):
    """A grey frame of blocks."""
    rgb = np.full((TINY_CAMERA.height, TINY_CAMERA.width, 3), 128, np.uint8)
    return Frame(period_s * index, rgb, paint(blocks, aside_m), TINY_CAMERA, index)


def boxes(blocks, aside_m=0.0):
    """What a perfect detector says of those blocks that are wholly in the image."""
    size = np.array([TINY_CAMERA.width, TINY_CAMERA.height] * 2)
    seen = [block for block in blocks if ((block.box_px(aside_m) > 0) & (block.box_px(aside_m) < size)).all()]
    rows = np.array([block.box_px(aside_m) for block in seen]).reshape(-1, 4)
    return Detections(rows, tuple(block.label for block in seen), np.full(len(seen), 0.9))
