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
    p, cov, whole_m = np.empty((*shape, 3)), np.empty((*shape, 3, 3)), np.empty((*shape, 2))
    p[...], cov[...], whole_m[...] = p_camera, cov_camera, across_m
    missing_m = whole_m - size_m
    shifts = np.where(truncated[..., :2], -0.5, 0.5) * missing_m
    incomplete = (truncated[..., :2] ^ truncated[..., 2:]) & (missing_m > 0)
    for axis in (0, 1):
        use = incomplete[..., axis].nonzero()
        if not len(use[0]):
            continue
        shift = shifts[..., axis][use]
        whole, mine, centre = whole_m[..., axis][use], cov[use], p[use]
        centre[:, axis] += shift
        variance = (0.5 * SIZE_SIGMA_SHARE * whole) ** 2 + mine[:, 2, 2] * (centre[:, axis] / centre[:, 2]) ** 2 + 1e-4
        along = np.minimum(mine[:, axis, axis], variance)
        mine[:, axis, :] = mine[:, :, axis] = 0.0  # the shrunken variance must not leave correlations behind that it cannot carry
        mine[:, axis, axis] = along
        mine[:, 2, 2] += (SLOPE_SIGMA * shift) ** 2
        p[use], cov[use] = centre, mine
    return p, cov
