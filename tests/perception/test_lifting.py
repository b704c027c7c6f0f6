"""Objects of known place and size, painted into depth images, come out where they are, within their own covariance."""

import numpy as np
import pytest

from seo_slam.camera import Camera
from seo_slam.config import LiftingSettings
from seo_slam.perception.lifting import observe
from seo_slam.types import Detections, Frame

CAMERA = Camera(fx=260.0, fy=260.0, cx=159.5, cy=119.5, width=320, height=240)
NOISE = LiftingSettings().depth_noise_at_1m_m


def plane(camera, z_m, x_slope=0.0, y_slope=0.0):
    """Depth of the plane ``z = z_m + x_slope * x + y_slope * y``."""
    rays = camera.rays()
    return z_m / (1.0 - x_slope * rays[..., 0] - y_slope * rays[..., 1])


def nearer(depth_m, other_m, where):
    """The first scene with another one before it where ``where`` says."""
    return np.where(where & (other_m < depth_m), other_m, depth_m)


def inside(camera, depth_m, centre, size):
    """Pixels whose point on a surface lies within a rectangle (width, height) around a point of the camera frame."""
    p = camera.rays() * depth_m[..., None]
    half = 0.5 * np.asarray(size)
    return (np.abs(p - np.asarray(centre)[:2]) <= half).all(axis=2)


def box_of(pixels, pad_px=0.0):
    v, u = np.nonzero(pixels)
    return np.array([u.min() - 0.5 - pad_px, v.min() - 0.5 - pad_px, u.max() + 0.5 + pad_px, v.max() + 0.5 + pad_px])


def noisy(depth_m, seed=0):
    return depth_m + NOISE * depth_m**2 * np.random.default_rng(seed).normal(size=depth_m.shape)


def lift(depth_m, *rows, camera=CAMERA, masks=None, labels=None, scores=None, settings=None):
    depth = np.asarray(depth_m, dtype=np.float32)
    frame = Frame(0.0, np.zeros((camera.height, camera.width, 3), np.uint8), depth, camera)
    n = len(rows)
    found = Detections(
        np.clip(np.array(rows, dtype=np.float64).reshape(n, 4), 0, [camera.width, camera.height] * 2),
        labels or ("thing",) * n,
        np.array(scores if scores is not None else [0.9] * n, dtype=np.float64),
        None if masks is None else np.array(masks),
    )
    return observe(found, frame, settings or LiftingSettings())


def sheet(centre, size, wall_m=2.5, camera=CAMERA):
    """A rectangle that faces the camera, before a wall: depth and the pixels of the rectangle."""
    surface = plane(camera, centre[2])
    own = inside(camera, surface, centre, size)
    return nearer(plane(camera, wall_m), surface, own), own


def squared_distance(seen, row, p_camera):
    error = seen.p_camera[row] - p_camera
    return float(error @ np.linalg.solve(seen.cov_camera[row], error))


def test_an_object_before_a_wall_is_where_it_is_and_as_large():
    centre, size = np.array([0.2, -0.1, 1.3]), (0.24, 0.16)
    depth, own = sheet(centre, size)
    seen, warnings = lift(noisy(depth), box_of(own))
    assert warnings == ()
    np.testing.assert_allclose(seen.p_camera[0], centre, atol=0.006)
    np.testing.assert_allclose(seen.size_m[0], size, atol=0.012)
    assert not seen.truncated.any()
    assert seen.labels == ("thing",)


def test_an_ellipse_that_fills_its_box_by_three_quarters_is_not_pulled_to_the_wall():
    centre = np.array([-0.2, 0.1, 1.0])
    surface = plane(CAMERA, 1.0)
    off = (CAMERA.rays() * surface[..., None] - centre[:2]) / (0.15, 0.1)
    own = (off**2).sum(axis=2) <= 1.0
    seen, _ = lift(noisy(nearer(plane(CAMERA, 3.0), surface, own)), box_of(own))
    np.testing.assert_allclose(seen.p_camera[0], centre, atol=0.008)


def test_half_the_box_is_background():
    """A box 1.4 times as long and wide as its object: half of its pixels lie on the wall."""
    centre, size = np.array([0.05, 0.0, 1.2]), (0.2, 0.2)
    depth, own = sheet(centre, size)
    box = box_of(own)
    middle, half = 0.5 * (box[:2] + box[2:]), 0.5 * (box[2:] - box[:2]) * np.sqrt(2.0)
    seen, _ = lift(noisy(depth), np.concatenate([middle - half, middle + half]))
    share = own.sum() / np.prod(2 * half)
    assert 0.45 < share < 0.55
    np.testing.assert_allclose(seen.p_camera[0], centre, atol=0.01)
    assert seen.clouds[0][:, 2].max() < 1.4


