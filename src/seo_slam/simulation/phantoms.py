"""Places where the simulated detector sees what is not there."""

from typing import Protocol

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import transform_points
from seo_slam.records import Trajectory
from seo_slam.simulation.detector import PhantomSpot
from seo_slam.simulation.draws import generator
from seo_slam.simulation.labels import PHANTOM_LABELS
from seo_slam.simulation.rendering import Renderer
from seo_slam.simulation.scene import Scene
from seo_slam.simulation.true_views import scaled
from seo_slam.simulation.world import STRUCTURE_ID


class Filmed(Protocol):
    """A scene, and the path along which it is filmed."""

    seed: int
    scene: Scene
    camera: Camera
    trajectory: Trajectory
    renderer: Renderer


def phantom_spots(filmed: Filmed, count: int) -> tuple[PhantomSpot, ...]:
    """Choose places on walls, floor and furniture, in view from somewhere on the path."""
    small = scaled(filmed.camera, 80)
    spots: list[PhantomSpot] = []
    for k in range(count):
        draws = generator(filmed.seed, "phantom spot", k)
        T_world_camera = filmed.trajectory.T_world_camera[int(draws.integers(len(filmed.trajectory)))]
        view = filmed.renderer(filmed.scene.start, small, T_world_camera, smooth_edges=False)
        free = np.argwhere((view.instance_ids == STRUCTURE_ID) & (view.depth_m > 0))
        if not len(free):
            continue
        row, column = free[int(draws.integers(len(free)))]
        p_camera = small.back_project([column, row], view.depth_m[row, column])
        spots.append(
            PhantomSpot(transform_points(T_world_camera, p_camera), float(draws.uniform(0.1, 0.3)), str(draws.choice(PHANTOM_LABELS)))
        )
    return tuple(spots)
