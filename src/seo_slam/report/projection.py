"""From the world to the plane of the report's map, and from that plane to the picture."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import AnyArray, FloatArray
from seo_slam.records import Trajectory

_LEAST_SPAN_M = 0.5
_FAR_FACTOR = 6.0
_STEPS_M = tuple(m * 10.0**e for e in range(-3, 5) for m in (1, 2, 5))


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """The plane that the map shows.

    Attributes:
        axes: (2, 3) unit rows, world frame: what points right and what points up in the map.
        origin: (3,) world point at the map's (0, 0), metres.
        names: of the two axes.
        caption: what the reader looks at, one sentence.
    """

    axes: FloatArray
    origin: FloatArray
    names: tuple[str, str]
    caption: str

    def points(self, p_world: FloatArray) -> FloatArray:
        """(..., 3) world points to (..., 2) on the plane, metres."""
        return np.asarray((p_world - self.origin) @ self.axes.T, dtype=np.float64)

    def covariance(self, cov_world: FloatArray) -> FloatArray:
        """(3, 3) world covariance to (2, 2) on the plane."""
        return np.asarray(self.axes @ cov_world @ self.axes.T, dtype=np.float64)


def choose_projection(gravity: str, trajectory: Trajectory) -> Projection:
    """Look down on the world where up is known, else along the first camera's vertical.

    Without gravity the first camera is the only direction a person can recognise: its right stays right, its view goes up.
    """
    if gravity.strip().lower() != "unknown":
        return Projection(np.eye(3)[:2], np.zeros(3), ("x", "y"), "Seen from above: world x to the right, y up, z towards you.")
    T = trajectory.T_world_camera[0] if len(trajectory) else np.eye(4)
    caption = (
        "Which way is up is not known for this recording. Drawn in the frame of the first camera: "
        "its right to the right, its viewing direction up; a tilted camera tilts this picture."
    )
    return Projection(np.stack([T[:3, 0], T[:3, 2]]), T[:3, 3].copy(), ("right", "ahead"), caption)


@dataclass(frozen=True, slots=True)
class View:
    """A window on the plane and the picture it fills.

    Attributes:
        left_m, top_m: plane coordinates of the picture's upper left corner.
        px_per_m: scale.
        width_px, height_px: size of the picture.
    """

    left_m: float
    top_m: float
    px_per_m: float
    width_px: float
    height_px: float

    def pixels(self, p_plane: FloatArray) -> FloatArray:
        """(..., 2) metres on the plane to pixels, y down."""
        return np.asarray((p_plane - np.array([self.left_m, self.top_m])) * np.array([1.0, -1.0]) * self.px_per_m)

    def grid_step_m(self, least_px: float) -> float:
        """The smallest of 1, 2, 5 x 10^n metres that is at least ``least_px`` wide."""
        return next((step for step in _STEPS_M if step * self.px_per_m >= least_px), _STEPS_M[-1])

    def lines(self, axis: int, step_m: float) -> Iterator[tuple[float, float]]:
        """Grid lines across an axis: ``(metres, pixels)`` of every multiple of the step inside the picture."""
        start = self.left_m if axis == 0 else self.top_m - self.height_px / self.px_per_m
        length_m = (self.width_px if axis == 0 else self.height_px) / self.px_per_m
        for k in range(int(np.ceil(start / step_m)), int(np.floor((start + length_m) / step_m)) + 1):
            at_px = (k * step_m - start) * self.px_per_m
            yield k * step_m, at_px if axis == 0 else self.height_px - at_px


def fit_view(p_plane: FloatArray, width_px: float, tallest: float, flattest: float, margin_px: float) -> View:
    """Fit points (N, 2) into a picture of a given width, with a margin.

    Args:
        p_plane: metres; none of them gives a window of 0.5 m around the origin.
        width_px: width of the picture.
        tallest: greatest height, as a share of the width.
        flattest: least height, as a share of the width.
        margin_px: free on every side.
    """
    low, high = (p_plane.min(axis=0), p_plane.max(axis=0)) if len(p_plane) else (np.zeros(2), np.zeros(2))
    centre, span = (low + high) / 2, np.maximum(high - low, _LEAST_SPAN_M)
    inner_px = width_px - 2 * margin_px
    scale = min(inner_px / span[0], (tallest * width_px - 2 * margin_px) / span[1])
    height_px = float(np.ceil(max(span[1] * scale + 2 * margin_px, flattest * width_px)))
    left, top = centre[0] - width_px / scale / 2, centre[1] + height_px / scale / 2
    return View(float(left), float(top), float(scale), width_px, height_px)


def far_away(p_plane: FloatArray) -> AnyArray:
    """(N,) bool: points (N, 2) so far from the others that they would shrink the map to a dot (or that are not finite).

    Far is more than 6 times the distance that holds 80 % of the points, and at least 3 m, from their median.
    """
    finite = np.isfinite(p_plane).all(axis=1)
    if finite.sum() < 3:
        return np.asarray(~finite)
    distance = np.full(len(p_plane), np.inf)
    distance[finite] = np.linalg.norm(p_plane[finite] - np.median(p_plane[finite], axis=0), axis=1)
    return np.asarray(distance > max(3.0, _FAR_FACTOR * float(np.quantile(distance[finite], 0.8))))


def hull(points: FloatArray) -> FloatArray:
    """The convex hull (H, 2) of points (N, 2), counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered)
    return np.array(_half_hull(ordered)[:-1] + _half_hull(ordered[::-1])[:-1])


def _half_hull(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
    chain: list[tuple[float, float]] = []
    for p in ordered:
        while len(chain) >= 2 and _turn(chain[-2], chain[-1], p) <= 0:
            chain.pop()
        chain.append(p)
    return chain


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
