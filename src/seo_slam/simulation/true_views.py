"""What is true of a scene at the end of a recording: places, visible surfaces, and how often each thing was in view."""

from typing import Any

import numpy as np

from seo_slam.camera import Camera
from seo_slam.config import KeyframeSettings
from seo_slam.geometry import inverse, transform_points
from seo_slam.mapping.keyframes import is_keyframe
from seo_slam.records import Trajectory
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.rendering import Renderer
from seo_slam.simulation.scene import Scene, rounded
from seo_slam.simulation.world import STRUCTURE_ID

_WIDTH_PX = 160  # of the images that tell what was in view


def truth_of(scene: Scene, camera: Camera, trajectory: Trajectory, renderer: Renderer) -> dict[str, Any]:
    """Return the content of ``truth.json``.

    ``surface_center`` is the mean of the visible surface over all keyframes: a depth camera sees the near side of a thing, so that what
    it measures lies between this and the centre of the box. ``visible_keyframes`` counts the keyframes that saw the thing where it is
    at the end, by enough pixels for a detector. Keyframes are those of the default settings along the true path.
    """
    small = scaled(camera, _WIDTH_PX)
    enough_px = DetectorKnobs().smallest_px * small.width * small.height / (640 * 480)
    since = {thing.id: scene.last_change_s(thing.id) for thing in scene.end.things}
    sums = {thing_id: np.zeros(4) for thing_id in since}  # of x, y, z and of how many points
    seen = dict.fromkeys(since, 0)
    for index in keyframe_indices(trajectory):
        T_world_camera = trajectory.T_world_camera[index]
        timestamp_s = float(trajectory.timestamps_s[index])
        view = renderer(scene.world_at(timestamp_s), small, T_world_camera, smooth_edges=False)
        v, u = np.nonzero(view.instance_ids != STRUCTURE_ID)
        p_world = transform_points(T_world_camera, small.back_project(np.stack([u, v], axis=-1), view.depth_m[v, u]))
        for thing_id in (int(i) for i in np.unique(view.instance_ids[v, u])):
            if thing_id in since and timestamp_s >= since[thing_id]:
                own = view.instance_ids[v, u] == thing_id
                sums[thing_id] += [*p_world[own].sum(axis=0), own.sum()]
                seen[thing_id] += int(own.sum() >= enough_px)
    objects = []
    for thing in scene.end.things:
        low, high = thing.bounds_world
        total = sums[thing.id]
        surface = total[:3] / total[3] if total[3] else thing.p_world
        objects.append(
            {
                "id": thing.id,
                "label": thing.label,
                "accepted_labels": [thing.label, *thing.accepted_labels],
                "center": rounded(thing.p_world),
                "surface_center": rounded(surface),
                "aabb_min": rounded(low),
                "aabb_max": rounded(high),
                "visible_keyframes": seen[thing.id],
            }
        )
    return {"objects": objects, "timeline": scene.timeline()}


def keyframe_indices(trajectory: Trajectory, settings: KeyframeSettings | None = None) -> list[int]:
    """Return which frames of a path are keyframes."""
    chosen = [0]
    for index in range(1, len(trajectory)):
        last = chosen[-1]
        T = inverse(trajectory.T_world_camera[last]) @ trajectory.T_world_camera[index]
        elapsed_s = float(trajectory.timestamps_s[index] - trajectory.timestamps_s[last])
        if is_keyframe(T, elapsed_s, settings or KeyframeSettings()):
            chosen.append(index)
    return chosen


def scaled(camera: Camera, width: int) -> Camera:
    """Return the same camera with smaller images."""
    share = width / camera.width
    height = max(round(camera.height * share), 1)
    centre = (share * (camera.cx + 0.5) - 0.5, share * (camera.cy + 0.5) - 0.5)
    return Camera(share * camera.fx, share * camera.fy, *centre, width, height, camera.distortion)
