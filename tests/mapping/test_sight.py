"""What painted depth images say of places: hidden, seen through, seen, or nothing."""

from dataclasses import replace

import numpy as np
import pytest

from painted_blocks import FAR_ASIDE_M, Block, paint, pose
from seo_slam.camera import Camera
from seo_slam.mapping.sight import DepthView, look
from seo_slam.testing.worlds import TINY_CAMERA

NOISE = 0.0019
CUP = Block("cup", 0.1, 0.05, 1.3)


def surface(block, depth_m=0.0):
    """Points (36, 3) on a block's front, reaching ``depth_m`` behind it."""
    side = np.linspace(-0.9, 0.9, 6) * block.half_m
    x, y = (grid.ravel() for grid in np.meshgrid(side, side))
    T = pose()
    p_camera = np.array([block.x, block.y, block.z]) + np.stack([x, y, np.linspace(0.0, depth_m, 36)], axis=1)
    return p_camera @ T[:3, :3].T + T[:3, 3]


def seen(depth_m, *blocks, aside_m=0.0, max_depth_m=6.0):
    view = DepthView(TINY_CAMERA, depth_m, pose(aside_m))
    return look([surface(block) for block in blocks or (CUP,)], view, max_depth_m, NOISE)


def test_what_is_where_it_was_is_neither_hidden_nor_seen_through():
    sight = seen(paint([CUP]))
    assert (sight.in_view[0], sight.hidden[0], sight.through[0]) == (True, 0.0, 0.0)


def test_behind_an_occluder_it_is_hidden():
    sight = seen(paint([CUP, Block("screen", 0.1, 0.05, 0.9, 0.1)]))
    assert (sight.in_view[0], sight.hidden[0], sight.through[0]) == (True, 1.0, 0.0)


def test_half_behind_an_occluder_it_is_half_hidden_and_what_shows_is_not_seen_through():
    screen = Block("screen", 0.1 - 0.09, 0.03, 0.85, 0.08)
    sight = seen(paint([CUP, screen]))
    assert 0.2 < sight.hidden[0] < 0.8
    assert sight.through[0] == 0.0


def test_before_free_space_it_is_seen_through():
    sight = seen(paint([]))
    assert (sight.in_view[0], sight.hidden[0], sight.through[0]) == (True, 0.0, 1.0)


def test_half_behind_an_occluder_and_gone_all_that_is_open_is_seen_through():
    crate = Block("crate", 0.1, 0.05, 1.3, 0.15)
    sight = seen(paint([Block("screen", -0.13, 0.05, 0.9, 0.2)]), crate)
    assert 0.2 < sight.hidden[0] < 0.8
    assert sight.through[0] > 0.6


@pytest.mark.parametrize("z", [1.28, 1.29, 1.31, 1.32])
def test_two_centimetres_off_it_is_the_same_surface(z):
    sight = seen(paint([replace(CUP, z=z)]))
    assert (sight.hidden[0], sight.through[0]) == (0.0, 0.0)


def test_the_noise_of_far_depth_is_granted():
    """3 cm and three standard deviations: 6 mm more at 1 m, 14 cm more at 5 m."""
    far = Block("chest", 0.1, 0.05, 5.0, 0.4)
    assert seen(paint([], wall_m=5.15), far).through[0] == 0.0
    assert seen(paint([], wall_m=5.3), far).through[0] == 1.0
    assert seen(paint([], wall_m=1.45)).through[0] == 1.0


@pytest.mark.parametrize("off", [{"x": CUP.x + 0.012}, {"x": CUP.x - 0.012}, {"y": CUP.y + 0.012}, {"y": CUP.y - 0.012}])
def test_a_pose_that_errs_sideways_by_a_centimetre_sees_nothing_through(off):
    assert seen(paint([replace(CUP, **off)])).through[0] == 0.0


def test_a_flat_thing_on_a_table_is_never_seen_through():
    """Taken away, it leaves the table 1 cm behind: no free space, whatever the distance."""
    for z in (0.6, 1.0, 2.0, 4.0):
        card = Block("card", 0.0, 0.0, z, 0.1)
        sight = seen(paint([], wall_m=z + 0.01), card)
        assert sight.in_view[0]
        assert sight.through[0] == 0.0


