"""Masks and depth to clouds: every pixel has one owner, every cloud is clean, the same input gives the same bytes."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.perception.mask_clouds import NO_MASK, box_masks, label_image, mask_clouds
from seo_slam.settings.observing import CloudSettings

CAMERA = Camera(fx=260.0, fy=260.0, cx=79.5, cy=59.5, width=160, height=120)
SETTINGS = CloudSettings(enabled=True)


def scene():
    """A box 0.3 m wide, 1 m away, before a wall 2.5 m away; the depth, and the exact mask of the box."""
    depth_m = np.full((120, 160), 2.5, dtype=np.float32)
    mask = np.zeros((120, 160), dtype=bool)
    mask[30:100, 40:118] = True
    depth_m[mask] = 1.0
    return depth_m, mask


def test_a_cloud_is_the_surface_of_its_mask_one_point_a_voxel():
    depth_m, mask = scene()
    (cloud,) = mask_clouds(mask[None], depth_m, CAMERA, SETTINGS, 6.0)
    v, u = np.nonzero(mask)
    exact = CAMERA.back_project(np.column_stack([u, v]), depth_m[mask])
    assert np.abs(cloud[:, 2] - 1.0).max() < 1e-12
    cells = np.floor(exact / SETTINGS.voxel_m).astype(int)
    assert len(cloud) == len(np.unique(cells, axis=0))
    wanted = [exact[(cells == cell).all(axis=1)].mean(axis=0) for cell in np.unique(cells, axis=0)]
    np.testing.assert_allclose(cloud, wanted, atol=1e-12)


def test_the_background_at_a_frayed_edge_is_dropped():
    depth_m, mask = scene()
    frayed = mask.copy()
    frayed[25:105, 118:124] = True
    (clean,), (cloud,) = (mask_clouds(m[None], depth_m, CAMERA, SETTINGS, 6.0) for m in (mask, frayed))
    assert np.array_equal(cloud, clean)
    (raw,) = mask_clouds(frayed[None], depth_m, CAMERA, replace_settings(cluster_m=3.0), 6.0)
    assert raw[:, 2].max() > 2.0  # it was in the mask


def replace_settings(**changes):
    return CloudSettings(**{**SETTINGS.model_dump(), **changes})


def test_of_two_masks_the_smaller_has_the_pixel():
    table, cup = np.zeros((120, 160), dtype=bool), np.zeros((120, 160), dtype=bool)
    table[20:110, 20:150] = True
    cup[50:70, 60:80] = True
    labels = label_image(np.array([table, cup]))
    assert np.array_equal(labels == 1, cup)
    assert np.array_equal(labels == 0, table & ~cup)
    assert np.array_equal(labels == NO_MASK, ~table)
    assert np.array_equal(label_image(np.array([cup, table])) == 0, cup)
    assert (label_image(np.array([cup, cup]))[cup] == 0).all()  # of one size: the first


def test_a_label_image_gives_what_its_masks_give():
    rng = np.random.default_rng(0)
    depth_m = rng.uniform(1.0, 1.1, (120, 160)).astype(np.float32)
    labels = np.repeat(np.repeat(rng.integers(-1, 5, (6, 8)), 20, axis=0), 20, axis=1)
    masks = labels[None] == np.arange(5)[:, None, None]
    from_labels = mask_clouds(labels, depth_m, CAMERA, SETTINGS, 6.0, count=5)
    from_masks = mask_clouds(masks, depth_m, CAMERA, SETTINGS, 6.0)
    alone = [mask_clouds(mask[None], depth_m, CAMERA, SETTINGS, 6.0)[0] for mask in masks]
    for a, b, c in zip(from_labels, from_masks, alone, strict=True):
        assert a.tobytes() == b.tobytes() == c.tobytes()


def test_depth_that_is_missing_or_far_is_left_out():
    depth_m, mask = scene()
    depth_m[30:60] = 0.0
    (cloud,) = mask_clouds(mask[None], depth_m, CAMERA, SETTINGS, 6.0)
    assert cloud[:, 1].min() > -0.01
    (none,) = mask_clouds(mask[None], depth_m, CAMERA, SETTINGS, 0.9)
    assert none.shape == (0, 3)


def test_a_cloud_below_the_least_size_is_empty_and_keeps_its_place():
    depth_m, mask = scene()
    tiny = np.zeros_like(mask)
    tiny[0:3, 0:4] = True
    clouds = mask_clouds(np.array([tiny, mask, np.zeros_like(mask)]), depth_m, CAMERA, replace_settings(least_points=20), 6.0)
    assert [len(cloud) > 0 for cloud in clouds] == [False, True, False]
    assert len(clouds[0]) == 0 < len(mask_clouds(tiny[None], depth_m, CAMERA, SETTINGS, 6.0)[0])


def test_no_masks_no_clouds():
    depth_m, _ = scene()
    assert mask_clouds(np.zeros((0, 120, 160), dtype=bool), depth_m, CAMERA, SETTINGS, 6.0) == ()
    assert mask_clouds(np.full((120, 160), NO_MASK), depth_m, CAMERA, SETTINGS, 6.0) == ()


def test_a_lens_bends_the_cloud_as_the_camera_says():
    depth_m, mask = scene()
    lens = replace(CAMERA, distortion=(0.1, -0.02, 0.001, 0.0, 0.0))
    (cloud,) = mask_clouds(mask[None], depth_m, lens, replace_settings(voxel_m=1e-4), 6.0)
    v, u = np.nonzero(mask)
    exact = lens.back_project(np.column_stack([u, v]), depth_m[mask])
    np.testing.assert_allclose(np.sort(cloud[:, 0]), np.sort(exact[:, 0]), atol=1e-12)


@pytest.mark.parametrize(
    ("masks", "message"),
    [
        (np.zeros((1, 60, 80), dtype=bool), r"\(1, 60, 80\)"),
        (np.zeros((1, 120, 160), dtype=np.uint8), "wanted bool"),
        (np.zeros((120, 160)), "whole numbers"),
        (np.full((120, 160), 7), "below 3"),
    ],
)
def test_masks_that_do_not_fit_are_refused(masks, message):
    with pytest.raises(FrameError, match=message):
        mask_clouds(masks, scene()[0], CAMERA, SETTINGS, 6.0, count=3)


def test_the_mask_of_a_box_is_what_stands_in_its_middle():
    depth_m, mask = scene()
    found = box_masks(np.array([[36.0, 26.0, 122.0, 104.0], [-30.0, -30.0, -5.0, -5.0]]), depth_m, CAMERA, 6.0)
    assert np.array_equal(found[0], mask)
    assert not found[1].any()
    depth_m[mask] = 0.0
    assert not (box_masks(np.array([[36.0, 26.0, 122.0, 104.0]]), depth_m, CAMERA, 6.0)[0] & mask).any()
    with pytest.raises(FrameError, match="one size"):
        box_masks(np.zeros((0, 4)), depth_m[:50], CAMERA, 6.0)
