"""What the tests of driving share."""

from functools import cache

from seo_slam.simulation.apartment import SimulatedApartment


@cache
def apartment(seed: int = 10, level: float = 0.0) -> SimulatedApartment:
    """A small-imaged apartment of primitives, in which nothing changes during the tour; planned once a run."""
    return SimulatedApartment(seed, level, width=96, height=72, changes=False)
