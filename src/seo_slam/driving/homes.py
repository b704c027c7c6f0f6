"""Homes by name, as the command line and the benchmarks call them."""

import re
from pathlib import Path

from seo_slam.errors import ConfigError
from seo_slam.simulation.apartment import SimulatedApartment
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.house import SimulatedHouse

_NAME = re.compile(r"(house|apartment)(?::(\d{1,6}))?", re.IGNORECASE)


def parsed_home(name: str) -> tuple[str, int]:
    """Return kind and seed of "house", "apartment", "apartment:3" or "house:1"; the seed of a bare kind is 0.

    Raises:
        ConfigError: another name.
    """
    found = _NAME.fullmatch(name.strip())
    if found is None:
        raise ConfigError(f"home: got {name!r}, wanted house, or apartment:SEED such as apartment:3")
    return found.group(1).casefold(), int(found.group(2) or 0)


def home_named(
    name: str, level: float = 0.5, meshes: str | Path | None = None, size_px: tuple[int, int] = (320, 240), cache: str | Path | None = None
) -> SimulatedHome:
    """Return a home in which nothing changes during the tour.

    Args:
        name: see ``parsed_home``.
        level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
        meshes: folder of models; the house needs it.
        size_px: width and height of the images.
        cache: a folder that keeps drawn frames of the tour.

    Raises:
        ConfigError: another name, a level below 0, an image below 32 pixels, or the house without meshes.
        DatasetError: no meshes there, or a model that does not load.
        MissingBackendError: meshes, and the extra ``sim`` is not installed.
    """
    kind, seed = parsed_home(name)
    width, height = size_px
    make = SimulatedHouse if kind == "house" else SimulatedApartment
    return make(seed, level, meshes, width=width, height=height, changes=False, cache=cache)
