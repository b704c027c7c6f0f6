"""A simulated recording: frames, detector, odometry and truth of a scene along a camera path, all from one seed."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from seo_slam.camera import Camera
from seo_slam.errors import ConfigError
from seo_slam.records import Trajectory
from seo_slam.simulation.detector import DetectorKnobs, SimulatedDetector, View
from seo_slam.simulation.labels import LOOK_ALIKES
from seo_slam.simulation.phantoms import phantom_spots
from seo_slam.simulation.render_cache import RenderCache
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.rendering import RendererName, make_renderer
from seo_slam.simulation.scene import Scene
from seo_slam.simulation.sensors import SensorKnobs, drifting_odometry, require_level, sense_depth
from seo_slam.simulation.true_views import truth_of
from seo_slam.types import Frame

if TYPE_CHECKING:
    from seo_slam.simulation.mesh_library import MeshLibrary

_FOCAL_SHARE = 265.0 / 320.0  # of the width: about 62 degrees across, as a Kinect


def simulated_camera(width: int = 320, height: int = 240) -> Camera:
    """Return the simulated camera for an image size: no distortion, 62 degrees across.

    Raises:
        ConfigError: an image below 32 pixels.
    """
    if min(width, height) < 32:
        raise ConfigError(f"image size: got {width}x{height}, wanted at least 32 pixels each way")
    focal = _FOCAL_SHARE * width
    return Camera(focal, focal, (width - 1) / 2.0, (height - 1) / 2.0, width, height)


class Seer(Protocol):
    """Something that is told what is in each frame: a detector or a segmenter of one's own."""

    def show(self, timestamp_s: float, view: View) -> None:
        """Take what is in the frame of this stamp."""
        ...


class SimulatedRecording:
    """Frames of a scene. Iterate it for ``Frame``s, drawn as they are asked for; the same arguments give the same bytes."""

    def __init__(
        self,
        name: str,
        scene: Scene,
        trajectory: Trajectory,
        camera: Camera,
        *,
        seed: int = 0,
        level: float = 0.5,
        sensor_knobs: SensorKnobs | None = None,
        detector_knobs: DetectorKnobs | None = None,
        look_alikes: Mapping[str, tuple[str, ...]] = LOOK_ALIKES,
        renderer: RendererName = "auto",
        cache: str | Path | None = None,
        meshes: "MeshLibrary | None" = None,
    ) -> None:
        """Put a recording together; nothing is drawn yet.

        Args:
            name: what it is called.
            scene: what there is, and what changes.
            trajectory: true poses of the camera, one a frame.
            camera: what it is filmed with.
            seed: of all noise.
            level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
            sensor_knobs: instead of those of the level.
            detector_knobs: instead of those of the level.
            look_alikes: label -> labels that the detector takes it for.
            renderer: "embree", "primitive" or "auto".
            cache: a folder that keeps drawn frames, so that another level or knob need not draw them again.
            meshes: the models that its things are made of; ``simulation.json`` names their licences.

        Raises:
            ConfigError: a level below 0, or an unknown renderer.
            MissingBackendError: the renderer is not installed.
        """
        self.name = name
        self.scene = scene
        self.trajectory = trajectory
        self.camera = camera
        self.seed = seed
        self.level = require_level(level)
        self.sensor_knobs = sensor_knobs or SensorKnobs.at_level(level)
        self.detector_knobs = detector_knobs or DetectorKnobs.at_level(level)
        self.look_alikes = look_alikes
        self.renderer = make_renderer(renderer)
        self.meshes = meshes
        self._seers: list[Seer] = []
        self._cache = None if cache is None else RenderCache(Path(cache), self)
        self.odometry: Trajectory = drifting_odometry(trajectory, self.sensor_knobs, seed)
        """What a robot's wheels or its visual odometry would report: drifting."""

    @cached_property
    def detector(self) -> SimulatedDetector:
        """The imperfect detector. It knows a frame once that frame has been drawn by iterating."""
        spots = phantom_spots(self, self.detector_knobs.phantom_spots)
        return SimulatedDetector(self.detector_knobs, self.seed, spots, self.look_alikes)

    def __len__(self) -> int:
        return len(self.trajectory)

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self)):
            yield self.frame(index)

    def rendered(self, index: int) -> Rendered:
        """Draw what a perfect camera sees in a frame, or take it from the cache."""
        kept = self._cache.get(index) if self._cache else None
        if kept is not None:
            return kept
        world = self.scene.world_at(float(self.trajectory.timestamps_s[index]))
        drawn = self.renderer(world, self.camera, self.trajectory.T_world_camera[index])
        if self._cache:
            self._cache.put(index, drawn)
        return drawn

    def show_to(self, seer: Seer) -> None:
        """Tell one more detector what is in every frame that is drawn from now on."""
        self._seers.append(seer)

    def frame(self, index: int) -> Frame:
        """Draw one frame, and show it to the detector."""
        timestamp_s = float(self.trajectory.timestamps_s[index])
        rendered = self.rendered(index)
        view = View(index, self.scene.world_at(timestamp_s), self.camera, self.trajectory.T_world_camera[index], rendered)
        for seer in (self.detector, *self._seers):
            seer.show(timestamp_s, view)
        depth_m = sense_depth(rendered.depth_m, self.sensor_knobs, self.seed, index)
        return Frame(timestamp_s, rendered.rgb, depth_m, self.camera, index)

    @cached_property
    def truth(self) -> dict[str, Any]:
        """What there is at the end and what changed before, in the form of ``truth.json``."""
        return truth_of(self.scene, self.camera, self.trajectory, self.renderer)

    def write(self, folder: str | Path) -> Path:
        """Write the recording into a new or empty folder, in TUM layout, and return the folder.

        Raises:
            DatasetError: the folder holds something already, or cannot be written.
        """
        from seo_slam.simulation.writing import write_recording

        return write_recording(self, Path(folder))
