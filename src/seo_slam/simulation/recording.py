"""A simulated recording of the desk: frames, detector, odometry and truth, all from one seed."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from seo_slam.camera import Camera
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.records import Trajectory
from seo_slam.simulation.desk import build_desk
from seo_slam.simulation.detector import DetectorKnobs, PhantomSpot, SimulatedDetector, View
from seo_slam.simulation.draws import generator
from seo_slam.simulation.labels import DESK_LOOK_ALIKES, PHANTOM_LABELS
from seo_slam.simulation.renderer import render
from seo_slam.simulation.sensors import SensorKnobs, drifting_odometry, require_level, sense_depth
from seo_slam.simulation.trajectory import swaying_arc
from seo_slam.simulation.world import STRUCTURE_ID, World
from seo_slam.types import Frame

RATE_HZ = 15.0
_FOCAL_SHARE = 265.0 / 320.0  # of the width: about 62 degrees across, as a Kinect
_TRUTH_VIEWS = 9


def desk_camera(width: int = 320, height: int = 240) -> Camera:
    """Return the simulated camera for an image size: no distortion, 62 degrees across."""
    focal = _FOCAL_SHARE * width
    return Camera(focal, focal, (width - 1) / 2.0, (height - 1) / 2.0, width, height)


class SimulatedDesk:
    """A camera that walks past a desk with fifteen things on it.

    Iterate it for ``Frame``s, drawn as they are asked for. The same arguments give the same bytes.
    """

    def __init__(self, seed: int = 0, frames: int = 90, width: int = 320, height: int = 240, level: float = 0.5) -> None:
        """Lay the desk and plan the walk; nothing is drawn yet.

        Args:
            seed: of everything.
            frames: how many, at 15 a second; with fewer of them the same arc is walked faster.
            width: of the images, pixels.
            height: of the images, pixels.
            level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.

        Raises:
            ConfigError: fewer than two frames, an image below 32 pixels, a level below 0.
        """
        if min(width, height) < 32:
            raise ConfigError(f"image size: got {width}x{height}, wanted at least 32 pixels each way")
        self.seed = seed
        self.level = require_level(level)
        self.camera = desk_camera(width, height)
        self.world = build_desk(seed)
        self.trajectory = swaying_arc(self.world.gaze_world, frames, seed, RATE_HZ)
        self.sensor_knobs = SensorKnobs.at_level(level)
        self.detector_knobs = DetectorKnobs.at_level(level)
        self.odometry: Trajectory = drifting_odometry(self.trajectory, self.sensor_knobs, seed)
        """What a robot's wheels or its visual odometry would report: drifting."""

    @cached_property
    def detector(self) -> SimulatedDetector:
        """The imperfect detector. It knows a frame once that frame has been drawn by iterating."""
        spots = phantom_spots(self.world, self.camera, self.trajectory, self.seed, self.detector_knobs.phantom_spots)
        return SimulatedDetector(self.detector_knobs, self.seed, spots, DESK_LOOK_ALIKES)

    def __len__(self) -> int:
        return len(self.trajectory)

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self)):
            yield self.frame(index)

    def frame(self, index: int) -> Frame:
        """Draw one frame, and show it to the detector."""
        T_world_camera = self.trajectory.T_world_camera[index]
        timestamp_s = float(self.trajectory.timestamps_s[index])
        rendered = render(self.world, self.camera, T_world_camera)
        self.detector.show(timestamp_s, View(index, self.world, self.camera, T_world_camera, rendered))
        depth_m = sense_depth(rendered.depth_m, self.sensor_knobs, self.seed, index)
        return Frame(timestamp_s, rendered.rgb, depth_m, self.camera, index)

    @cached_property
    def truth(self) -> dict[str, Any]:
        """What is on the desk, in the form of ``truth.json``: objects with both centres and boxes, and an empty timeline."""
        surfaces = surface_centres(self.world, self.camera, self.trajectory)
        objects = []
        for thing in self.world.things:
            low, high = thing.bounds_world
            objects.append(
                {
                    "id": thing.id,
                    "label": thing.label,
                    "accepted_labels": [thing.label, *thing.accepted_labels],
                    "center": _rounded(thing.p_world),
                    "surface_center": _rounded(surfaces.get(thing.id, thing.p_world)),
                    "aabb_min": _rounded(low),
                    "aabb_max": _rounded(high),
                }
            )
        return {"objects": objects, "timeline": []}

    def write(self, folder: str | Path) -> Path:
        """Write the recording into a new or empty folder, in TUM layout, and return the folder.

        Raises:
            DatasetError: the folder holds something already, or cannot be written.
        """
        from seo_slam.simulation.writing import write_recording

        return write_recording(self, Path(folder))


def phantom_spots(world: World, camera: Camera, trajectory: Trajectory, seed: int, count: int) -> tuple[PhantomSpot, ...]:
    """Choose places on walls, floor and furniture, in view from somewhere on the path, where a detector sees what is not there."""
    small = _scaled(camera, 80)
    spots: list[PhantomSpot] = []
    for k in range(count):
        draws = generator(seed, "phantom spot", k)
        T_world_camera = trajectory.T_world_camera[int(draws.integers(len(trajectory)))]
        view = render(world, small, T_world_camera, smooth_edges=False)
        free = np.argwhere((view.instance_ids == STRUCTURE_ID) & (view.depth_m > 0))
        if not len(free):
            continue
        row, column = free[int(draws.integers(len(free)))]
        p_camera = small.back_project([column, row], view.depth_m[row, column])
        spots.append(
            PhantomSpot(transform_points(T_world_camera, p_camera), float(draws.uniform(0.1, 0.3)), str(draws.choice(PHANTOM_LABELS)))
        )
    return tuple(spots)


def surface_centres(world: World, camera: Camera, trajectory: Trajectory) -> dict[int, FloatArray]:
    """Return thing id -> mean (3,) of its visible surface, world frame, over nine views spread along a path.

    A depth camera sees the near side of a thing, so that what it measures lies between this and the centre of the box. Things that
    none of these views shows are left out.
    """
    small = _scaled(camera, 160)
    points: dict[int, list[FloatArray]] = {}
    for index in np.unique(np.linspace(0, len(trajectory) - 1, _TRUTH_VIEWS).astype(np.int64)):
        T_world_camera = trajectory.T_world_camera[index]
        view = render(world, small, T_world_camera, smooth_edges=False)
        v, u = np.nonzero(view.instance_ids != STRUCTURE_ID)
        p_world = transform_points(T_world_camera, small.back_project(np.stack([u, v], axis=-1), view.depth_m[v, u]))
        for thing_id in np.unique(view.instance_ids[v, u]):
            points.setdefault(int(thing_id), []).append(p_world[view.instance_ids[v, u] == thing_id])
    return {thing_id: np.concatenate(clouds).mean(axis=0) for thing_id, clouds in sorted(points.items())}


def _scaled(camera: Camera, width: int) -> Camera:
    share = width / camera.width
    height = max(round(camera.height * share), 1)
    centre = (share * (camera.cx + 0.5) - 0.5, share * (camera.cy + 0.5) - 0.5)
    return Camera(share * camera.fx, share * camera.fy, *centre, width, height, camera.distortion)


def _rounded(values: FloatArray) -> list[float]:
    return [round(float(v), 6) for v in values]
