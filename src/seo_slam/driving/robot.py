"""A simulated robot in a simulated home: it drives as it is told, and sees what its camera would see from there."""

from typing import Protocol

import numpy as np

from seo_slam.camera import Camera
from seo_slam.driving.driven_odometry import DrivenOdometry
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.outcomes import Command
from seo_slam.records import Trajectory
from seo_slam.simulation.detector import DetectorKnobs, SimulatedDetector, View
from seo_slam.simulation.free_space import ROBOT_RADIUS_M, FreeSpace
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.sensors import sense_depth
from seo_slam.simulation.simulated_recording import Seer, simulated_camera
from seo_slam.simulation.standpoints import EYE_M
from seo_slam.simulation.tour import MOST_TURN_RAD_S, RATE_HZ, SPEED_M_S
from seo_slam.simulation.trajectory import look_at
from seo_slam.simulation.world import World
from seo_slam.types import Frame

LOOK_DOWN_RAD = 0.17
"""How far the camera looks down, as on the tour while it walks."""

FRAMES_A_DRIVE = 100_000
"""Frame numbers that a drive has for itself: they key the noise, so that no two drives, nor the tour, see the same."""

_TICK_S = 1.0 / 60.0
_ON_COURSE_RAD = np.radians(25.0)  # farther off its course it turns on the spot
_THERE_M, _TURNED_RAD = 1e-3, 1e-3


class Filmed(Protocol):
    """What can be filmed and mapped: a tour of a home, or a drive through it. Seers are told what is in every frame."""

    seed: int
    level: float
    camera: Camera
    detector_knobs: DetectorKnobs

    @property
    def detector(self) -> SimulatedDetector:
        """The imperfect detector; it knows the frames that were drawn."""
        ...

    def show_to(self, seer: Seer) -> None:
        """Tell one more detector what is in every frame that is drawn from now on."""
        ...


