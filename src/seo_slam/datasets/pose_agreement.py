"""Do the poses explain the depth? Points seen in one frame, carried into another by the poses, must meet the depth seen there.

The same is tried with the commonest mistakes undone (poses inverted, camera axes of OpenGL, other depth scales): where one of those
explains the depth much better than the recording as it is, that mistake was made.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.types import Frame

AS_IS = "as they are"
INVERTED = "inverted (they are T_camera_world)"
OPENGL = "with the camera axes of OpenGL (y up, z backwards)"
_DEPTH_FACTORS = (0.1, 0.2, 5.0, 10.0, 1000.0 / 6553.5, 6553.5 / 1000.0, 5000.0 / 6553.5, 6553.5 / 5000.0)
_GRID_PX = 8
_TOLERANCE = 0.02  # of the distance


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well poses explain depth.

    Attributes:
        shares: hypothesis -> share of the points that meet the depth of the other frame within 2 % of the distance.
        best: the hypothesis that explains most.
        depth_factor: what all depth must be multiplied by under ``best``; 1 where depth is not the fault.
        pairs: frame pairs that were compared.
    """

    shares: dict[str, float]
    best: str
    depth_factor: float
    pairs: int


def measure_agreement(pairs: Sequence[tuple[Frame, FloatArray, Frame, FloatArray]]) -> Agreement | None:
    """Compare depth over some pairs of frames that overlap but stand apart.

    Args:
        pairs: a frame, its ``T_world_camera``, another frame, its ``T_world_camera``.

    Returns:
        None where no pair has points to compare.
    """
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    variants: dict[str, Callable[[FloatArray], FloatArray]] = {
        AS_IS: lambda T: T,
        INVERTED: inverse,
        OPENGL: lambda T: T @ flip,
    }
    shares = {name: _mean_share([(a, change(Ta), b, change(Tb)) for a, Ta, b, Tb in pairs], 1.0) for name, change in variants.items()}
    factors = {f"depth x {factor:.4g}": factor for factor in _DEPTH_FACTORS}
    shares |= {name: _mean_share(pairs, factor) for name, factor in factors.items()}
    if not pairs or np.isnan(shares[AS_IS]):
        return None
    best = max(shares, key=lambda name: shares[name])
    return Agreement(shares=shares, best=best, depth_factor=factors.get(best, 1.0), pairs=len(pairs))


def _mean_share(pairs: Sequence[tuple[Frame, FloatArray, Frame, FloatArray]], depth_factor: float) -> float:
    shares = [_share(a, inverse(Tb) @ Ta, b, depth_factor) for a, Ta, b, Tb in pairs]
    known = [share for share in shares if share is not None]
    return float(np.mean(known)) if known else float("nan")


def _share(a: Frame, T_b_a: FloatArray, b: Frame, depth_factor: float) -> float | None:
    """Share of all depth points of ``a`` that land in ``b`` on the surface seen there; points that miss the image disagree."""
    v, u = np.mgrid[0 : a.camera.height : _GRID_PX, 0 : a.camera.width : _GRID_PX]
    depth_m = a.depth_m[v, u]
    seen = depth_m > 0
    if seen.sum() < 50:
        return None
    uv_px = np.stack([u[seen], v[seen]], axis=-1)
    p_b = transform_points(T_b_a, a.camera.back_project(uv_px, depth_factor * depth_m[seen]))
    uv_b = b.camera.project(p_b)
    inside = (
        (p_b[:, 2] > 0.05)
        & (uv_b[:, 0] >= 0)
        & (uv_b[:, 0] <= b.camera.width - 1)
        & (uv_b[:, 1] >= 0)
        & (uv_b[:, 1] <= b.camera.height - 1)
    )
    cells = np.round(uv_b[inside]).astype(np.int64)
    met_m = depth_factor * b.depth_m[cells[:, 1], cells[:, 0]]
    difference = np.abs(met_m - p_b[inside, 2])
    comparable = len(uv_px) - int((met_m == 0).sum())
    if comparable < 50:
        return None
    return float((difference < _TOLERANCE * p_b[inside, 2]).sum()) / comparable