def test_a_thin_slanted_plane_is_measured_at_its_middle():
    surface = plane(CAMERA, 1.2, x_slope=0.5)
    own = inside(CAMERA, surface, (0.0, 0.0), (0.3, 0.15))
    seen, _ = lift(noisy(nearer(plane(CAMERA, 3.0), surface, own)), box_of(own))
    assert np.linalg.norm(seen.p_camera[0] - [0.0, 0.0, 1.2]) < 0.03
    assert squared_distance(seen, 0, [0.0, 0.0, 1.2]) < 11.3


def test_a_cup_on_a_table():
    """The camera looks down: the table passes behind the cup and comes nearer below it."""
    table = plane(CAMERA, 1.2, y_slope=-1.2)
    cup = plane(CAMERA, 0.95)
    own = inside(CAMERA, cup, (0.05, 0.02), (0.08, 0.1)) & (cup < table)
    assert own.sum() > 300
    seen, _ = lift(noisy(nearer(table, cup, own)), box_of(own, pad_px=3))
    assert abs(seen.p_camera[0, 2] - 0.95) < 0.02
    assert squared_distance(seen, 0, [0.05, 0.02, 0.95]) < 11.3


def test_a_screen_without_depth_is_placed_by_its_frame():
    centre, size = np.array([0.0, 0.0, 1.1]), (0.4, 0.28)
    depth, own = sheet(centre, size)
    black = inside(CAMERA, plane(CAMERA, 1.1), centre, (0.36, 0.24))
    depth = noisy(depth)
    depth[black] = 0.0
    seen, _ = lift(depth, box_of(own))
    np.testing.assert_allclose(seen.p_camera[0], centre, atol=0.02)
    np.testing.assert_allclose(seen.size_m[0], size, atol=0.02)


def test_a_mask_tells_which_of_two_surfaces_is_meant():
    """A thin stand before a large board: the box holds both, the mask one."""
    board, stand = plane(CAMERA, 1.6), plane(CAMERA, 1.0)
    post = inside(CAMERA, stand, (0.0, 0.0), (0.08, 0.5))
    whole = inside(CAMERA, board, (0.0, 0.0), (0.6, 0.5))
    depth = nearer(nearer(plane(CAMERA, 3.0), board, whole), stand, post)
    box = box_of(whole)
    by_box, _ = lift(noisy(depth), box)
    by_mask, _ = lift(noisy(depth), box, masks=[post])
    assert abs(by_box.p_camera[0, 2] - 1.6) < 0.02  # most of the box is board
    assert abs(by_mask.p_camera[0, 2] - 1.0) < 0.02


def test_the_centre_of_a_mask_is_the_centre_of_the_object():
    centre, size = np.array([0.1, 0.05, 1.2]), (0.2, 0.12)
    depth, own = sheet(centre, size)
    loose = box_of(own) + np.array([-40, -5, 5, 5])
    seen, _ = lift(noisy(depth), loose, masks=[own])
    np.testing.assert_allclose(seen.p_camera[0], centre, atol=0.01)


def test_an_empty_mask_counts_as_none():
    centre, size = np.array([0.1, 0.05, 1.2]), (0.2, 0.12)
    depth, own = sheet(centre, size)
    with_mask, _ = lift(depth, box_of(own), masks=[np.zeros_like(own)])
    without, _ = lift(depth, box_of(own))
    np.testing.assert_array_equal(with_mask.p_camera, without.p_camera)


def test_detections_without_depth_are_left_out_and_counted():
    centre, size = np.array([0.2, 0.0, 1.2]), (0.2, 0.12)
    depth, own = sheet(centre, size)
    depth[:, :100] = 0.0
    seen, warnings = lift(depth, box_of(own), [10, 10, 60, 60], [10, 100, 60, 160], labels=("cup", "book", "pen"))
    assert seen.labels == ("cup",)
    assert seen.rows.tolist() == [0]
    assert len(warnings) == 1
    assert "2 of 3 detections" in warnings[0]


@pytest.mark.parametrize("hole", [0.0, 7.0])
def test_nothing_is_measured_where_nothing_came_back_or_all_is_too_far(hole):
    seen, warnings = lift(np.full((240, 320), hole), [10, 10, 60, 60])
    assert len(seen) == 0
    assert seen.embeddings.shape == (0, 0)
    assert "1 of 1" in warnings[0]


def test_no_detections_give_no_observations_and_no_warning():
    seen, warnings = lift(plane(CAMERA, 1.0))
    assert len(seen) == 0
    assert warnings == ()


def test_scores_below_the_least_one_are_ignored_without_a_warning():
    centre, size = np.array([0.0, 0.0, 1.2]), (0.2, 0.12)
    depth, own = sheet(centre, size)
    rows = (box_of(own), [10, 10, 60, 60])
    seen, warnings = lift(depth, *rows, scores=[0.6, 0.2], settings=LiftingSettings(min_score=0.5))
    assert seen.rows.tolist() == [0]
    assert warnings == ()


