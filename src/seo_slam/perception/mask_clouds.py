"""From masks and a depth image to one clean cloud of points a mask (DualMap III-A3)."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray
from seo_slam.perception.clusters import in_largest_cluster
from seo_slam.perception.lifting import densest_window
from seo_slam.perception.voxels import cell_order, voxel_cells, voxel_means
from seo_slam.settings.observing import CloudSettings
from seo_slam.types import BoolArray, IntArray

NO_MASK = -1
"""In a label image: the pixel is of no mask."""

_BOX_SAMPLES = 400
"""Pixels of a box that its depth window is sought in."""


def mask_clouds(
    masks: BoolArray | IntArray | NDArray[np.int32],
    depth_m: NDArray[np.float32],
    camera: Camera,
    settings: CloudSettings,
    max_depth_m: float,
    count: int | None = None,
) -> tuple[FloatArray, ...]:
    """Return the cloud (M, 3) of each of N masks, camera frame, metres: one point a voxel, the mean of what is in it.

    One pass over the image for all masks. Where masks overlap, the pixel is the smaller one's, see ``label_image``: a cup is not part of
    the table. Of each cloud only the largest cluster by density is kept (``in_largest_cluster``): frayed edges of a mask show what lies
    behind. A voxel counts there as many points as it has pixels, so that a small thing near the camera is not taken for noise. The same
    input gives the same bytes.

    Args:
        masks: (N, H, W) bool, or a label image (H, W) of row numbers, negative where there is none.
        depth_m: (H, W), 0 = no return.
        camera: of the depth image.
        settings: voxel, clustering, and the least size: a smaller cloud is empty, (0, 3).
        max_depth_m: pixels farther away are ignored.
        count: N, for a label image; None: one more than its largest number.

    Raises:
        FrameError: masks, depth and camera are not of one size, or a label image holds numbers that are not below ``count``.
    """
    labels = _checked_labels(masks, depth_m, camera)
    N = len(masks) if masks.ndim == 3 else count if count is not None else int(labels.max(initial=NO_MASK)) + 1
    if int(labels.max(initial=NO_MASK)) >= N:
        raise FrameError(f"label image: got the number {int(labels.max())}, wanted numbers below {N}")
    pixels = np.flatnonzero((labels >= 0) & (depth_m > 0) & (depth_m <= max_depth_m))
    z = depth_m.ravel()[pixels].astype(np.float64)
    owners = labels.ravel()[pixels]
    p_camera = np.empty((len(pixels), 3))
    np.multiply(np.take(camera.rays().reshape(-1, 2), pixels, axis=0), z[:, None], out=p_camera[:, :2])
    p_camera[:, 2] = z
    order, starts = cell_order(voxel_cells(p_camera, settings.voxel_m), owners)
    means, owners = voxel_means(p_camera, order, starts), owners[order[starts]]
    weights = np.diff(starts, append=len(order)).astype(np.float64)
    kept = in_largest_cluster(means, owners, weights, settings.cluster_m, settings.cluster_points)
    means, owners = means[kept], owners[kept]
    ends = np.searchsorted(owners, np.arange(N + 1))
    return tuple(means[a:b].copy() if b - a >= settings.least_points else np.zeros((0, 3)) for a, b in pairwise(ends.tolist()))


def label_image(masks: BoolArray) -> NDArray[np.int32]:
    """Return (H, W): the row of the mask that each pixel is of, ``NO_MASK`` where there is none.

    Where masks (N, H, W) overlap, the one with the fewest pixels has it, of two of one size the one given first.
    """
    labels = np.full(masks.shape[1:], NO_MASK, dtype=np.int32)
    sizes = np.count_nonzero(masks, axis=(1, 2))
    for row in np.argsort(sizes, kind="stable")[::-1]:
        labels[masks[row]] = row
    return labels


def box_masks(boxes_px: FloatArray, depth_m: NDArray[np.float32], camera: Camera, max_depth_m: float) -> BoolArray:
    """Return masks (N, H, W) of boxes (N, 4) that have none: the pixels of each box whose depth is the object's.

    Which depths those are says the rule of ``lifting``: the window about as long as half the object is wide that holds most of the box,
    its middle counting more than its corners.

    Raises:
        FrameError: the depth image is not of the camera's size.
    """
    if depth_m.shape != (camera.height, camera.width):
        raise FrameError(f"depth_m is {depth_m.shape}, the camera {(camera.height, camera.width)}; wanted one size")
    masks = np.zeros((len(boxes_px), *depth_m.shape), dtype=np.bool_)
    for mask, box_px in zip(masks, np.asarray(boxes_px, dtype=np.float64), strict=True):
        x0, y0 = max(int(np.floor(box_px[0])), 0), max(int(np.floor(box_px[1])), 0)
        x1, y1 = min(int(np.ceil(box_px[2])), camera.width), min(int(np.ceil(box_px[3])), camera.height)
        if x0 >= x1 or y0 >= y1:
            continue
        patch = depth_m[y0:y1, x0:x1]
        window = _depth_window(patch, box_px, (x0, y0), camera, max_depth_m)
        if window is not None:
            mask[y0:y1, x0:x1] = (patch >= window[0]) & (patch <= window[1])
    return masks


def _depth_window(
    patch_m: NDArray[np.float32], box_px: FloatArray, corner_px: tuple[int, int], camera: Camera, max_depth_m: float
) -> tuple[float, float] | None:
    """Least and largest depth of the object in a box, or None without any depth."""
    step = max(1, int(np.ceil(np.sqrt(patch_m.size / _BOX_SAMPLES))))
    sample = patch_m[::step, ::step]
    v, u = np.nonzero((sample > 0) & (sample <= max_depth_m))
    if not len(v):
        return None
    depth_m = sample[v, u].astype(np.float64)
    order = np.argsort(depth_m, kind="stable")
    depth_m, uv = depth_m[order], np.column_stack([u, v])[order] * step + corner_px
    side_px = box_px[2:] - box_px[:2]
    off = (uv - 0.5 * (box_px[:2] + box_px[2:])) / np.maximum(0.25 * side_px, 1.0)
    weight = np.exp(-0.5 * np.sum(off * off, axis=1))
    total = np.cumsum(weight)
    middle_m = float(depth_m[int(np.searchsorted(total, 0.5 * total[-1]))])
    width_m = float(np.sqrt(np.prod(side_px / (camera.fx, camera.fy)))) * middle_m
    inside = densest_window(depth_m, weight, length_m=float(np.clip(0.5 * width_m, 0.05, 1.0)))
    return float(depth_m[inside.start]), float(depth_m[inside.stop - 1])


def _checked_labels(masks: BoolArray | IntArray | NDArray[np.int32], depth_m: NDArray[np.float32], camera: Camera) -> IntArray:
    size = (camera.height, camera.width)
    if masks.ndim not in (2, 3) or masks.shape[-2:] != size or depth_m.shape != size:
        raise FrameError(f"masks are {masks.shape}, depth_m {depth_m.shape}, the camera {size}; wanted one height and width")
    if masks.ndim == 3:
        if masks.dtype != np.bool_:
            raise FrameError(f"masks are {masks.dtype} {masks.shape}, wanted bool (N, H, W)")
        return label_image(masks.astype(np.bool_, copy=False)).astype(np.int64)
    if masks.dtype.kind not in "iu":
        raise FrameError(f"label image: got {masks.dtype}, wanted whole numbers")
    return masks.astype(np.int64, copy=False)
