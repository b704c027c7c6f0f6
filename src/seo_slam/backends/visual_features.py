"""Image features of one frame, lifted by depth, for visual odometry: ORB, spread over the image, lens undistorted."""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray, Frame, IntArray

DescriptorArray = NDArray[np.uint64]

_LEVELS = 8
SCALE_FACTOR = 1.2
"""Ratio between two levels of the image pyramid."""
_FAST_THRESHOLD = 7
_CELL_PX = 40
_MAX_DEPTH_STEP = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """N features of one frame.

    Attributes:
        uv_px: (N, 2) pixel positions with the lens distortion removed.
        sigma_px: (N,) standard deviation of a position, larger on coarser pyramid levels.
        octaves: (N,) pyramid level.
        descriptors: (N, 4) uint64, the 256 bits of ORB.
        inverse_depth: (N,) in 1/m; 0 = no depth.
        sigma_inverse_depth: (N,) its standard deviation.
    """

    uv_px: FloatArray
    sigma_px: FloatArray
    octaves: IntArray
    descriptors: DescriptorArray
    inverse_depth: FloatArray
    sigma_inverse_depth: FloatArray

    def __len__(self) -> int:
        return len(self.uv_px)

    @property
    def has_depth(self) -> BoolArray:
        """(N,) which features have a depth."""
        return self.inverse_depth > 0

    @property
    def depth_weight(self) -> FloatArray:
        """(N,) one over the standard deviation of inverse depth, in m; 0 where there is no depth."""
        return np.where(self.inverse_depth > 0, 1.0 / self.sigma_inverse_depth, 0.0)

    def with_depth_noise(self, factor: float) -> "Features":
        """The same features with ``factor`` times the noise of depth."""
        return replace(self, sigma_inverse_depth=self.sigma_inverse_depth * factor)

    def take(self, rows: IntArray) -> "Features":
        """The features of these rows."""
        return Features(
            self.uv_px[rows],
            self.sigma_px[rows],
            self.octaves[rows],
            self.descriptors[rows],
            self.inverse_depth[rows],
            self.sigma_inverse_depth[rows],
        )


class FeatureExtractor:
    """Finds ORB features (Rublee et al., ICCV 2011) that cover the whole image.

    Args:
        count: features kept a frame; twice as many are found, and the best of every image cell come first.
        depth_noise_at_1m_m: axial depth noise is this times depth squared, so it is constant in inverse depth.
        max_depth_m: farther depth is ignored.
    """

    def __init__(self, count: int, depth_noise_at_1m_m: float, max_depth_m: float) -> None:
        self._count = count
        self._inverse_depth_noise = depth_noise_at_1m_m
        self._max_depth_m = max_depth_m
        self._orb = cv2.ORB.create(2 * count, scaleFactor=SCALE_FACTOR, nlevels=_LEVELS, fastThreshold=_FAST_THRESHOLD)

    def extract(self, frame: Frame) -> Features:
        """Return the features of a frame; none for a blank image."""
        grey = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY)
        keypoints, descriptors = self._orb.detectAndCompute(grey, None)
        if descriptors is None or len(keypoints) == 0:
            return _no_features()
        table = np.array([(*k.pt, k.octave, k.response) for k in keypoints], dtype=np.float64)
        chosen = _spread(table[:, :2], table[:, 3], frame.camera.width, self._count)
        uv_raw_px, octaves = table[chosen, :2], table[chosen, 2].astype(np.int64)
        inverse_depth, sigma = self._lift(frame.depth_m, uv_raw_px)
        return Features(
            uv_px=undistorted_px(frame.camera, uv_raw_px),
            sigma_px=SCALE_FACTOR ** octaves.astype(np.float64),
            octaves=octaves,
            descriptors=np.ascontiguousarray(descriptors[chosen]).view(np.uint64),
            inverse_depth=inverse_depth,
            sigma_inverse_depth=sigma,
        )

    def _lift(self, depth_m: NDArray[np.float32], uv_raw_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Inverse depth and its noise; a depth step within the 3x3 pixels around a feature makes its depth less certain."""
        height, width = depth_m.shape
        u = np.clip(np.rint(uv_raw_px[:, 0]).astype(np.int64), 1, width - 2)
        v = np.clip(np.rint(uv_raw_px[:, 1]).astype(np.int64), 1, height - 2)
        around = np.stack([depth_m[v + dv, u + du] for dv in (-1, 0, 1) for du in (-1, 0, 1)], axis=-1).astype(np.float64)
        z = around[:, 4]
        valid = around > 0
        step = np.where(valid, around, z[:, None]).max(axis=1) - np.where(valid, around, z[:, None]).min(axis=1)
        good = (z > 0.05) & (z <= self._max_depth_m) & (valid.sum(axis=1) >= 5) & (step <= _MAX_DEPTH_STEP * z)
        z = np.where(good, z, 1.0)
        sigma = np.hypot(self._inverse_depth_noise, 0.3 * np.where(good, step, 0.0) / z**2)
        return np.where(good, 1.0 / z, 0.0), sigma


def undistorted_px(camera: Camera, uv_px: FloatArray) -> FloatArray:
    """Return pixel positions (N, 2) as the same camera without lens distortion would see them."""
    return camera.undistort(uv_px) * [camera.fx, camera.fy] + [camera.cx, camera.cy]


def _spread(uv_px: FloatArray, response: FloatArray, width: int, count: int) -> IntArray:
    """Rows of up to ``count`` features: the strongest of every cell, then the second of every cell, and so on."""
    columns = width // _CELL_PX + 1
    cell = (uv_px[:, 1] // _CELL_PX).astype(np.int64) * columns + (uv_px[:, 0] // _CELL_PX).astype(np.int64)
    order = np.lexsort((-response, cell))
    sorted_cell = cell[order]
    first_of_cell = np.searchsorted(sorted_cell, sorted_cell)
    rank_in_cell = np.arange(len(order)) - first_of_cell
    best_first = np.lexsort((-response[order], rank_in_cell))
    return np.asarray(order[best_first[:count]], dtype=np.int64)


def _no_features() -> Features:
    empty: Any = np.zeros(0)
    return Features(np.zeros((0, 2)), empty, np.zeros(0, dtype=np.int64), np.zeros((0, 4), dtype=np.uint64), empty, empty)
