"""The worlds that have a name: the desk, the six rooms of SEO-SLAM's Table I, an apartment, and a furnished house."""

import difflib
from pathlib import Path
from typing import Any

from seo_slam.errors import ConfigError
from seo_slam.simulation.inventories import ROOMS
from seo_slam.simulation.rendering import require_embree
from seo_slam.simulation.sensors import require_level
from seo_slam.simulation.simulated_recording import SimulatedRecording, simulated_camera

NAMES = ("desk", *ROOMS, "apartment", "house")
"""What ``simulate`` knows."""


def simulate(
    name: str,
    *,
    seed: int = 0,
    level: float = 0.5,
    meshes: str | Path | None = None,
    frames: int | None = None,
    width: int = 320,
    height: int = 240,
    changes: bool = True,
) -> SimulatedRecording:
    """Return a recording of a world by its name; nothing is drawn yet.

    Args:
        name: one of ``NAMES``, in capitals or not.
        seed: of everything.
        level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
        meshes: a folder of GLB models with manifests; without it things are made of coloured primitives. The house needs it, the desk
            takes none.
        frames: how many; None: as many as suit the world.
        width: of the images, pixels.
        height: of the images, pixels.
        changes: whether things are taken away and moved while it is recorded (the desk never changes).

    Raises:
        ConfigError: an unknown name, a level below 0, too few frames or pixels, a thing that finds no place, the house without meshes.
        DatasetError: no manifest in the mesh folder, or a model that does not load.
        MissingBackendError: meshes without the extra ``sim``.
    """
    known = known_name(name)
    require_level(level)  # these before a room is furnished
    simulated_camera(width, height)
    options: dict[str, Any] = {"seed": seed, "level": level, "width": width, "height": height}
    if frames is not None:
        options["frames"] = frames
    if known == "desk":
        if meshes is not None:
            raise ConfigError("desk: got a mesh folder, but the desk is made of primitives; wanted none")
        from seo_slam.simulation.recording import SimulatedDesk

        return SimulatedDesk(**options)
    if meshes is not None:
        require_embree(f"{known} with meshes")
    return _furnished(known, {**options, "meshes": meshes, "changes": changes})


def known_name(name: str) -> str:
    """Return a name as ``NAMES`` spells it.

    Raises:
        ConfigError: there is no such world.
    """
    spelt = {known.casefold(): known for known in NAMES}
    if name.casefold() not in spelt:
        near = difflib.get_close_matches(name.casefold(), spelt, n=1)
        hint = f"; did you mean {spelt[near[0]]!r}?" if near else ""
        raise ConfigError(f"simulate: got {name!r}, wanted one of {', '.join(NAMES)}{hint}")
    return spelt[name.casefold()]


def _furnished(name: str, options: dict[str, Any]) -> SimulatedRecording:
    if name == "apartment":
        from seo_slam.simulation.apartment import SimulatedApartment

        return SimulatedApartment(**options)
    if name == "house":
        from seo_slam.simulation.house import SimulatedHouse

        return SimulatedHouse(**options)
    from seo_slam.simulation.rooms import SimulatedRoom

    return SimulatedRoom(name, **options)
