"""A walk through a simulated world, there and back (or lap after lap) for as long as is asked: new views of the same things."""

from collections.abc import Collection
from typing import Any

import numpy as np
from simulated_runs import Job, keyframes_of, make_recording

from seo_slam.config import Config
from seo_slam.records import Trajectory
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.visible import View
from seo_slam.types import Frame, IntArray


class LongWalk(SimulatedRecording):
    """A recording that comes by again. Every picture is drawn once; noise of depth, odometry and detector is new each time."""

    def __init__(self, once: SimulatedRecording, frames: int, sources: IntArray | None = None) -> None:
        """Go through ``once``, a recording of a scene that does not change, until there are ``frames``.

        Args:
            once: what is walked through.
            frames: how many.
            sources: (frames,) the frame of ``once`` that each one shows; None: forth and back.
        """
        stamps_s = once.trajectory.timestamps_s
        period_s = float(np.median(np.diff(stamps_s)))
        self._once = once
        self._sources = turning(len(once), frames) if sources is None else sources
        self._drawn: dict[int, Rendered] = {}
        path = Trajectory(float(stamps_s[0]) + period_s * np.arange(frames), once.trajectory.T_world_camera[self._sources])
        super().__init__(
            once.name,
            once.scene,
            path,
            once.camera,
            seed=once.seed,
            level=once.level,
            sensor_knobs=once.sensor_knobs,
            detector_knobs=once.detector_knobs,
            look_alikes=once.look_alikes,
        )

    def rendered(self, index: int) -> Rendered:
        """Return what a perfect camera sees in a frame."""
        source = int(self._sources[index])
        if source not in self._drawn:
            self._drawn[source] = self._once.rendered(source)
        return self._drawn[source]

    def show_only(self, seer: Any, wanted: Collection[int]) -> None:
        """Tell one seer what is in some frames; no detector learns of it, and no depth is made."""
        for index in sorted(wanted):
            stamp_s = float(self.trajectory.timestamps_s[index])
            pose = self.trajectory.T_world_camera[index]
            seer.show(stamp_s, View(index, self.scene.world_at(stamp_s), self.camera, pose, self.rendered(index)))

    def frames(self, wanted: Collection[int]) -> list[Frame]:
        """Return all frames, ready; those that are not wanted are black and have no depth."""
        size = (self.camera.height, self.camera.width)
        black, no_depth = np.zeros((*size, 3), dtype=np.uint8), np.zeros(size, dtype=np.float32)
        return [
            self.frame(index) if index in wanted else Frame(stamp_s, black, no_depth, self.camera, index)
            for index, stamp_s in enumerate(self.trajectory.timestamps_s.tolist())
        ]


def turning(length: int, count: int) -> IntArray:
    """Return (count,) numbers that go up to ``length - 1`` and down to 0, and again."""
    at = np.arange(count) % (2 * length - 2)
    return np.minimum(at, 2 * length - 2 - at)


def walk_of(job: Job, frames: int) -> LongWalk:
    """Return the long walk through the room of a job; nothing is drawn yet."""
    return LongWalk(make_recording(job), frames)


def looked_at(walk: LongWalk, config: Config) -> set[int]:
    """Return which frames become keyframes."""
    return keyframes_of(walk.odometry, config.keyframes)
