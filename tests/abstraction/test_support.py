"""Planes that carry things."""

import numpy as np
import pytest
from boxes_of_points import chair_points, on_box, shelf_points, table_points

from seo_slam.abstraction.support import planes, support_height


def test_the_planes_of_furniture(settings):
    for points, expected in ((table_points(), 0.74), (chair_points(), 0.45)):
        found = planes(points, settings)
        assert support_height(found, points[:, 2].max()) == pytest.approx(expected, abs=0.02)
    heights = sorted(plane.height_m for plane in planes(shelf_points(), settings))
    np.testing.assert_allclose(heights, [0.05, 0.45, 0.85, 1.25], atol=0.025)


def test_a_dense_front_is_no_plane(settings):
    front = on_box((0, 0, 0), (1.0, 0.5, 0.9), "front", step_m=0.01)
    top = on_box((0, 0, 0), (1.0, 0.5, 0.9), "top", step_m=0.04)
    assert len(front) > 10 * len(top)
    found = planes(np.concatenate([front, top]), settings)
    assert [plane.height_m for plane in found] == pytest.approx([0.9], abs=0.02)
    assert planes(front, settings) == ()
    assert support_height((), 0.9) == 0.9


def test_noise_leaves_the_plane(settings):
    noisy = table_points() + np.random.default_rng(0).normal(0, 0.012, (len(table_points()), 3))
    assert support_height(planes(noisy, settings), 1.0) == pytest.approx(0.74, abs=0.03)


def test_no_points_no_planes(settings):
    assert planes(np.zeros((0, 3)), settings) == ()
    assert [plane.height_m for plane in planes(np.array([[1.0, 2.0, 0.5]]), settings)] == [0.5]
