"""Where a mask ends because something nearer begins."""

import numpy as np
import pytest

from seo_slam.perception.hidden_sides import hidden_sides

LEFT, TOP, RIGHT, BOTTOM = range(4)
BESIDE = {
    LEFT: (slice(90, 150), slice(60, 120)),
    TOP: (slice(30, 90), slice(120, 200)),
    RIGHT: (slice(90, 150), slice(200, 260)),
    BOTTOM: (slice(150, 210), slice(120, 200)),
}
"""Patches that adjoin the mask at each side."""


def scene(scale=1):
    """A mask (rows 90 to 150, columns 120 to 200) of a thing at 1.5 m before a wall at 3 m, and its box."""
    mask = np.zeros((240 * scale, 320 * scale), dtype=bool)
    mask[90 * scale : 150 * scale, 120 * scale : 200 * scale] = True
    depth_m = np.where(mask, 1.5, 3.0).astype(np.float32)
    return mask, depth_m, scale * np.array([120.0, 90.0, 200.0, 150.0])


def hidden_at(*sides):
    return [side in sides for side in range(4)]


def test_before_a_wall_no_side_is_hidden():
    assert hidden_sides(*scene()).tolist() == hidden_at()


@pytest.mark.parametrize("side", BESIDE)
def test_the_side_at_which_something_nearer_stands(side):
    mask, depth_m, box = scene()
    depth_m[BESIDE[side]] = 1.0
    assert hidden_sides(mask, depth_m, box).tolist() == hidden_at(side)


def test_all_sides_at_once():
    mask, depth_m, box = scene()
    depth_m[~mask] = 1.0
    assert hidden_sides(mask, depth_m, box).tolist() == [True] * 4


@pytest.mark.parametrize("side", BESIDE)
@pytest.mark.parametrize("depth", [1.48, 1.5, 1.6, 0.0], ids=["a little nearer", "as far", "farther", "unknown"])
def test_what_is_not_clearly_nearer_hides_nothing(side, depth):
    mask, depth_m, box = scene()
    depth_m[BESIDE[side]] = depth
    assert hidden_sides(mask, depth_m, box).tolist() == hidden_at()


def test_the_table_on_which_it_stands_hides_nothing():
    """Below the thing the table comes nearer, by some millimetres a pixel."""
    mask, depth_m, box = scene()
    rows = np.arange(150, 240)
    depth_m[150:] = (1.5 - 0.004 * (rows - 149))[:, None]
    assert hidden_sides(mask, depth_m, box).tolist() == hidden_at()


def test_a_thin_thing_before_it_is_no_side():
    mask, depth_m, box = scene()
    depth_m[90:100, 60:120] = 1.0
    assert hidden_sides(mask, depth_m, box).tolist() == hidden_at()


def test_a_mask_that_ends_at_the_image_ends_there_for_another_reason():
    mask, depth_m, _ = scene()
    mask[:] = False
    mask[90:150, 0:80] = True
    depth_m[:] = 3.0
    depth_m[mask] = 1.5
    assert hidden_sides(mask, depth_m, np.array([0.0, 90.0, 80.0, 150.0])).tolist() == hidden_at()


def test_a_slanted_side_counts_too():
    """What stands before it need not be upright."""
    mask, depth_m, box = scene()
    rows, columns = np.mgrid[:240, :320]
    before = columns < 120 + (rows - 90)
    mask &= ~before
    depth_m[before] = 1.0
    assert hidden_sides(mask, depth_m, box)[LEFT]


@pytest.mark.parametrize("side", BESIDE)
def test_a_larger_image_says_the_same(side):
    mask, depth_m, box = scene()
    depth_m[BESIDE[side]] = 1.0
    twice = np.kron(mask, np.ones((2, 2), bool)), np.kron(depth_m, np.ones((2, 2), np.float32)), 2 * box
    assert hidden_sides(*twice).tolist() == hidden_at(side)


def test_an_empty_mask_has_no_sides():
    mask, depth_m, box = scene()
    assert hidden_sides(np.zeros_like(mask), depth_m, box).tolist() == hidden_at()
