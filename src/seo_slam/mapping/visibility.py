"""Which landmarks a camera should see (SEO-SLAM III-C)."""

import numpy as np

from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.types import BoolArray, Frame

BORDER_SHARE = 0.05
"""Share of the image at its border where a thing may be cut and a detector may well miss it."""

DEPTH_TOLERANCE_M = 0.05
"""Added to half the thing's extent: a landmark lies on or behind the surface that it was measured on."""


def in_view(p_world: FloatArray, size_m: FloatArray, T_world_camera: FloatArray, frame: Frame, max_depth_m: float) -> BoolArray:
    """Return (N,) bool: the centre is well inside the image, near enough, and nothing stands before it.

    The paper asks for ``z_C < z_D``, the landmark before the depth image at its pixel; since a landmark lies inside its thing, behind
    the surface seen, half its extent and a tolerance are granted. A pixel without depth is no witness: not in view.

    Args:
        p_world: (N, 3) centres.
        size_m: (N, 3) extents.
        T_world_camera: (4, 4) pose of the frame.
        frame: with depth.
        max_depth_m: farther things are not counted as visible.
    """
    camera = frame.camera
    p_camera = transform_points(inverse(T_world_camera), p_world)
    z_camera = p_camera[:, 2]
    uv = camera.project(p_camera)
    border = BORDER_SHARE * np.array([camera.width, camera.height])
    inside = (uv >= border).all(axis=1) & (uv <= np.array([camera.width, camera.height]) - 1 - border).all(axis=1)
    inside &= (z_camera > 0) & (z_camera <= max_depth_m)  # comparisons with the NaN of points behind the camera are False
    pixel = np.where(inside[:, None], uv, 0.0).round().astype(np.int64)
    z_depth = frame.depth_m[pixel[:, 1], pixel[:, 0]]
    return np.asarray(inside & (z_depth > 0) & (z_camera <= z_depth + 0.5 * size_m.max(axis=1) + DEPTH_TOLERANCE_M), dtype=np.bool_)
