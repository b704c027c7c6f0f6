"""A seeded apartment as a recording."""

from collections.abc import Sequence
from pathlib import Path

from seo_slam.simulation.apartment_plan import plan_apartment
from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.rendering import RendererName
from seo_slam.simulation.scene import SceneChange
from seo_slam.simulation.sensors import SensorKnobs, require_level
from seo_slam.simulation.simulated_recording import simulated_camera


class SimulatedApartment(SimulatedHome):
    """A tour of 3 to 5 furnished rooms with 20 to 25 pieces of furniture and 14 to 20 small things on them."""

    def __init__(
        self,
        seed: int = 0,
        level: float = 0.5,
        meshes: str | Path | None = None,
        frames: int | None = None,
        width: int = 320,
        height: int = 240,
        *,
        changes: bool | Sequence[SceneChange] = True,
        sensor_knobs: SensorKnobs | None = None,
        detector_knobs: DetectorKnobs | None = None,
        renderer: RendererName = "auto",
        cache: str | Path | None = None,
    ) -> None:
        """Furnish the apartment and plan the tour; nothing is drawn yet.

        Args:
            seed: of everything: rooms, furniture, things, tour, noise.
            level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
            meshes: a folder of GLB meshes with manifests; without it, everything is made of coloured primitive shapes.
            frames: how many, evenly over the tour; None: six a second.
            width: of the images, pixels.
            height: of the images, pixels.
            changes: True: two things are taken away and three moved when all has been seen once, and the camera goes there again;
                False: none; or changes of your own, see ``relocated``. Those at 0 s are done before the first frame.
            sensor_knobs: instead of those of the level.
            detector_knobs: instead of those of the level.
            renderer: "embree", "primitive" or "auto".
            cache: a folder that keeps drawn frames.

        Raises:
            ConfigError: fewer than two frames, an image below 32 pixels, a level below 0, a label without a mesh, or something that found
                no place; the message names it.
            DatasetError: no manifest in the folder of meshes, or a mesh that does not load.
            MissingBackendError: meshes or "embree", and the extra ``sim`` is not installed.
        """
        require_level(level)  # these before an apartment is furnished
        simulated_camera(width, height)
        library = None if meshes is None else MeshLibrary(meshes)
        home = plan_apartment(seed, library)
        self.plan = home.plan
        super().__init__(
            f"apartment seed {seed}",
            home.world,
            home.free,
            changes=changes,
            frames=frames,
            width=width,
            height=height,
            seed=seed,
            level=level,
            sensor_knobs=sensor_knobs,
            detector_knobs=detector_knobs,
            renderer=renderer,
            cache=cache,
            meshes=library,
        )
