"""A walk past a row of tables and back, with the sway of a hand."""

from dataclasses import dataclass

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.simulation.draws import generator
from seo_slam.simulation.trajectory import look_at

WALK_S = 199 / 6.0
"""How long the whole walk takes: 200 frames at 6 a second."""

_DISTANCE_M = 1.95  # from the line that the walk goes around, which runs _INSIDE_M behind the front of the row
_INSIDE_M = 0.2
_SHORTER_M = 0.4  # that line ends this far before the ends of the row
_BEYOND_M = 0.5  # the gaze goes this far beyond the ends of the row, and stays longer there: chairs and bins
_RAMP = 0.17  # share of a pass in which it is sped up, and slowed down


@dataclass(frozen=True, slots=True)
class TableRow:
    """The space that a row of tables takes: corners in the plane and height of the tops; world frame, metres. Its front is at low y."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]
    top_m: float

    @property
    def middle_x_m(self) -> float:
        """Middle of its length."""
        return (self.low_m[0] + self.high_m[0]) / 2.0

    @property
    def half_m(self) -> float:
        """Half of its length."""
        return (self.high_m[0] - self.low_m[0]) / 2.0


class RoomWalk:
    """A camera path: along the row, around its ends as far as there is time, and back at another height."""

    def __init__(self, row: TableRow, seed: int, name: str = "") -> None:
        """Draw the sways.

        Args:
            row: what is walked past and looked at.
            seed: of the sways.
            name: the rest of their key.
        """
        self.row = row
        draws = generator(seed, name, "walk")
        self._side = float(draws.choice((-1.0, 1.0)))
        self._rise_m = float(draws.choice((-1.0, 1.0))) * 0.11  # how much higher the first pass is than the mean
        self._sways = [[(float(draws.uniform(0.8, 1.2)), float(draws.uniform())) for _ in range(3)] for _ in range(4)]
        self._core_m = max(row.half_m - _SHORTER_M, 0.1)
        # A long row leaves less time to look around its ends: at most 7 m a pass.
        self._turn_rad = float(np.clip((3.4 - self._core_m) / _DISTANCE_M, 0.35, 1.05))

    def poses(self, timestamps_s: FloatArray) -> FloatArray:
        """Return ``T_world_camera`` (N, 4, 4) at times (N,) between 0 and ``WALK_S``; level, gravity known."""
        share = timestamps_s / WALK_S
        along = self._side * _there_and_back(share)
        sway = [_sway(share, terms) for terms in self._sways]
        distance_m = _DISTANCE_M + 0.2 * sway[0]
        centre, normal = self._rail(along)
        eyes = np.empty((len(share), 3))
        eyes[:, :2] = centre + distance_m[:, None] * normal
        eyes[:, 2] = 1.5 + self._rise_m * np.tanh((0.5 - share) / 0.06) + 0.08 * sway[1]
        middle_y = (self.row.low_m[1] + self.row.high_m[1]) / 2.0
        targets = np.empty_like(eyes)
        targets[:, 0] = self.row.middle_x_m + (self.row.half_m + _BEYOND_M) * along * (1.3 - 0.3 * along**2) + 0.12 * sway[2]
        targets[:, 1] = middle_y
        targets[:, 2] = self.row.top_m - 0.14 + 0.06 * sway[3]
        return np.stack([look_at(eye, target) for eye, target in zip(eyes, targets, strict=True)])

    def trajectory(self, frames: int) -> Trajectory:
        """Return ``frames`` poses of the walk, evenly in time.

        Raises:
            ConfigError: fewer than two frames.
        """
        if frames < 2:
            raise ConfigError(f"frames: got {frames}, wanted at least 2")
        stamps = np.round(np.linspace(0.0, WALK_S, frames), 6)
        return Trajectory(stamps, self.poses(stamps))

    def _rail(self, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """For shares -1..1 of the way: the point (N, 2) that is gone around, and the outward direction (N, 2)."""
        reach_m = self._core_m + _DISTANCE_M * self._turn_rad
        s_m = along * reach_m
        straight = np.clip(s_m, -self._core_m, self._core_m)
        turn = (s_m - straight) / _DISTANCE_M
        centre = np.stack([self.row.middle_x_m + straight, np.full_like(s_m, self.row.low_m[1] + _INSIDE_M)], axis=-1)
        return centre, np.stack([np.sin(turn), -np.cos(turn)], axis=-1)


def change_stamp(timestamps_s: FloatArray) -> float:
    """Return the time in the middle between the two frames at the half of a recording."""
    before = (len(timestamps_s) - 1) // 2
    return round(float(timestamps_s[before] + timestamps_s[before + 1]) / 2.0, 6)


def _there_and_back(share: FloatArray) -> FloatArray:
    """-1 to 1 in the first half of 0..1 and back in the second, at even speed but for soft starts and stops."""
    u = 1.0 - np.abs(2.0 * share - 1.0)
    ramp = _RAMP

    def risen(x: FloatArray) -> FloatArray:  # integral of sin^2 from standing to full speed
        x = np.clip(x, 0.0, ramp)
        return x / 2.0 - ramp / (2.0 * np.pi) * np.sin(np.pi * x / ramp)

    way = risen(u) + np.clip(u - ramp, 0.0, 1.0 - 2.0 * ramp) + ramp / 2.0 - risen(1.0 - u)
    return 2.0 * way / (1.0 - ramp) - 1.0


def _sway(share: FloatArray, terms: list[tuple[float, float]]) -> FloatArray:
    """A smooth curve in -1..1: three slow sines."""
    curve = np.zeros_like(share)
    for (stretch, phase), cycles, weight in zip(terms, (1.3, 3.1, 6.0), (0.55, 0.3, 0.15), strict=True):
        curve += weight * np.sin(2.0 * np.pi * (cycles * stretch * share + phase))
    return curve