def test_a_thing_on_a_slanted_table_is_where_it_is():
    """Depth falls down the image, as a table's does; a flat thing lies 1 cm before it."""
    rays = TINY_CAMERA.rays()
    table_m = 1.6 / (1.0 + 1.2 * rays[..., 1])
    rows, columns = np.meshgrid(np.arange(110, 170, 8), np.arange(120, 200, 8), indexing="ij")
    z = table_m[rows, columns].ravel() - 0.01
    p_camera = np.concatenate([rays[rows, columns].reshape(-1, 2) * z[:, None], z[:, None]], axis=1)
    p_world = p_camera @ pose()[:3, :3].T + pose()[:3, 3]
    sight = look([p_world], DepthView(TINY_CAMERA, table_m.astype(np.float32), pose()), 6.0, NOISE)
    assert (sight.in_view[0], sight.through[0], sight.hidden[0]) == (True, 0.0, 0.0)


@pytest.mark.parametrize(
    ("block", "aside_m"),
    [
        pytest.param(CUP, FAR_ASIDE_M, id="out of the image"),
        pytest.param(Block("cup", 0.75, 0.0, 1.3), 0.0, id="at its border"),
        pytest.param(Block("cup", 0.0, 0.56, 1.3), 0.0, id="at its lower border"),
        pytest.param(Block("cup", 0.0, 0.0, -1.3), 0.0, id="behind the camera"),
        pytest.param(Block("cup", 0.0, 0.0, 0.05), 0.0, id="at the lens"),
        pytest.param(Block("cup", 0.0, 0.0, 7.0), 0.0, id="out of range"),
    ],
)
def test_what_is_not_in_view(block, aside_m):
    assert not seen(paint([], aside_m, wall_m=9.0), block, aside_m=aside_m).in_view[0]


def test_range_is_a_setting():
    assert seen(paint([CUP]), max_depth_m=1.4).in_view[0]
    assert not seen(paint([CUP]), max_depth_m=1.2).in_view[0]


def test_without_depth_nothing_is_in_view_or_seen_through():
    none = seen(np.zeros((240, 320), np.float32))
    assert (none.in_view[0], none.through[0], none.hidden[0]) == (False, 0.0, 0.0)
    holes = paint([])
    holes[np.random.default_rng(0).uniform(size=holes.shape) < 0.3] = 0.0
    assert seen(holes).in_view[0]


def test_each_of_several_is_judged_by_itself():
    gone, hidden, outside = Block("cup", -0.3), Block("cup", 0.35), Block("cup", 3.0)
    sight = seen(paint([CUP, hidden, Block("screen", 0.3, 0.1, 1.0, 0.1)]), CUP, gone, hidden, outside)
    assert sight.in_view.tolist() == [True, True, True, False]
    assert (sight.hidden > 0.9).tolist()[:3] == [False, False, True]
    assert (sight.through > 0.9).tolist()[:3] == [False, True, False]


def test_nothing_to_look_at():
    sight = look([], DepthView(TINY_CAMERA, paint([]), pose()), 6.0, NOISE)
    assert [len(part) for part in (sight.in_view, sight.hidden, sight.through, sight.area_px)] == [0] * 4


def test_an_image_of_another_size_says_the_same():
    blocks = [CUP, Block("screen", 0.35, 0.1, 1.0, 0.1)]
    asked = (CUP, Block("cup", -0.3), Block("cup", 0.42, 0.12))
    small = seen(paint(blocks), *asked)
    large_camera = Camera(520.0, 520.0, 319.5, 239.5, 640, 480)
    large_view = DepthView(large_camera, np.kron(paint(blocks), np.ones((2, 2), np.float32)), pose())
    large = look([surface(block) for block in asked], large_view, 6.0, NOISE)
    np.testing.assert_array_equal(small.in_view, large.in_view)
    np.testing.assert_allclose(small.hidden, large.hidden, atol=0.15)
    np.testing.assert_allclose(small.through, large.through, atol=0.15)
    np.testing.assert_allclose(small.area_px, large.area_px, rtol=0.02)


def test_area_is_that_of_its_box_in_a_vga_image():
    side_px = 2 * 0.9 * CUP.half_m * 520.0 / CUP.z
    assert seen(paint([CUP])).area_px[0] == pytest.approx(side_px**2, rel=0.01)
    nearer = seen(paint([]), replace(CUP, z=0.65)).area_px[0]
    assert nearer == pytest.approx(4 * side_px**2, rel=0.01)


def test_a_deep_thing_does_not_hide_itself():
    """Points of its far side, seen from elsewhere, lie behind its own front: that is no occluder."""
    deep = surface(CUP, depth_m=0.3)
    sight = look([deep], DepthView(TINY_CAMERA, paint([CUP]), pose()), 6.0, NOISE)
    assert (sight.hidden[0], sight.through[0]) == (0.0, 0.0)
