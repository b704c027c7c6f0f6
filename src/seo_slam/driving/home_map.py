"""The map of a simulated home, made on a tour through it before anything moves, and kept in a folder for many trials."""

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.abstraction.abstracting import abstract
from seo_slam.abstraction.rooms import with_rooms
from seo_slam.abstraction.scene_cloud import SceneCloud
from seo_slam.backends.recorded_odometry import RecordedOdometry
from seo_slam.driving.driven_odometry import DrivenOdometry
from seo_slam.driving.mappers import MakeMapper
from seo_slam.errors import ConfigError, MapError
from seo_slam.interfaces import Embedder
from seo_slam.map import MAP_FILE, Map
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.settings.planning import LayoutSettings
from seo_slam.simulation.home import SimulatedHome

OWN_FLOOR = 0.9
"""A map of a home has at least this share of its floor where the home has free floor."""


@dataclass(frozen=True, slots=True)
class MappingSettings:
    """How the map of a home is made of its tour.

    Attributes:
        abstraction, layout: of the abstract map.
        drifts: the tour's odometry drifts as the level says; else its poses are given, as DualMap assumes.
        every: only each nth frame of the tour is used.
    """

    abstraction: AbstractionSettings = field(default_factory=AbstractionSettings)
    layout: LayoutSettings = field(default_factory=LayoutSettings)
    drifts: bool = False
    every: int = 1


def map_home(
    home: SimulatedHome,
    make_mapper: MakeMapper,
    embedder: Embedder,
    settings: MappingSettings | None = None,
    folder: str | Path | None = None,
    progress: Callable[[range], Iterable[int]] = iter,
) -> Map:
    """Return the map of a home, with its abstract map.

    Its tour is run through a mapper, a scene cloud makes the layout, and the things become anchors and what is on them.

    Args:
        home: the tour; it should be one without changes.
        make_mapper: makes what maps.
        embedder: of all features.
        settings: how.
        folder: where the map is kept; a map that is there already is taken as it is.
        progress: is given the numbers of the frames and hands them on, one by one: for a bar.

    Raises:
        ConfigError: ``every`` is below 1.
        MapError: the folder cannot be written, or holds a damaged map.
    """
    settings = settings or MappingSettings()
    if settings.every < 1:
        raise ConfigError(f"map of a home: got every {settings.every}th frame, wanted 1 or more")
    if folder is not None and (Path(folder) / MAP_FILE).is_file():
        return Map.load(folder)
    odometry = RecordedOdometry(home.odometry) if settings.drifts else DrivenOdometry()
    cloud = SceneCloud(settings.layout)
    with closing(make_mapper(home, odometry, embedder)) as mapper:
        for index in progress(range(0, len(home), settings.every)):
            frame = home.frame(index)
            if isinstance(odometry, DrivenOdometry):
                odometry.moved_to(frame.timestamp_s, home.trajectory.T_world_camera[index])
            step = mapper.step(frame)
            cloud.add(frame.depth_m, frame.camera, step.T_world_camera)
        mapped = abstracted(mapper.snapshot(), cloud, embedder, settings)
    if folder is not None:
        mapped.save(folder)
    return mapped


def require_map_of(mapped: Map, home: SimulatedHome) -> None:
    """Refuse a map whose floor is not that of a home: a robot would be sent through walls.

    Of the floor of its own map 97 % and more is free in a home (apartments 10 and 11, by the pipeline and by the truth), of that of another
    apartment 67 to 84 %.

    Raises:
        MapError: less than ``OWN_FLOOR`` of the floor of the map is free floor of the home.
    """
    layout = None if mapped.abstract is None else mapped.abstract.layout
    if layout is None or not layout.floor.any():
        return
    free = home.free
    xy_world = layout.middles(np.argwhere(layout.floor))
    cells = np.floor((xy_world - free.corner_world) / free.cell_m).astype(np.int64)[:, ::-1]
    inside = ((cells >= 0) & (cells < free.occupied.shape)).all(axis=1)
    share = float(np.sum(~free.occupied[tuple(cells[inside].T)])) / len(cells)
    if share < OWN_FLOOR:
        raise MapError(
            f"map: {share:.0%} of its floor is free floor in {home.name}, wanted at least {OWN_FLOOR:.0%}; it is of another home, of one "
            "with other meshes, or in another frame"
        )


def abstracted(concrete: Map, cloud: SceneCloud, embedder: Embedder, settings: MappingSettings) -> Map:
    """Return a concrete map together with the abstract one that comes out of it and a scene cloud."""
    anchors = abstract(concrete.landmarks, embedder, settings.abstraction, tentative=concrete.tentative).anchors
    layout, rooms = with_rooms(cloud.layout(), anchors, embedder, settings.layout)
    return concrete.with_abstract(AbstractMap(anchors, layout, rooms, embedder.name, concrete.features))