class SimulatedRobot:
    """A disc with a camera on a mast, in a home where nothing moves while it drives.

    It obeys at once, within its limits of speed and turning, and stops where it touches something. The detector is the one of the home's
    recording: it makes the same lasting mistakes, and new ones of the moment.

    Attributes:
        world: what there is.
        camera, seed, level, detector_knobs: of the home's recording.
        detector: knows the frames that this robot took.
        odometry: reports its poses, to be given to the pipeline that maps its frames.
        xy_world, yaw_rad: where it is, (2,) metres, and where it looks.
        collisions: how often it came to touch something.
        driven_m: the way it has made.
    """

    def __init__(
        self,
        home: SimulatedHome,
        start_xy: FloatArray,
        start_yaw_rad: float = 0.0,
        *,
        world: World | None = None,
        drive: int = 0,
        rate_hz: float = RATE_HZ,
        drifts: bool = False,
        size_px: tuple[int, int] | None = None,
        look_down_rad: float = LOOK_DOWN_RAD,
    ) -> None:
        """Put a robot somewhere.

        Args:
            home: where; its level, seed and knobs hold for the robot too.
            start_xy: (2,) metres, world frame.
            start_yaw_rad: heading.
            world: the home with things moved on its furniture; None: as at its first frame.
            drive: number of the drive, 0, 1, …: key of the noise.
            rate_hz: frames a second.
            drifts: odometry drifts as the level says; else poses are given, as DualMap assumes.
            size_px: width and height of the images; None: as the home's.
            look_down_rad: of the camera.

        Raises:
            ConfigError: it would stand in something, a drive below 0, a rate that is not above 0, or an image below 32 pixels.
        """
        if drive < 0 or not rate_hz > 0:
            raise ConfigError(f"robot: got drive {drive} at {rate_hz} frames a second, wanted 0 or more, above 0")
        self.home = home
        self.world = home.world if world is None else world
        self.camera = home.camera if size_px is None else simulated_camera(*size_px)
        self.seed, self.level, self.detector_knobs = home.seed, home.level, home.detector_knobs
        self.detector = SimulatedDetector(home.detector_knobs, home.seed, home.detector.phantoms, home.look_alikes)
        self.odometry = DrivenOdometry(home.sensor_knobs, (home.seed, drive)) if drifts else DrivenOdometry()
        self.xy_world = np.array(start_xy, dtype=np.float64).reshape(2)
        self.yaw_rad = float(start_yaw_rad)
        self.collisions = 0
        self.driven_m = 0.0
        self._free: FreeSpace = home.free  # things that move from furniture to furniture leave the floor as it is
        if touches(self._free, self.xy_world):
            raise ConfigError(f"robot: got a start at {np.round(self.xy_world, 2).tolist()}, wanted one with {ROBOT_RADIUS_M} m of room")
        self._period_s = 1.0 / rate_hz
        self._look_down_rad = look_down_rad
        self._seers: list[Seer] = [self.detector]
        self._index = FRAMES_A_DRIVE * (drive + 1)
        self._time_s = 0.0
        self._touching = False
        self._stamps_s: list[float] = []
        self._poses: list[FloatArray] = []

    @property
    def T_world_camera(self) -> FloatArray:
        """(4, 4) true pose of the camera."""
        eye = np.array([*self.xy_world, EYE_M])
        ahead = np.array([np.cos(self.yaw_rad), np.sin(self.yaw_rad), -np.tan(self._look_down_rad)])
        return look_at(eye, eye + ahead)

    @property
    def trajectory(self) -> Trajectory:
        """True poses of all frames so far."""
        return Trajectory(np.array(self._stamps_s), np.array(self._poses).reshape(-1, 4, 4))

    def show_to(self, seer: Seer) -> None:
        """Tell one more detector what is in every frame that is drawn from now on."""
        self._seers.append(seer)

    def frame(self) -> Frame:
        """Take a picture where it is, and show it to the detectors. A second one before it drives on has the same stamp."""
        T_world_camera = self.T_world_camera
        rendered = self.home.renderer(self.world, self.camera, T_world_camera)
        view = View(self._index, self.world, self.camera, T_world_camera, rendered)
        for seer in self._seers:
            seer.show(self._time_s, view)
        if not self._stamps_s or self._time_s > self._stamps_s[-1]:
            self.odometry.moved_to(self._time_s, T_world_camera)
            self._stamps_s.append(self._time_s)
            self._poses.append(T_world_camera)
        depth_m = sense_depth(rendered.depth_m, self.home.sensor_knobs, self.seed, self._index)
        return Frame(self._time_s, rendered.rgb, depth_m, self.camera, self._index)

    def drive(self, command: Command, seconds: float | None = None) -> None:
        """Do as it is told for a while; None: until the next frame is due.

        Raises:
            ConfigError: no time at all.
        """
        lasts_s = self._period_s if seconds is None else seconds
        if not lasts_s > 0:
            raise ConfigError(f"robot: got {seconds} s to drive, wanted above 0")
        ticks = max(round(lasts_s / _TICK_S), 1)
        for _ in range(ticks):
            self._tick(command, lasts_s / ticks)
        self._time_s = round(self._time_s + lasts_s, 6)
        self._index += 1

    def _tick(self, command: Command, tick_s: float) -> None:
        if command.kind == "go":
            way = np.asarray(command.xy_world, dtype=np.float64) - self.xy_world
            left_m = float(np.linalg.norm(way))
            if left_m > _THERE_M:
                off_rad = self._turn(float(np.arctan2(way[1], way[0])), tick_s)
                if abs(off_rad) < _ON_COURSE_RAD:
                    self._advance(way / left_m * min(left_m, SPEED_M_S * tick_s * np.cos(off_rad)))
                return
        if command.kind != "stop" and command.yaw_rad is not None:
            self._turn(command.yaw_rad, tick_s)

    def _turn(self, yaw_rad: float, tick_s: float) -> float:
        """Turn towards a heading; return how far off it was."""
        off_rad = float((yaw_rad - self.yaw_rad + np.pi) % (2.0 * np.pi) - np.pi)
        if abs(off_rad) > _TURNED_RAD:
            self.yaw_rad += float(np.clip(off_rad, -MOST_TURN_RAD_S * tick_s, MOST_TURN_RAD_S * tick_s))
        return off_rad

    def _advance(self, step_m: FloatArray) -> None:
        target = self.xy_world + step_m
        if touches(self._free, target):
            self.collisions += not self._touching  # leaning on something is one collision, however long
            self._touching = True
            return
        self._touching = False
        self.xy_world = target
        self.driven_m += float(np.linalg.norm(step_m))


def touches(free: FreeSpace, xy_world: FloatArray, radius_m: float = ROBOT_RADIUS_M) -> bool:
    """Whether a robot at a point (2,) reaches into the middle of a cell in which something is; outside the home it always does."""
    return bool(free.clearance_at(np.asarray(xy_world)[None])[0] + free.cell_m / 2.0 < radius_m)
