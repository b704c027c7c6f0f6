"""A recording of a tour through a home."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.free_space import FreeSpace
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.relocation import relocated, removed
from seo_slam.simulation.rendering import RendererName
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.scene import Scene, SceneChange
from seo_slam.simulation.sensors import SensorKnobs
from seo_slam.simulation.simulated_recording import SimulatedRecording, simulated_camera
from seo_slam.simulation.tour import Tour, plan_tour
from seo_slam.simulation.tour_stops import Stop, stops_for
from seo_slam.simulation.world import World

REMOVED, MOVED = 2, 3
"""How many small things are taken away and moved unless told otherwise."""


class SimulatedHome(SimulatedRecording):
    """A tour past all furniture of a home, and once more past what has changed meanwhile.

    Attributes:
        world: the home at the first frame.
        free: its free floor.
        tour: the camera's walk.
    """

    world: World
    free: FreeSpace
    tour: Tour

    def __init__(
        self,
        name: str,
        world: World,
        free: FreeSpace,
        *,
        changes: bool | Sequence[SceneChange] = True,
        frames: int | None = None,
        width: int = 320,
        height: int = 240,
        seed: int = 0,
        level: float = 0.5,
        sensor_knobs: SensorKnobs | None = None,
        detector_knobs: DetectorKnobs | None = None,
        renderer: RendererName = "auto",
        cache: str | Path | None = None,
        meshes: MeshLibrary | None = None,
    ) -> None:
        """Plan the tour; nothing is drawn yet.

        Args:
            name: what it is called.
            world: the home.
            free: its free floor.
            changes: True: two small things are taken away and three moved, two of those onto other furniture, when everything has been
                seen once. False: nothing. Or changes of your own; those at 0 s are done before the first frame.
            frames: how many, evenly over the tour; None: six a second.
            width: of the images, pixels.
            height: of the images, pixels.
            seed: of the changes, the tour's sway and all noise.
            level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
            sensor_knobs: instead of those of the level.
            detector_knobs: instead of those of the level.
            renderer: "embree", "primitive" or "auto".
            cache: a folder that keeps drawn frames.
            meshes: the models that its things are made of.

        Raises:
            ConfigError: fewer than two frames, an image below 32 pixels, a level below 0, changes that do not fit the world, or no way
                through the home.
            MissingBackendError: the renderer is not installed.
        """
        given = [] if isinstance(changes, bool) else list(changes)
        self.world = Scene(world, given).world_at(0.0)
        self.free = free
        first = stops_for(self.world, free, self.world.things)
        if changes is True:
            stamp_s = plan_tour(free, [first], seed).legs_end_s[0]
            given = _default_changes(self.world, free, seed, round(stamp_s, 3))
        scene = Scene(world, given)
        self.tour = plan_tour(free, [first, _stops_for_changes(scene, free)], seed)
        super().__init__(
            name,
            scene,
            self.tour.trajectory(frames),
            simulated_camera(width, height),
            seed=seed,
            level=level,
            sensor_knobs=sensor_knobs,
            detector_knobs=detector_knobs,
            renderer=renderer,
            cache=cache,
            meshes=meshes,
        )

    @cached_property
    def truth(self) -> dict[str, Any]:
        """As of every recording; objects also have their ``kind``, and ``anchor``: the id of the furniture they stand on, or None."""
        truth = super().truth
        anchors = anchors_of(self.scene.end)
        for row in truth["objects"]:
            row["kind"] = self.scene.end.thing(row["id"]).kind
            row["anchor"] = anchors.get(row["id"])
        return truth


def _default_changes(world: World, free: FreeSpace, seed: int, timestamp_s: float) -> list[SceneChange]:
    """Two taken away, one moved on its furniture, two onto other furniture: all different things, and none that there are two of."""
    labels = Counter(thing.label for thing in world.things)
    copies = {thing.id for thing in world.things if labels[thing.label] > 1}
    gone = removed(world, REMOVED, seed, timestamp_s, copies)
    left = replace(world, things=tuple(thing for thing in world.things if all(thing is not change.thing for change in gone)))
    across = relocated(left, "cross_anchor", MOVED - 1, seed, timestamp_s, free, copies)
    fixed = copies | {change.thing.id for change in across}
    after = Scene(left, across).end
    still = relocated(after, "in_anchor", 1, seed, timestamp_s, free, fixed)
    return [*gone, *across, *still]


def _stops_for_changes(scene: Scene, free: FreeSpace) -> list[Stop]:
    """Stops at what changes during the tour: where it was and where it is then."""
    later = [change for change in scene.changes if change.timestamp_s > 0.0]
    before = scene.world_at(0.0)
    was = [before.thing(change.thing.id) for change in later if change.event != "added"]
    now = [change.thing for change in later if change.event != "removed"]
    return [*stops_for(before, free, was), *stops_for(scene.end, free, now)] if later else []
