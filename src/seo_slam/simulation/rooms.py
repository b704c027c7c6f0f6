"""The six rooms of SEO-SLAM, Table I, as simulated recordings."""

from pathlib import Path

from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.inventories import ROOMS
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.rendering import RendererName
from seo_slam.simulation.room_path import change_stamp
from seo_slam.simulation.room_plan import plan_room
from seo_slam.simulation.room_structure import with_tables_as_things
from seo_slam.simulation.scene import Scene, SceneChange
from seo_slam.simulation.sensors import SensorKnobs
from seo_slam.simulation.simulated_recording import SimulatedRecording, simulated_camera

__all__ = ["ROOMS", "SimulatedRoom"]


class SimulatedRoom(SimulatedRecording):
    """A walk past the tables of a room and back. Halfway two things are taken away and three are moved."""

    def __init__(
        self,
        room: str = "SM1",
        seed: int = 0,
        level: float = 0.5,
        meshes: str | Path | None = None,
        frames: int = 200,
        width: int = 320,
        height: int = 240,
        *,
        changes: bool = True,
        tables_are_things: bool = False,
        sensor_knobs: SensorKnobs | None = None,
        detector_knobs: DetectorKnobs | None = None,
        renderer: RendererName = "auto",
        cache: str | Path | None = None,
    ) -> None:
        """Lay out the room and plan the walk; no frame is drawn yet.

        Args:
            room: one of ``ROOMS``.
            seed: of everything: models, places, walk, noise.
            level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
            meshes: a folder of GLB meshes with manifests; without it, things are made of coloured primitive shapes.
            frames: how many, evenly over a walk of 33 s: 200 are 6 a second.
            width: of the images, pixels.
            height: of the images, pixels.
            changes: whether anything changes halfway.
            tables_are_things: tables have ids, so that they can be detected, and are in the truth; else they are part of the room, as
                Table I does not count them.
            sensor_knobs: instead of those of the level.
            detector_knobs: instead of those of the level.
            renderer: "embree", "primitive" or "auto".
            cache: a folder that keeps drawn frames.

        Raises:
            ConfigError: no such room, fewer than two frames, an image below 32 pixels, a level below 0, or a thing that found no place;
                the message names it.
            DatasetError: no manifest in the folder of meshes, or a mesh that does not load.
            MissingBackendError: meshes or "embree", and the extra ``sim`` is not installed.
        """
        library = None if meshes is None else MeshLibrary(meshes)
        plan = plan_room(room, seed, library, changes)
        trajectory = plan.walk.trajectory(frames)
        stamp_s = change_stamp(trajectory.timestamps_s)
        start = with_tables_as_things(plan.start) if tables_are_things else plan.start
        super().__init__(
            f"{room} seed {seed}" + (" with tables" if tables_are_things else ""),
            Scene(start, [SceneChange(stamp_s, event, thing) for event, thing in plan.changes]),
            trajectory,
            simulated_camera(width, height),
            seed=seed,
            level=level,
            sensor_knobs=sensor_knobs,
            detector_knobs=detector_knobs,
            renderer=renderer,
            cache=cache,
            meshes=library,
        )
