"""What a navigator knows of the moment: where it is, and what the local concrete map holds of this search."""

import logging
from collections import Counter
from collections.abc import Sequence

import numpy as np

from seo_slam.abstraction.abstract_map import Anchor
from seo_slam.errors import OptimizationError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.coverage import Coverage
from seo_slam.navigation.looking import Eye
from seo_slam.navigation.motion import Stance
from seo_slam.navigation.parts import Mapper
from seo_slam.records import StepResult
from seo_slam.settings.navigation import NavigationSettings
from seo_slam.types import Frame, Landmark

_LOG = logging.getLogger(__name__)


class Senses:
    """Steps the mapper and keeps what the navigator asks of it.

    The mapper may go on from search to search; only what was seen since ``restart`` counts, since things may have been moved between.

    Attributes:
        T_world_camera: (4, 4) pose of its camera.
        stance: where the robot is.
        eye: its camera.
        lost: odometry is lost; ``stance`` is the last one known.
        landmarks: stable and tentative ones seen in this search.
        forgotten: those seen in this search that the mapper has dropped since, as they were last: what is seen only in passing never
            becomes stable, and a mapper keeps it for a while only.
        keyframes: of this search, so far.
        coverage: how much of each anchor was seen.
    """

    def __init__(self, mapper: Mapper, settings: NavigationSettings) -> None:
        """Take a mapper, which may hold a map already."""
        self.coverage = Coverage(settings.clear_range_m, settings.local_observations)
        self._mapper = mapper
        self.restart(())

    def restart(self, anchors: Sequence[Anchor]) -> None:
        """Begin a search over the anchors of a map."""
        self.T_world_camera: FloatArray = np.eye(4)
        self.stance = Stance(np.zeros(2), 0.0)
        self.eye = Eye(0.0, 0.0, 0.0, 0.0)
        self.lost = False
        self.landmarks: tuple[Landmark, ...] = ()
        self.forgotten: tuple[Landmark, ...] = ()
        self.keyframes = 0
        self.coverage.restart(anchors)
        self._started_s: float | None = None
        self._times_seen: Counter[int] = Counter()
        self._nearest_m: dict[int, float] = {}

    def take(self, frame: Frame) -> None:
        """Process a frame.

        Raises:
            FrameError: the frame cannot be taken, as of ``Mapper.step``.
        """
        if self._started_s is None:
            self._started_s = frame.timestamp_s
        try:
            result = self._mapper.step(frame)
        except OptimizationError as error:  # the world's failure: the robot waits, it does not die
            _LOG.warning("frame %d: %s", frame.index, error)
            self.lost = True
            return
        self.lost = result.odometry_status == "lost" or not np.isfinite(result.T_world_camera).all()
        if self.lost:
            return
        self.T_world_camera = result.T_world_camera
        self.stance = Stance.of(result.T_world_camera)
        self.eye = Eye.of(result.T_world_camera, frame.camera)
        if result.is_keyframe:
            self._take_keyframe(frame, result)

    def observations(self, landmark: Landmark) -> int:
        """Return how often a landmark was seen in this search.

        What the mapper knew before is counted here: its own count is another one after it has merged or split the landmark.
        """
        is_new = landmark.first_seen_s >= (self._started_s or 0.0)
        return landmark.observations if is_new else self._times_seen[landmark.id]

    def nearest_m(self, landmark: Landmark) -> float:
        """Return from how near, on the floor, a landmark was seen in this search."""
        return self._nearest_m.get(landmark.id, np.inf)

    def _take_keyframe(self, frame: Frame, result: StepResult) -> None:
        self.keyframes += 1
        self.coverage.add(frame, result.T_world_camera)
        since = self._started_s or 0.0
        before = (*self.forgotten, *self.landmarks)
        rows = self._rows()
        self.landmarks = tuple(row for row in rows if row.last_seen_s >= since and row.state != "lost")
        known = {row.id for row in rows}  # also what is lost: its place was seen to be empty
        self.forgotten = tuple(row for row in before if row.id not in known)
        for row in self.landmarks:
            if row.last_seen_s >= frame.timestamp_s:
                self._times_seen[row.id] += 1
                away_m = float(np.linalg.norm(row.position_m[:2] - self.stance.xy_world))
                self._nearest_m[row.id] = min(away_m, self.nearest_m(row))

    def _rows(self) -> tuple[Landmark, ...]:
        local = self._mapper.snapshot()
        return (*local.landmarks, *getattr(local, "tentative", ()))
