"""Floor that was only seen over."""

import numpy as np
import pytest

from seo_slam.abstraction.layout import layout_of
from seo_slam.abstraction.seen_over import View, low_on_rays
from seo_slam.abstraction.voxels import Voxels
from seo_slam.settings.planning import LayoutSettings

LEVEL = np.zeros(3)
EYE = np.array([0.0, 0.05, 1.0])


def plane(low, high, z, step=0.05):
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step), indexing="ij")
    return np.stack([x, y, np.full_like(x, z)], axis=-1).reshape(-1, 3) + np.array([step / 2, step / 2, 0.0])


def test_a_ray_is_low_from_where_it_falls_below_the_height_to_right_before_its_end():
    view = View(EYE, np.array([[4.0, 0.05, 0.0]]))
    low = low_on_rays([view], LEVEL, 0.5, 0.05, 1000)
    assert low[:, 0].min() == pytest.approx(2.0)
    assert 3.8 < low[:, 0].max() <= 3.9
    assert np.allclose(low[:, 1], 0.05)
    assert np.diff(np.sort(low[:, 0])).max() <= 0.05


def test_a_floor_that_leans_is_looked_over_as_one_that_is_level():
    leaning = np.array([0.02, 0.0, 0.3])
    rise = np.array([0.0, 0.0, 0.3])
    view = View(EYE + rise, np.array([[4.0, 0.05, 0.38]]))
    low = low_on_rays([view], leaning, 0.5, 0.05, 1000)
    assert low[:, 0].min() == pytest.approx(2.0)


def test_a_ray_that_ends_high_or_at_the_feet_tells_nothing():
    ends = np.array([[4.0, 0.05, 0.6], [0.05, 0.05, 0.0]])
    assert not len(low_on_rays([View(EYE, ends)], LEVEL, 0.5, 0.05, 1000))
    assert not len(low_on_rays([View(EYE, np.zeros((0, 3)))], LEVEL, 0.5, 0.05, 1000))
    assert not len(low_on_rays([], LEVEL, 0.5, 0.05, 1000))


@pytest.mark.parametrize("seen_over_m", [0.0, 0.5])
def test_floor_before_what_was_seen_is_floor_and_what_stands_in_it_is_not(seen_over_m):
    """The camera sees floor from 3 m on and a box in between: what lies before the box was looked over, what lies under it was not."""
    floor = plane((3.0, -1.0), (5.0, 1.0), 0.0)
    box = np.concatenate([plane((2.0, -0.5), (2.5, 0.5), 0.4)])
    views = [View(EYE, np.concatenate([floor, box]))]
    voxels = Voxels.of(np.concatenate([floor, box] * 4), 0.05)
    way = np.tile(EYE, (2, 1))
    layout = layout_of(voxels, way, LayoutSettings(seen_over_m=seen_over_m, floor_gap_cells=0, path_radius_m=0.0), views)

    def floor_share(low, high):
        (r0, c0), (r1, c1) = layout.cells(np.array([low, high]))
        return layout.floor[r0:r1, c0:c1].mean()

    assert floor_share((3.2, -0.8), (4.8, 0.8)) == 1.0
    assert floor_share((2.1, -0.4), (2.4, 0.4)) == 0.0
    beside = floor_share((2.2, 0.6), (2.9, 0.75)), floor_share((2.7, -0.1), (2.95, 0.1))
    assert min(beside) > 0.9 if seen_over_m else max(beside) == 0.0
    assert floor_share((0.2, -0.2), (1.0, 0.2)) == 0.0  # right before the camera everything was passed over higher than that


def test_a_stair_down_is_no_floor_although_it_is_looked_over():
    """Between two floors there is a hole; the camera sees its far wall and the floor beyond, never the near edge's other side."""
    near, far = plane((-2.0, -1.5), (1.5, 1.5), 0.0), plane((2.8, -1.5), (5.0, 1.5), 0.0)
    z, y = np.meshgrid(np.arange(-0.9, 0.0, 0.05), np.arange(-1.5, 1.5, 0.05), indexing="ij")
    wall = np.stack([np.full_like(y, 2.78), y, z], axis=-1).reshape(-1, 3)

    def floor_in_hole(*points):
        seen = np.concatenate(points)
        eye = np.array([-0.5, 0.05, 1.0])
        ahead = seen[seen[:, 0] > 2.7]
        layout = layout_of(Voxels.of(np.concatenate([seen] * 4), 0.05), np.tile(eye, (2, 1)), LayoutSettings(), [View(eye, ahead)])
        (r0, c0), (r1, c1) = layout.cells(np.array([[1.7, -0.2], [2.6, 0.2]]))
        return layout.floor[r0:r1, c0:c1].mean()

    assert floor_in_hole(near, far) > 0.5  # as floor that was only looked over
    assert floor_in_hole(near, far, wall) == 0.0
