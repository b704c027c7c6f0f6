import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from local_scenes import BOX, CAMERA, WALL_M, put, surface_of, view_of, wall

from seo_slam.agents.contrast import colour_contrast
from seo_slam.agents.local_looks import MAYBE, NOTHING, THING, Look, added_up, look_at
from seo_slam.agents.local_patch import MOST_CELLS, cut_patch
from seo_slam.agents.relief import planes_through, relief_of
from seo_slam.types import Frame

NOISE = 0.0019


def looked(rgb, depth_m):
    return look_at(1, view_of(rgb, depth_m), NOISE)


@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_a_bare_wall_is_nothing(tilt):
    look = looked(*wall(tilt=tilt))
    assert look.going_on > 0.95
    assert look.own < 0.02
    assert look.contrast < 0.05
    assert look.nothing() == NOTHING


def test_a_book_of_three_centimetres_stands_out_in_depth_alone():
    rgb, depth_m = wall(depth_noise=0.001)
    x0, y0, x1, y1 = (int(v) for v in BOX)
    depth_m[y0:y1, x0:x1] -= 0.03
    look = look_at(1, view_of(rgb, depth_m), 0.001)
    assert look.going_on < 0.3
    assert look.own > 0.6
    assert look.contrast < 0.15
    assert look.nothing() == THING


def test_a_flat_poster_of_another_colour_stands_out_in_colour_alone():
    look = looked(*put(*wall(), colour=(150, 60, 50)))
    assert look.going_on > 0.95
    assert look.contrast > 0.8
    assert look.nothing() == THING


def test_a_flat_white_socket_on_a_grey_wall_stands_out():
    rgb, depth_m = wall()
    assert looked(*put(rgb, depth_m, colour=(170, 170, 170))).nothing() == THING


def test_a_box_beside_something_larger_is_not_that():
    """A post that goes through the box is nearer than the wall, but goes on beyond it."""
    rgb, depth_m = wall()
    depth_m[:, 150:165] -= 0.3
    look = looked(rgb, depth_m)
    assert look.own < 0.02


def test_what_is_hidden_or_without_depth_tells_nothing():
    rgb, depth_m = wall()
    surface = surface_of(depth_m)
    hidden = depth_m.copy()
    hidden[80:160, 120:200] = 1.0
    patch = cut_patch(Frame(0.0, rgb, hidden, CAMERA), BOX)
    uvz = np.column_stack([CAMERA.project(surface), surface[:, 2]])
    assert relief_of(patch, uvz, NOISE) is None
    blind = depth_m.copy()
    blind[95:145, 130:190] = 0.0
    assert looked(rgb, blind) is None


def test_a_box_that_fills_the_image_has_nothing_around_it():
    rgb, depth_m = wall()
    patch = cut_patch(Frame(0.0, rgb, depth_m, CAMERA), np.array([0.0, 0.0, 320.0, 240.0]))
    assert colour_contrast(patch) is None
    assert relief_of(patch, np.zeros((0, 3)), NOISE) is None


def test_a_box_outside_the_image_has_no_patch():
    rgb, depth_m = wall()
    assert cut_patch(Frame(0.0, rgb, depth_m, CAMERA), np.array([400.0, 300.0, 420.0, 320.0])) is None


@given(st.floats(0, 310), st.floats(0, 230), st.floats(2, 200), st.floats(2, 200))
@settings(max_examples=40, deadline=None)
def test_patches_are_small_and_their_cells_are_where_pixels_are(x, y, w, h):
    rgb, depth_m = np.zeros((240, 320, 3), np.uint8), np.full((240, 320), WALL_M, np.float32)
    patch = cut_patch(Frame(0.0, rgb, depth_m, CAMERA), np.array([x, y, min(x + w, 320), min(y + h, 240)]))
    if patch is None:
        return
    assert max(patch.inside.shape) <= MOST_CELLS
    assert not (patch.inside & patch.outside).any()
    row, column, within = patch.cells_at(np.array([[x + 0.4 * min(w, 320 - x), y + 0.4 * min(h, 240 - y)], [-5.0, -5.0]]))
    assert within.tolist() == [True, False]
    assert patch.lab.shape[:2] == patch.inverse_depth.shape == patch.inside.shape
    assert np.isclose(patch.inverse_depth[row[0], column[0]], 1 / WALL_M)


@given(st.integers(0, 1000), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(0.2, 2.0))
@settings(max_examples=40, deadline=None)
def test_a_plane_is_found_whatever_it_is(seed, a, b, c):
    draws = np.random.default_rng(seed)
    points = np.column_stack([draws.uniform(-0.5, 0.5, (60, 2)), np.ones(60)])
    values = points @ [a, b, c]
    values[:12] += 1.0  # something else
    planes = planes_through(points, values, 0.01)
    assert np.allclose(planes[0], [a, b, c], atol=1e-3)


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_more_relief_or_contrast_never_speaks_for_nothing(going_on, own, contrast):
    here = Look(going_on, own, contrast).nothing()
    assert Look(going_on, own, 1.0).nothing() <= here
    assert Look(going_on / 2, own, contrast).nothing() <= here
    assert here in (NOTHING, MAYBE, THING)


def test_looks_from_one_side_count_little_more_than_one():
    assert added_up([[3.0], [3.0]]) == 6.0
    assert added_up([[3.0, 3.0]]) == pytest.approx(3.75)
    assert added_up([]) == 0.0
