"""What the tests of simulated homes share."""

from functools import cache

from seo_slam.simulation.apartment_plan import Home, plan_apartment


@cache
def apartment(seed: int) -> Home:
    """The apartment of primitives of a seed, planned once a run."""
    return plan_apartment(seed)