def test_rows_point_into_the_detections():
    first, one = sheet((-0.35, 0.0, 1.2), (0.2, 0.12))
    second, two = sheet((0.3, 0.0, 1.4), (0.2, 0.12))
    depth = np.minimum(first, second)
    seen, _ = lift(depth, [300, 220, 302, 222], box_of(one), box_of(two), labels=("dot", None, "book"))
    assert seen.rows.tolist() == [1, 2]
    assert seen.labels == (None, "book")


def test_a_box_cut_by_the_border_is_less_certain_across_that_border_only():
    centre, size = np.array([0.0, 0.0, 1.2]), (0.2, 0.2)
    depth, own = sheet(centre, size)
    whole, _ = lift(depth, box_of(own))
    u0 = int(np.nonzero(own)[1].min())
    cut_camera = Camera(CAMERA.fx, CAMERA.fy, CAMERA.cx - u0 - 12, CAMERA.cy, CAMERA.width - u0 - 12, CAMERA.height)
    cut_depth, cut_own = depth[:, u0 + 12 :], own[:, u0 + 12 :]
    cut, _ = lift(cut_depth, box_of(cut_own), camera=cut_camera)
    assert cut.truncated[0].tolist() == [True, False, False, False]
    grown = cut.cov_camera[0].diagonal() / whole.cov_camera[0].diagonal()
    assert grown[0] > 4.0
    assert grown[1] == pytest.approx(1.0, rel=0.1)
    assert grown[2] < 1.1
    assert squared_distance(cut, 0, centre) < 11.3  # the true centre is not where the box's centre is, and it knows


def test_a_sliver_at_the_border_knows_that_it_is_a_sliver():
    depth = plane(CAMERA, 1.2)
    seen, _ = lift(depth, [0, 60, 12, 180])
    assert np.sqrt(seen.cov_camera[0, 0, 0]) > 0.04


def test_a_distorted_lens_is_undistorted():
    wide = Camera(260.0, 260.0, 159.5, 119.5, 320, 240, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633))
    for centre in ([0.0, 0.0, 1.2], [0.45, 0.3, 1.2], [-0.5, -0.3, 1.3]):
        depth, own = sheet(np.array(centre), (0.12, 0.1), camera=wide)
        seen, _ = lift(depth, box_of(own), camera=wide)
        np.testing.assert_allclose(seen.p_camera[0], centre, atol=0.006)


def test_the_cloud_lies_on_the_surface():
    centre, size = np.array([0.1, 0.0, 1.2]), (0.2, 0.12)
    depth, own = sheet(centre, size)
    seen, _ = lift(depth, box_of(own))
    cloud = seen.clouds[0]
    assert 50 < len(cloud) <= 200
    np.testing.assert_allclose(cloud[:, 2], 1.2, atol=1e-5)
    assert (np.abs(cloud[:, :2] - centre[:2]) <= np.array(size) / 2 + 0.006).all()


def test_farther_and_larger_things_are_less_certain():
    def covariance(z, side):
        depth, own = sheet(np.array([0.0, 0.0, z]), (side, side), wall_m=5.0)
        return lift(depth, box_of(own))[0].cov_camera[0].diagonal()

    near, far, large = covariance(1.0, 0.1), covariance(3.0, 0.1), covariance(1.0, 0.4)
    assert far[2] > near[2]
    assert (large > near).all()


def test_uncertainty_in_depth_points_along_the_line_of_sight():
    """A thing 23 degrees off the axis: its depth error moves it along its ray."""
    centre = np.array([0.55, 0.0, 1.3])
    depth, own = sheet(centre, (0.2, 0.2))
    covariance = lift(depth, box_of(own), settings=LiftingSettings(box_noise_share=0.0, depth_noise_at_1m_m=0.05))[0].cov_camera[0]
    values, vectors = np.linalg.eigh(covariance)
    assert values[-1] > 4 * values[-2]
    assert abs(vectors[:, -1] @ (centre / np.linalg.norm(centre))) > 0.995


def test_the_covariance_covers_the_error():
    """Sheets of many places and sizes, boxes whose edges are off by 5 % of the side: errors are as large as they say, not larger."""
    rng = np.random.default_rng(4)
    squared = []
    for trial in range(150):
        z = rng.uniform(0.7, 2.2)
        centre = np.array([rng.uniform(-0.25, 0.25) * z, rng.uniform(-0.15, 0.15) * z, z])
        size = rng.uniform(0.08, 0.35, 2)
        depth, own = sheet(centre, size, wall_m=z + rng.uniform(0.1, 1.5))
        box = box_of(own)
        side = box[2:] - box[:2]
        box = box + 0.05 * rng.normal(size=4) * np.tile(side, 2)
        seen, _ = lift(noisy(depth, trial), box)
        assert len(seen) == 1
        squared.append(squared_distance(seen, 0, centre))
    squared = np.array(squared)
    assert (squared < 7.81).mean() >= 0.93  # 95 % of chi-square with 3 degrees of freedom
    assert squared.mean() < 4.0
    assert squared.mean() > 0.5  # nor does it claim ten times too little


