"""What maps a simulated tour or drive: DualMap's pipeline, or the truth."""

from collections.abc import Callable
from typing import Protocol

from seo_slam.config import Config
from seo_slam.driving.robot import Filmed
from seo_slam.driving.true_mapper import TrueMapper
from seo_slam.errors import ConfigError
from seo_slam.interfaces import Embedder, Odometry
from seo_slam.map import Map
from seo_slam.perception.hybrid import HybridDetector
from seo_slam.pipeline import Pipeline
from seo_slam.records import StepResult
from seo_slam.simulation.image_encoder import SimulatedImageEncoder
from seo_slam.simulation.segments import SimulatedSegmenter
from seo_slam.types import Frame


class Mapper(Protocol):
    """Makes a concrete map of frames, such as ``Pipeline``."""

    def step(self, frame: Frame) -> StepResult:
        """Process one frame."""
        ...

    def snapshot(self) -> Map:
        """Return the map as it is now."""
        ...

    def close(self) -> None:
        """Release threads and files; nothing is stepped any more."""
        ...


MakeMapper = Callable[[Filmed, Odometry, Embedder], Mapper]
"""Makes a mapper of what is filmed: it takes the detector of it, and may show it to detectors of its own."""


def dualmap(config: Config | str = "dualmap") -> MakeMapper:
    """Return what makes DualMap's pipeline, with simulated detector, segmenter and image encoder (figures say "simulated encoder").

    Args:
        config: its settings, or the name of a preset.
    """
    settings = Config.preset(config) if isinstance(config, str) else config
    settings = settings.with_settings(["layout.enabled=false"])  # ``map_home`` and the navigator have layouts of their own

    def make(filmed: Filmed, odometry: Odometry, embedder: Embedder) -> Mapper:
        segmenter = SimulatedSegmenter(filmed.detector_knobs, filmed.seed)
        encoder = SimulatedImageEncoder(embedder, filmed.seed)
        for seer in (segmenter, encoder):
            filmed.show_to(seer)
        front_end = HybridDetector(filmed.detector, segmenter, image_encoder=encoder)
        return Pipeline(settings, detector=front_end, odometry=odometry, embedder=encoder)

    return make


MAPPERS: dict[str, Callable[[], MakeMapper]] = {"dualmap": dualmap, "true": lambda: TrueMapper}
"""By name: DualMap's pipeline, and the truth as far as it was in view."""


def mapper_named(name: str) -> MakeMapper:
    """Return what makes the mapper of a name.

    Raises:
        ConfigError: there is none.
    """
    if name not in MAPPERS:
        raise ConfigError(f"mapper: got {name!r}, wanted one of {', '.join(MAPPERS)}")
    return MAPPERS[name]()
