"""How well the things of a room are seen along a path."""

from collections.abc import Callable, Iterable

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.renderer import Rendered, render_instances
from seo_slam.simulation.rendering import require_embree
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.world import World

GOOD_SHARE = 0.25
"""A thing must be well seen in this share of the sampled views before and after the change: more than the promised 0.15 of the frames."""

_SIZE_PX = (160, 120)
_PIXELS = 3.0  # times the fewest that the detector needs
_UNHIDDEN = 0.5

InstanceRenderer = Callable[[World, Camera, FloatArray], Rendered]


def instance_renderer(meshes: bool) -> InstanceRenderer:
    """Return what draws instances for layouts. It depends on the world alone and not on what is installed: so do layouts.

    Raises:
        MissingBackendError: meshes, and the extra ``sim`` is not installed.
    """
    if not meshes:
        return render_instances
    require_embree("a room of meshes")
    from seo_slam.simulation.embree import EmbreeRenderer

    embree = EmbreeRenderer(shadows=False)
    return lambda world, camera, T_world_camera: embree(world, camera, T_world_camera, smooth_edges=False)


def well_seen(world: World, views: Iterable[FloatArray], draw: InstanceRenderer) -> dict[int, float]:
    """Return thing id -> share of the views (4, 4) in which it is well seen: large enough, and at least half of it unhidden."""
    camera = simulated_camera(*_SIZE_PX)
    enough_px = _PIXELS * DetectorKnobs().smallest_px * camera.width * camera.height / (640 * 480)
    good: dict[int, list[bool]] = {thing.id: [] for thing in world.things}
    for T_world_camera in views:
        drawn = draw(world, camera, T_world_camera)
        counts = np.bincount(drawn.instance_ids.ravel(), minlength=max(good) + 1)
        for thing_id, marks in good.items():
            count = int(counts[thing_id])
            marks.append(count >= enough_px and count >= _UNHIDDEN * drawn.covered_px.get(thing_id, count))
    return {thing_id: float(np.mean(marks)) for thing_id, marks in good.items()}
