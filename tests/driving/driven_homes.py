"""What the tests of driving share."""

from functools import cache

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.driving.home_map import MappingSettings, map_home
from seo_slam.driving.true_mapper import TrueMapper
from seo_slam.simulation.apartment import SimulatedApartment

EVERY = 4


@cache
def apartment(seed: int = 10, level: float = 0.0) -> SimulatedApartment:
    """A small-imaged apartment of primitives, in which nothing changes during the tour; planned once a run."""
    return SimulatedApartment(seed, level, width=96, height=72, changes=False)


@cache
def mapped():
    """The map of it by the mapper that is told the truth, every fourth frame of the tour; made once a run."""
    return map_home(apartment(), TrueMapper, HashedEmbedder(), MappingSettings(every=EVERY))