def half_ball(radius_m, centre):
    """Depth of a ball before a wall, and its pixels: of each ray the nearer meeting."""
    rays = np.concatenate([CAMERA.rays(), np.ones((CAMERA.height, CAMERA.width, 1))], axis=2)
    a, b, c = (rays**2).sum(axis=2), rays @ np.asarray(centre), float(np.dot(centre, centre)) - radius_m**2
    inside = b * b - a * c
    own = inside > 0
    z = np.where(own, (b - np.sqrt(np.maximum(inside, 0))) / a, np.inf)
    return nearer(plane(CAMERA, 2.5), z, own), own


@pytest.mark.parametrize("centre", [(0.0, 0.0, 1.0), (0.3, 0.2, 1.4)])
def test_a_bodys_centre_is_behind_its_surface(centre):
    depth, own = half_ball(0.12, centre)
    seen, _ = lift(noisy(depth), box_of(own), masks=[own])
    surface_m = float(np.median(depth[own]))
    assert surface_m + 0.01 < seen.p_camera[0, 2] <= centre[2] + 0.01
    assert np.linalg.norm(seen.p_camera[0] - centre) < 0.06
    assert squared_distance(seen, 0, np.array(centre)) < 11.3


def test_a_sheets_centre_is_on_it():
    depth, own = sheet(np.array([0.1, 0.05, 1.2]), (0.3, 0.2))
    seen, _ = lift(noisy(depth), box_of(own), masks=[own])
    assert seen.p_camera[0, 2] == pytest.approx(1.2, abs=0.012)


def test_a_slanted_sheets_centre_is_on_it():
    surface = plane(CAMERA, 1.2, x_slope=0.4)
    own = inside(CAMERA, surface, (0.0, 0.0), (0.24, 0.24))
    seen, _ = lift(noisy(nearer(plane(CAMERA, 3.0), surface, own)), box_of(own), masks=[own])
    assert seen.p_camera[0, 2] == pytest.approx(1.2, abs=0.02)


def test_a_box_without_a_mask_tells_no_depth():
    """It holds what lies behind as well, which bulges however flat the thing is."""
    depth, own = half_ball(0.12, (0.0, 0.0, 1.0))
    with_mask, _ = lift(depth, box_of(own), masks=[own])
    without, _ = lift(depth, box_of(own))
    surface_m = float(np.median(depth[own]))
    assert without.p_camera[0, 2] <= surface_m + 0.002
    assert with_mask.p_camera[0, 2] > surface_m + 0.01


def test_a_mask_that_ends_at_something_nearer_is_cut_there():
    """Less sure along the side that is hidden, and the extent is not taken for the whole."""
    depth, own = sheet(np.array([0.0, 0.0, 1.4]), (0.3, 0.2))
    pole = np.zeros_like(own)
    pole[:, 175:200] = True
    shown = own & ~pole & (np.arange(320) < 180)
    seen, _ = lift(nearer(depth, plane(CAMERA, 1.0), pole), box_of(shown), masks=[shown])
    plain, _ = lift(depth, box_of(own), masks=[own])
    assert seen.truncated[0].tolist() == [False, False, True, False]
    assert not plain.truncated.any()
    assert seen.cov_camera[0, 0, 0] > 4 * plain.cov_camera[0, 0, 0]
    assert squared_distance(seen, 0, np.array([0.0, 0.0, 1.4])) < 11.3


@pytest.mark.parametrize("width_px", [2, 4, 8, 14])
def test_a_broom_is_placed_though_it_fills_little_of_its_box(width_px):
    v, u = np.mgrid[:240, :320]
    broom = (np.abs(1.2 * (u - 75) - (v - 30)) <= 0.5 * width_px * np.hypot(1.2, 1.0)) & (v >= 30) & (v < 210)
    depth = nearer(plane(CAMERA, 2.0), plane(CAMERA, 1.5), broom)
    seen, warnings = lift(noisy(depth), box_of(broom), masks=[broom])
    assert len(seen) == 1
    assert warnings == ()
    assert seen.p_camera[0, 2] == pytest.approx(1.5, abs=0.02)
    found = seen.clouds[0]
    assert np.ptp(found[:, 0]) > 0.8 * 150 / 260 * 1.5
