"""The pinhole camera with Brown-Conrady distortion, as in OpenCV."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics of the colour camera to which depth is registered.

    Attributes:
        fx, fy: focal lengths in pixels.
        cx, cy: principal point in pixels; pixel centres have whole coordinates.
        width, height: image size in pixels.
        distortion: (k1, k2, p1, p2, k3) as in OpenCV; all 0 for a rectified image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        numbers = (self.fx, self.fy, self.cx, self.cy, *self.distortion)
        if not np.isfinite(numbers).all():
            raise FrameError(f"camera: got NaN or infinity in {numbers}")
        if self.fx <= 0 or self.fy <= 0 or self.width <= 0 or self.height <= 0:
            raise FrameError(f"camera: got fx {self.fx}, fy {self.fy}, size {self.width}x{self.height}; wanted all above 0")
        if len(self.distortion) != 5:
            raise FrameError(f"camera: got {len(self.distortion)} distortion terms, wanted (k1, k2, p1, p2, k3)")
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))

    @property
    def matrix(self) -> FloatArray:
        """The (3, 3) camera matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, p_camera: ArrayLike) -> FloatArray:
        """Project points (..., 3), in metres, to pixels (..., 2), lens distortion included.

        Points at or behind the camera plane become NaN.
        """
        p = np.asarray(p_camera, dtype=np.float64)
        z = np.where(p[..., 2] > 1e-9, p[..., 2], np.nan)
        x, y = _distort(p[..., 0] / z, p[..., 1] / z, self.distortion)
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def undistort(self, uv_px: ArrayLike) -> FloatArray:
        """Return normalised ray coordinates (..., 2) = (x/z, y/z) of pixels (..., 2), lens distortion removed.

        Newton's method on the distortion polynomial; below 1e-9 px of error wherever the polynomial rises with the radius. Where
        it does not (a calibration that was never fitted out there), the value is the best found: ``seo-slam check`` warns of it.
        """
        uv = np.asarray(uv_px, dtype=np.float64)
        x0 = (uv[..., 0] - self.cx) / self.fx
        y0 = (uv[..., 1] - self.cy) / self.fy
        if not any(self.distortion):
            return np.stack([x0, y0], axis=-1)
        x, y = x0.copy(), y0.copy()
        for _ in range(20):
            dx, dy = _newton_step(x, y, x0, y0, self.distortion)
            x, y = x + dx, y + dy
            if max(float(np.abs(dx).max(initial=0.0)), float(np.abs(dy).max(initial=0.0))) < 1e-12:
                break
        return np.stack([x, y], axis=-1)

    def back_project(self, uv_px: ArrayLike, depth_m: ArrayLike) -> FloatArray:
        """Return points (..., 3) in metres, camera frame, of pixels (..., 2) with depth along z (...)."""
        z = np.asarray(depth_m, dtype=np.float64)
        xy = self.undistort(uv_px)
        return np.concatenate([xy * z[..., None], z[..., None]], axis=-1)

    def rays(self) -> FloatArray:
        """Return (height, width, 2): the normalised ray of every pixel. Computed once a camera, read-only."""
        return _rays(self)


@lru_cache(maxsize=8)
def _rays(camera: Camera) -> FloatArray:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.undistort(np.stack([u, v], axis=-1))
    rays.flags.writeable = False
    return rays


def _distort(x: FloatArray, y: FloatArray, distortion: tuple[float, float, float, float, float]) -> tuple[FloatArray, FloatArray]:
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return xd, yd


def _newton_step(
    x: FloatArray, y: FloatArray, x0: FloatArray, y0: FloatArray, distortion: tuple[float, float, float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """The step from (x, y) towards the point that the lens shows at (x0, y0)."""
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))  # d radial / d r2, times 2
    xd, yd = _distort(x, y, distortion)
    a = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    b = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y  # the Jacobian [[a, b], [b, d]] is symmetric
    d = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    determinant = a * d - b * b
    determinant = np.where(np.abs(determinant) < 1e-3, 1e-3, determinant)
    ex, ey = x0 - xd, y0 - yd
    dx, dy = (d * ex - b * ey) / determinant, (a * ey - b * ex) / determinant
    return np.clip(dx, -0.2, 0.2), np.clip(dy, -0.2, 0.2)  # so that a fold of the polynomial cannot throw a pixel far away
