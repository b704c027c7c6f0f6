"""Walls, floor and ceiling told from things by their shape; boxes to masks by depth."""

import numpy as np

from seo_slam.camera import Camera
from seo_slam.perception.box_masks import DepthMasker, Masker
from seo_slam.perception.structure import is_structure
from seo_slam.settings.hybrid import StructureSettings
from seo_slam.types import Frame

CAMERA = Camera(265.0, 265.0, 159.5, 119.5, 320, 240)
RAYS = CAMERA.rays()


def plane_depth(normal, offset_m):
    """(H, W) depth of the plane ``normal @ p + offset_m = 0``; infinite where no ray meets it."""
    slope = RAYS @ np.array(normal[:2]) + normal[2]
    z = -offset_m / np.where(np.abs(slope) > 1e-9, slope, 1e-9)
    return np.where(z > 0, z, np.inf)


def frame(depth_m):
    seen = np.where(np.isfinite(depth_m) & (depth_m < 9.0), depth_m, 0.0).astype(np.float32)
    return Frame(0.0, np.zeros((240, 320, 3), dtype=np.uint8), seen, CAMERA)


def room(*things):
    """Floor 1 m below the camera, a wall 4 m ahead, and things (depth images) in front; the masks of all, and the frame."""
    layers = np.array([plane_depth((0.0, -1.0, 0.0), 1.0), plane_depth((0.0, 0.0, -1.0), 4.0), *things])
    nearest = np.argmin(layers, axis=0)
    depth_m = layers.min(axis=0)
    noise = np.random.default_rng(0).normal(size=depth_m.shape)
    return np.array([nearest == i for i in range(len(layers))]), frame(depth_m + 0.0019 * noise * np.minimum(depth_m, 9.0) ** 2)


def box(x0, x1, y0, y1, z0, z1):
    """(H, W) depth of an axis-aligned box in the camera frame."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.stack(
            [np.array([x0, x1]) / RAYS[..., :1], np.array([y0, y1]) / RAYS[..., 1:], np.broadcast_to([z0, z1], (*RAYS.shape[:2], 2))]
        )
    near, far = t.min(axis=-1).max(axis=0), t.max(axis=-1).min(axis=0)
    return np.where(near < far, near, np.inf)


def test_floor_and_wall_are_structure_and_things_are_not():
    cupboard, table_top = box(-1.2, -0.5, -0.2, 1.0, 2.4, 2.8), box(0.2, 1.4, 0.25, 0.3, 1.8, 2.6)
    masks, seen = room(cupboard, table_top)
    assert all(mask.sum() > 300 for mask in masks)
    assert is_structure(masks, seen, StructureSettings()).tolist() == [True, True, False, False]


def test_a_front_before_a_wall_is_no_structure_though_it_is_flat():
    masks, seen = room(box(-0.6, 0.6, -0.7, 1.0, 3.0, 3.4))
    assert is_structure(masks, seen, StructureSettings()).tolist() == [True, True, False]


def test_pieces_of_a_wall_are_told_together_although_a_door_shows_what_is_behind():
    wall = plane_depth((0.0, 0.0, -1.0), 3.0)
    door = (RAYS[..., 0] > -0.15) & (RAYS[..., 0] < 0.15)
    masks, seen = room(np.where(door, np.inf, wall))
    left, right = masks[2] & (RAYS[..., 0] < 0), masks[2] & (RAYS[..., 0] > 0)
    narrow = right & (RAYS[..., 1] > -0.1) & (RAYS[..., 1] < 0.0)
    found = is_structure(np.array([left, right & ~narrow, narrow]), seen, StructureSettings(large_m=1.5, cut_m=9.0))
    assert found.tolist() == [True, True, True]


def test_a_curved_thing_is_no_structure_however_large():
    ball = np.where(np.linalg.norm(RAYS, axis=2) < 0.4, 2.0 - np.sqrt(np.clip(0.8 - (RAYS**2).sum(axis=2) * 4, 0, None)), np.inf)
    masks, seen = room(ball)
    assert is_structure(masks, seen, StructureSettings()).tolist() == [True, True, False]


def test_without_depth_or_masks_nothing_is_structure():
    masks, _ = room()
    assert not is_structure(masks, frame(np.zeros((240, 320))), StructureSettings()).any()
    assert is_structure(masks[:0], frame(np.ones((240, 320))), StructureSettings()).shape == (0,)


def test_the_thing_in_a_box_is_what_is_at_the_distance_of_its_middle():
    cupboard = box(-0.5, 0.5, -0.5, 0.5, 2.4, 2.8)
    masks, seen = room(cupboard)
    v, u = np.nonzero(masks[2])
    tight = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1], dtype=np.float64)
    loose = tight + np.array([-20, -20, 20, 20])
    found = DepthMasker().masks(seen, np.array([tight, loose]))
    assert isinstance(DepthMasker(), Masker)
    for mask in found:
        assert (mask & masks[2]).sum() / (mask | masks[2]).sum() > 0.95


def test_of_two_pieces_at_one_distance_the_one_in_the_middle_is_the_thing():
    masks, seen = room(box(-0.3, 0.3, -0.3, 0.3, 2.0, 2.1), box(0.5, 0.8, -0.3, 0.3, 2.0, 2.1))
    v, u = np.nonzero(masks[2] | masks[3])
    around = np.array([[u.min() - 40.0, v.min() - 10.0, u.max() + 1.0, v.max() + 10.0]])
    (mask,) = DepthMasker().masks(seen, around)
    assert (mask & masks[2]).sum() > 0.95 * masks[2].sum()
    assert not (mask & masks[3]).any()


def test_a_box_without_depth_is_taken_whole():
    (mask,) = DepthMasker().masks(frame(np.zeros((240, 320))), np.array([[10.2, 20.0, 49.5, 60.0]]))
    assert mask.sum() == 40 * 40
    assert mask[20:60, 10:50].all()
