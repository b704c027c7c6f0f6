"""Which landmarks are unambiguously one: detectors fire twice on a thing now and then, and a first view may be a poor one."""

import numpy as np

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.perception.boxes import containment
from seo_slam.types import IntArray, Landmark

LARGEST_SIZE_RATIO = 3.0
"""Two views of one thing may differ this much in extent (one was cut or half hidden)."""

LEAST_BOX_OVERLAP = 0.5
"""Share of the smaller of the two projected boxes that must lie in the other."""


def duplicate_pairs(
    landmarks: list[Landmark],
    seen_now: IntArray,
    object_map: ObjectMap,
    likelihood: LabelLikelihood,
    T_world_camera: FloatArray,
    camera: Camera,
) -> list[tuple[int, int]]:
    """Return pairs ``(keep_id, drop_id)``, no id twice, that are one thing beyond doubt.

    Both are each other's nearest, one lies within the extent of the other, labels and sizes are compatible, their boxes overlap
    in the image, and they were not detected apart in several keyframes. Only landmarks near one of ``seen_now`` are looked at. The one
    seen more often (the older on a tie) is kept.
    """
    if len(landmarks) < 2:
        return []
    p_world = np.array([one.position_m for one in landmarks])
    distance = np.linalg.norm(p_world[:, None] - p_world[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    nearest = distance.argmin(axis=1)
    fresh = {int(i) for i in seen_now}
    pairs = []
    for a, b in enumerate(int(i) for i in nearest):
        first, second = landmarks[a], landmarks[b]
        if b <= a or nearest[b] != a or not {first.id, second.id} & fresh:
            continue
        if (
            object_map.times_apart(first.id, second.id) < object_map.settings.separate_frames
            and _one_within_other(first, second, float(distance[a, b]))
            and _compatible_size(first, second)
            and likelihood.between(first.labels, second.labels) >= 0.0
            and _overlap_in_image(first, second, T_world_camera, camera)
        ):
            keep, drop = sorted((first, second), key=lambda one: (-one.observations, one.id))
            pairs.append((keep.id, drop.id))
    return pairs


def _one_within_other(a: Landmark, b: Landmark, distance_m: float) -> bool:
    return distance_m <= 0.5 * float(np.median(np.maximum(a.size_m, b.size_m)))


def _compatible_size(a: Landmark, b: Landmark) -> bool:
    larger, smaller = sorted((float(a.size_m.max()), float(b.size_m.max())), reverse=True)
    return larger <= LARGEST_SIZE_RATIO * max(smaller, 1e-3)


def _overlap_in_image(a: Landmark, b: Landmark, T_world_camera: FloatArray, camera: Camera) -> bool:
    boxes = [projected_box(one, T_world_camera, camera) for one in (a, b)]
    if boxes[0] is None or boxes[1] is None:
        return False
    return bool(containment(boxes[0][None], boxes[1][None])[0, 0] >= LEAST_BOX_OVERLAP)


def projected_box(landmark: Landmark, T_world_camera: FloatArray, camera: Camera) -> FloatArray | None:
    """Return (4,) the box around the projected corners of a landmark's extent, or None if it is not wholly before the camera."""
    half = 0.5 * np.maximum(landmark.size_m, 0.01)
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = transform_points(inverse(T_world_camera), landmark.position_m + signs * half)
    if (corners[:, 2] < 0.05).any():
        return None
    uv = camera.project(corners)
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])
