"""The simulated desk as a recording."""

from seo_slam.simulation.desk import build_desk
from seo_slam.simulation.labels import DESK_LOOK_ALIKES
from seo_slam.simulation.scene import Scene
from seo_slam.simulation.simulated_recording import SimulatedRecording, simulated_camera
from seo_slam.simulation.trajectory import swaying_arc

RATE_HZ = 15.0


class SimulatedDesk(SimulatedRecording):
    """A camera that walks past a desk with fifteen things on it; drawn without any extra."""

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
        self.world = build_desk(seed)
        super().__init__(
            f"simulated desk {seed}",
            Scene(self.world),
            swaying_arc(self.world.gaze_world, frames, seed, RATE_HZ),
            simulated_camera(width, height),
            seed=seed,
            level=level,
            look_alikes=DESK_LOOK_ALIKES,
            renderer="primitive",
        )
