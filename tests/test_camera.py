import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.camera import Camera
from seo_slam.errors import FrameError

FREIBURG = {
    "fr1": Camera(517.3, 516.5, 318.6, 255.3, 640, 480, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "fr2": Camera(520.9, 521.0, 325.1, 249.7, 640, 480, (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "fr3": Camera(535.4, 539.2, 320.1, 247.6, 640, 480),
    "wide": Camera(300.0, 300.0, 320.0, 240.0, 640, 480, (-0.28, 0.07, 0.001, -0.002, 0.0)),
}


def pixels(camera: Camera) -> np.ndarray:
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([u, v], axis=-1).astype(float)


@pytest.mark.parametrize("camera", FREIBURG.values(), ids=FREIBURG)
def test_project_undoes_undistort_at_every_pixel(camera):
    rays = camera.rays()
    points = np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)
    assert np.abs(camera.project(points) - pixels(camera)).max() < 1e-6


@pytest.mark.parametrize("camera", FREIBURG.values(), ids=FREIBURG)
@settings(max_examples=50, deadline=None)
@given(u=st.floats(0, 639), v=st.floats(0, 479), depth=st.floats(0.1, 20))
def test_back_project_undoes_project(camera, u, v, depth):
    point = camera.back_project([u, v], depth)
    assert point[2] == depth
    np.testing.assert_allclose(camera.project(point), [u, v], atol=1e-6)


def test_distortion_is_that_of_opencv():
    camera = FREIBURG["fr1"]
    points = np.random.default_rng(0).uniform([-0.5, -0.4, 1], [0.5, 0.4, 3], (200, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(camera.distortion))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)


def test_a_distortion_that_folds_gives_finite_rays():
    rays = Camera(300.0, 300.0, 320.0, 240.0, 640, 480, (-0.4, 0.0, 0.0, 0.0, 0.0)).rays()
    assert np.isfinite(rays).all()


def test_points_behind_the_camera_project_to_nan():
    projected = FREIBURG["fr1"].project([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.isnan(projected[:2]).all()
    np.testing.assert_allclose(projected[2], [318.6, 255.3])


def test_no_pixels_are_no_rays():
    assert FREIBURG["fr1"].undistort(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": np.nan}, "NaN"),
        ({"fy": 0.0}, "above 0"),
        ({"width": 0}, "above 0"),
        ({"distortion": (0.1, 0.2)}, "distortion"),
    ],
)
def test_bad_intrinsics_are_refused(change, message):
    values = {"fx": 500.0, "fy": 500.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480} | change
    with pytest.raises(FrameError, match=message):
        Camera(**values)
