"""Which landmarks are unambiguously one: detectors fire twice on a thing now and then, and a first view may be a poor one."""

import numpy as np
from scipy.spatial import cKDTree

from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.thing import Thing
from seo_slam.perception.boxes import containment
from seo_slam.types import BoolArray, IntArray

_CORNERS = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])

LARGEST_SIZE_RATIO = 3.0
"""Two views of one thing may differ this much in extent (one was cut or half hidden)."""

SLACK_M = 0.03
"""Error of a centre that is granted beside the extent: thin things lie a little higher or lower from every side."""

LEAST_BOX_OVERLAP = 0.5
"""Share of the smaller of the two projected boxes that must lie in the other."""


def duplicate_pairs(
    object_map: ObjectMap,
    ids: IntArray,
    p_world: FloatArray,
    seen_now: IntArray,
    likelihood: LabelLikelihood,
    T_world_camera: FloatArray,
    camera: Camera,
) -> list[tuple[int, int]]:
    """Return pairs ``(keep_id, drop_id)``, no id twice, that are one thing beyond doubt.

    Both are each other's nearest, one lies within the extent of the other, labels and sizes are compatible, their boxes overlap
    in the image, and they were not detected apart in several keyframes. The one seen more often (the older on a tie) is kept.

    Args:
        object_map: what is known of them.
        ids: (N,) of all landmarks.
        p_world: (N, 3) their positions.
        seen_now: ids seen in this keyframe; only pairs with one of them are looked at.
        likelihood: compares labels.
        T_world_camera: (4, 4) pose of the image.
        camera: of the image.
    """
    pairs = []
    for a, b in _mutual_nearest(p_world, np.isin(ids, seen_now)):
        first, second = object_map[int(ids[a])], object_map[int(ids[b])]
        if (
            object_map.times_apart(first.id, second.id) < object_map.settings.separate_frames
            and one_within_other(first, second, p_world[a] - p_world[b])
            and _compatible_size(first, second)
            and likelihood.between(first.distribution(), second.distribution()) >= 0.0
            and _overlap_in_image((first, p_world[a]), (second, p_world[b]), T_world_camera, camera)
        ):
            keep, drop = sorted((first, second), key=lambda one: (-one.observations, one.id))
            pairs.append((keep.id, drop.id))
    return pairs


def _mutual_nearest(p_world: FloatArray, wanted: BoolArray) -> list[tuple[int, int]]:
    """Rows of points that are each other's nearest, one of them wanted (N,)."""
    if len(p_world) < 2:
        return []
    tree = cKDTree(p_world)
    nearest = {int(a): _other(tree, p_world, int(a)) for a in np.flatnonzero(wanted)}
    mutual = {(min(a, b), max(a, b)) for a, b in nearest.items() if (nearest[b] if b in nearest else _other(tree, p_world, b)) == a}
    return sorted(mutual)


def _other(tree: cKDTree, p_world: FloatArray, row: int) -> int:
    """Row of the point nearest to one, other than itself."""
    first, second = np.asarray(tree.query(p_world[row], k=2)[1]).tolist()
    return int(second if first == row else first)


def one_within_other(a: Thing, b: Thing, apart_m: FloatArray) -> bool:
    """Whether the centre of one lies in the extent of the other, along every axis of the world; ``apart_m`` (3,) is between them."""
    half = 0.5 * np.maximum(a.size_m(), b.size_m()) + SLACK_M
    return bool((np.abs(apart_m) <= half).all())


def _compatible_size(a: Thing, b: Thing) -> bool:
    larger, smaller = sorted((float(a.size_m().max()), float(b.size_m().max())), reverse=True)
    return larger <= LARGEST_SIZE_RATIO * max(smaller, 1e-3)


def _overlap_in_image(a: tuple[Thing, FloatArray], b: tuple[Thing, FloatArray], T_world_camera: FloatArray, camera: Camera) -> bool:
    boxes = [projected_box(p_world, thing.size_m(), T_world_camera, camera) for thing, p_world in (a, b)]
    if boxes[0] is None or boxes[1] is None:
        return False
    return bool(containment(boxes[0][None], boxes[1][None])[0, 0] >= LEAST_BOX_OVERLAP)


def projected_box(p_world: FloatArray, size_m: FloatArray, T_world_camera: FloatArray, camera: Camera) -> FloatArray | None:
    """Return (4,) the box around the projected corners of an extent (3,) at a point (3,), None if not wholly before the camera."""
    corners = transform_points(inverse(T_world_camera), p_world + _CORNERS * np.maximum(size_m, 0.01))
    if (corners[:, 2] < 0.05).any():
        return None
    uv = camera.project(corners)
    return np.concatenate([uv.min(axis=0), uv.max(axis=0)])
