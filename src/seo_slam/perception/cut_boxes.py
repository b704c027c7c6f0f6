"""Boxes that the image border cuts: where the centre of the whole thing is, given how large it is.

The centre of a cut box is not the centre of its thing, and always errs to the same side, so that such views do not average out. Where the
thing was seen whole before, its usual width and height tell where its centre lies from the edge that is still seen.
"""

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.types import BoolArray

SIZE_SIGMA_SHARE = 0.15
"""Standard deviation of a thing's width or height between views, as a share of it."""

SLOPE_SIGMA = 0.6
"""The unseen part may recede or come nearer, by up to 45 degrees: standard deviation of the depth per metre of shift."""


def completed(
    p_camera: FloatArray, cov_camera: FloatArray, size_m: FloatArray, truncated: BoolArray, across_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Move the centres of cut boxes to where the whole thing's centre is.

    Along an image axis on which one border cuts the box, the centre becomes the seen edge plus half the usual extent; its variance
    that of half the extent, and the depth there is less certain. Cut on both sides, or smaller than what is seen, or never seen
    whole: nothing changes.

    Args:
        p_camera: (..., 3) centres of the visible parts.
        cov_camera: (..., 3, 3).
        size_m: (..., 2) visible width and height.
        truncated: (..., 4) cut on the left, top, right, bottom.
        across_m: (..., 2) usual width and height of the whole thing; 0 where it is not known.

    Returns:
        Completed centres and covariances, of the broadcast shape.
    """
    shape = np.broadcast_shapes(p_camera.shape[:-1], across_m.shape[:-1])
    p = np.broadcast_to(p_camera, (*shape, 3)).copy()
    cov = np.broadcast_to(cov_camera, (*shape, 3, 3)).copy()
    for axis in (0, 1):
        low, high = truncated[..., axis], truncated[..., axis + 2]
        missing_m = across_m[..., axis] - size_m[..., axis]
        use = np.broadcast_to((low ^ high) & (missing_m > 0), shape)
        shift = np.broadcast_to(np.where(low, -0.5, 0.5) * missing_m, shape)
        p[..., axis] += np.where(use, shift, 0.0)
        variance = np.broadcast_to((0.5 * SIZE_SIGMA_SHARE * across_m[..., axis]) ** 2, shape)
        along = cov[..., axis, axis]
        cov[..., axis, axis] = np.where(use, np.minimum(along, variance + cov[..., 2, 2] * _slope_squared(p, axis) + 1e-4), along)
        cov[..., 2, 2] += np.where(use, (SLOPE_SIGMA * shift) ** 2, 0.0)
        for other in (0, 1, 2):
            if other != axis:  # the shrunken variance must not leave correlations behind that it cannot carry
                cov[..., axis, other] = np.where(use, 0.0, cov[..., axis, other])
                cov[..., other, axis] = np.where(use, 0.0, cov[..., other, axis])
    return p, cov


def _slope_squared(p_camera: FloatArray, axis: int) -> FloatArray:
    return np.asarray((p_camera[..., axis] / p_camera[..., 2]) ** 2, dtype=np.float64)
