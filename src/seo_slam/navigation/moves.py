"""What a searching robot does with its body: walk a path, look somewhere, turn to something. One command a frame."""

from collections.abc import Callable, Generator, Sequence
from typing import Literal

import numpy as np

from seo_slam.errors import NoPathError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.motion import Follower, Stance, turn_to, turned_by, wait
from seo_slam.navigation.outcomes import Command
from seo_slam.navigation.senses import Senses
from seo_slam.navigation.ways import Ways
from seo_slam.settings.navigation import NavigationSettings

Walked = Literal["there", "blocked", "diverted"]

_MOVED_M, _TURNED_RAD = 0.05, 0.1  # less than both is standing still


class Moves:
    """Generators of commands; each ends when it is done, and returns how it went.

    Attributes:
        path_world: (N, 2) the path that is, or was last, walked.
    """

    def __init__(self, senses: Senses, ways: Ways, settings: NavigationSettings) -> None:
        """Take what tells where the robot is, and the floor."""
        self.path_world: FloatArray = np.zeros((0, 2))
        self._senses = senses
        self._ways = ways
        self._settings = settings

    def walk(self, path_world: FloatArray, divert: Callable[[], bool] | None = None) -> Generator[Command, None, Walked]:
        """Walk a path (N, 2); other paths to its end are tried where the robot does not get ahead.

        Args:
            path_world: metres, world frame.
            divert: asked once a frame; ends the walk when it says so.
        """
        goal = path_world[-1]
        for _ in range(self._settings.replans + 1):
            self.path_world = path_world
            walked = yield from self._follow(path_world, divert)
            if walked != "blocked":
                return walked
            try:
                path_world = self._ways.far.path(self._senses.stance.xy_world, goal)
            except NoPathError:
                return "blocked"
        return "blocked"

    def turn(self, yaw_rad: float) -> Generator[Command, None, None]:
        """Turn to a heading; a robot that does not turn any more is left as it is."""
        still = _Standstill(self._settings.stuck_frames)
        while (command := turn_to(yaw_rad, self._senses.stance, self._settings)) is not None and not still.at(self._senses.stance):
            yield command

    def dwell(self) -> Generator[Command, None, None]:
        """Stay for as many keyframes as a look lasts."""
        first = self._senses.keyframes
        for _ in range(self._settings.look_frames):
            if self._senses.keyframes - first >= self._settings.look_keyframes:
                return
            yield wait(self._senses.stance)

    def look(self, headings_rad: Sequence[float], enough: Callable[[], bool]) -> Generator[Command, None, None]:
        """Look in some directions, the nearest end first, until it is enough."""
        from_first = abs(turned_by(self._senses.stance.yaw_rad, headings_rad[0]))
        from_last = abs(turned_by(self._senses.stance.yaw_rad, headings_rad[-1]))
        for heading in headings_rad if from_first <= from_last else headings_rad[::-1]:
            yield from self.turn(heading)
            yield from self.dwell()
            if enough():
                return

    def _follow(self, path_world: FloatArray, divert: Callable[[], bool] | None) -> Generator[Command, None, Walked]:
        follower = Follower(path_world, self._ways.grid, self._settings)
        still = _Standstill(self._settings.stuck_frames)
        while True:
            if divert is not None and divert():
                return "diverted"
            command = follower.command(self._senses.stance)
            if command is None:
                return "there"
            if still.at(self._senses.stance):
                return "blocked"
            yield command


class _Standstill:
    """Tells when a robot has stayed where it is for too many frames."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._count = 0
        self._stance: Stance | None = None

    def at(self, stance: Stance) -> bool:
        before = self._stance
        if (
            before is None
            or np.linalg.norm(stance.xy_world - before.xy_world) > _MOVED_M
            or abs(turned_by(before.yaw_rad, stance.yaw_rad)) > _TURNED_RAD
        ):
            self._stance, self._count = stance, 0
            return False
        self._count += 1
        return self._count >= self._frames
