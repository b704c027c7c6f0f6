"""What smoothers refuse before anything changes: matrices that are no covariances, measurements that a landmark does not have."""

import numpy as np

from seo_slam.errors import FrameError, UnknownLandmarkError
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray

_LEAST_VARIANCE = 1e-14
"""Below it (0.1 um, 0.1 urad) factorisations fail; GTSAM's loses the graph."""


def require_covariances(what: str, covariances: FloatArray) -> None:
    """Raise ``FrameError`` unless all of (N, n, n) are symmetric and positive definite, so that no bad one spoils the estimate."""
    if not len(covariances):
        return
    skew = np.abs(covariances - covariances.transpose(0, 2, 1)).max(axis=(1, 2)) > 1e-6 * np.abs(covariances).max(axis=(1, 2))
    least = np.linalg.eigvalsh(covariances).min(axis=1)
    bad = skew | ~(least > _LEAST_VARIANCE)
    if bad.any():
        row = int(np.argmax(bad))
        found = "not symmetric" if skew[row] else f"its smallest variance is {least[row]:.3g}"
        raise FrameError(f"{what}: row {row}: {found}; wanted a symmetric matrix with variances above {_LEAST_VARIANCE:g}")


def require_measurements(landmark_id: int, measurements: IntArray, count: int, has_priors: bool) -> tuple[int, ...]:
    """Return which measurements a split is to move, rising.

    Args:
        landmark_id: whose they are.
        measurements: (M,) numbers of measurements, from 0.
        count: how many the landmark has.
        has_priors: a continued map knew of it, so that it may do without measurements.

    Raises:
        UnknownLandmarkError: there is no such measurement, none is moved, or nothing would be left.
    """
    chosen = tuple(sorted({int(n) for n in measurements}))
    if not chosen:
        raise UnknownLandmarkError(f"landmark {landmark_id} cannot be split: no measurements are given for the new one")
    if chosen[0] < 0 or chosen[-1] >= count:
        wrong = chosen[0] if chosen[0] < 0 else chosen[-1]
        raise UnknownLandmarkError(f"landmark {landmark_id} has no measurement {wrong}: it has {count}, counted from 0")
    if len(chosen) == count and not has_priors:
        raise UnknownLandmarkError(f"landmark {landmark_id} cannot be split: none of its {count} measurements would be left")
    return chosen
