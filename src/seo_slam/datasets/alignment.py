"""Does depth lie on colour? Edges of the depth image should fall on edges of the colour image.

The depth edges are laid over the colour edges at every small shift and at some zooms; where they fit best tells how far the two
images are off. On recordings that are well registered the best shift is a few pixels.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

ZOOMS = (0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2)
_WORK_WIDTH = 320
_REACH = 0.07  # shifts looked at, as a share of the image's width
_EDGE = 0.06  # a jump of this share of the distance is a depth edge


@dataclass(frozen=True, slots=True)
class Alignment:
    """How depth lies on colour.

    Attributes:
        shift_px: (x, y) by which the depth images must be moved to fit best, without zoom.
        zoom: factor about the image centre by which the depth images must be scaled to fit best.
        strength: mean height of the colour edges under the depth edges at the best place, in standard deviations above chance.
        strength_as_is: the same where the images lie now.
        strength_zoomed: the same at the best zoom.
        edge_px: depth edge pixels looked at; with few of them nothing can be said.
    """

    shift_px: tuple[float, float]
    zoom: float
    strength: float
    strength_as_is: float
    strength_zoomed: float
    edge_px: int


def measure_alignment(images: Iterable[tuple[NDArray[np.uint8], NDArray[np.float32]]]) -> Alignment | None:
    """Measure over some images, (H, W, 3) colour and (H, W) depth in metres each; None if no depth has an edge."""
    sums: dict[float, NDArray[np.float64]] = {}
    edge_px, scale, reach = 0, 1.0, 1
    for rgb, depth_m in images:
        scale = max(1.0, rgb.shape[1] / _WORK_WIDTH)
        size = (round(rgb.shape[1] / scale), round(rgb.shape[0] / scale))
        reach = max(4, round(_REACH * size[0]))
        colour, depth = _colour_edges(rgb, size), _depth_edges(depth_m, size)
        edge_px += int(depth.sum())
        padded = (size[1] + 2 * reach, size[0] + 2 * reach)
        colour_spectrum = np.fft.rfft2(colour, padded)
        for zoom in ZOOMS:
            turned = cv2.getRotationMatrix2D((size[0] / 2, size[1] / 2), 0, zoom)
            zoomed = cv2.warpAffine(depth, turned, size, flags=cv2.INTER_LINEAR)
            weight = float(zoomed.sum()) / max(float(depth.sum()), 1.0)  # edges that a zoom pushes out of the image count as misses
            spectrum = np.conj(np.fft.rfft2(zoomed, padded)) / max(weight, 1e-6)
            overlap = np.fft.irfft2(colour_spectrum * spectrum, padded)
            window = np.roll(overlap, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
            sums[zoom] = sums.get(zoom, 0.0) + window
    if edge_px == 0:
        return None
    chance = float(np.median([np.median(window) for window in sums.values()]))
    fits = {zoom: (float(window.max()) - chance) / edge_px for zoom, window in sums.items()}
    best_zoom = max(fits, key=lambda zoom: fits[zoom])
    row, column = np.unravel_index(int(sums[1.0].argmax()), sums[1.0].shape)
    return Alignment(
        shift_px=(float(column - reach) * scale, float(row - reach) * scale),
        zoom=best_zoom,
        strength=fits[1.0],
        strength_as_is=(float(sums[1.0][reach, reach]) - chance) / edge_px,
        strength_zoomed=fits[best_zoom],
        edge_px=edge_px,
    )


def _colour_edges(rgb: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.float32]:
    """Gradient of brightness, capped so that a few strong edges do not decide, with mean 0 and deviation 1."""
    grey = cv2.resize(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA).astype(np.float32)
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
    height = np.hypot(cv2.Scharr(grey, -1, 1, 0), cv2.Scharr(grey, -1, 0, 1))
    height = np.minimum(height, np.percentile(height, 97))
    return np.asarray((height - height.mean()) / max(float(height.std()), 1e-6), dtype=np.float32)


def _depth_edges(depth_m: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """1 where depth jumps between neighbours that both have a return, else 0."""
    depth = cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST)
    around = np.ones((3, 3), dtype=np.uint8)
    far = cv2.dilate(depth, around)
    near = cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), around)
    return np.asarray((far > 0) & np.isfinite(near) & (far - near > _EDGE * far), dtype=np.float32)
