"""clouds.ply: what is written is read, and a damaged file is never taken for a map."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from seo_slam.errors import MapError, MapFormatError
from seo_slam.map_clouds import read_clouds, write_clouds

CLOUDS = {7: np.arange(12.0).reshape(4, 3) / 8, 3: np.array([[0.1, -2.0, 1e-3]]), 5: np.zeros((0, 3))}


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "clouds.ply"
    write_clouds(path, CLOUDS)
    clouds = read_clouds(path)
    assert list(clouds) == [3, 7]
    np.testing.assert_array_equal(clouds[7], CLOUDS[7])
    np.testing.assert_allclose(clouds[3], CLOUDS[3], rtol=1e-7)
    first = path.read_bytes()
    write_clouds(path, dict(reversed(CLOUDS.items())))
    assert path.read_bytes() == first


def test_a_map_without_points(tmp_path):
    write_clouds(tmp_path / "clouds.ply", {})
    assert read_clouds(tmp_path / "clouds.ply") == {}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("map") / "clouds.ply"
    write_clouds(path, CLOUDS)
    return path, path.read_bytes()


@settings(deadline=None)
@given(where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
@example(where=0.9375, bit=6)  # a number becomes a signalling NaN
def test_any_flipped_bit_of_the_points_is_noticed(written, where, bit):
    path, data = written[0], bytearray(written[1])
    start = data.index(b"end_header\n") + len(b"end_header\n")
    data[start + int(where * (len(data) - start))] ^= 1 << bit
    path.write_bytes(data)
    with pytest.raises(MapFormatError, match=r"clouds\.ply"):
        read_clouds(path)


@settings(deadline=None)
@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_cut_off_anywhere_is_noticed(written, share):
    path, data = written
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(MapFormatError, match=r"clouds\.ply"):
        read_clouds(path)


def test_a_file_that_a_viewer_saved_is_read(tmp_path):
    path = tmp_path / "clouds.ply"
    vertices = "".join(f"property double {axis}\n" for axis in "xyz") + "property uchar red\nproperty int landmark\n"
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 2\n{vertices}end_header\n1 2 3 255 4\n5 6 7 0 2\n")
    clouds = read_clouds(path)
    assert {i: points.tolist() for i, points in clouds.items()} == {2: [[5, 6, 7]], 4: [[1, 2, 3]]}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("property int landmark", "property int thing", "no landmark"),
        ("property int landmark", "property float landmark", "whole numbers"),
        ("1 2 3 4", "1 2 3 -4", "whole numbers"),
        ("1 2 3 4", "1 nan 3 4", "point 0 is not finite"),
    ],
)
def test_what_is_no_file_of_clouds_is_refused(tmp_path, old, new, message):
    path = tmp_path / "clouds.ply"
    vertices = "".join(f"property float {axis}\n" for axis in "xyz") + "property int landmark\n"
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 1\n{vertices}end_header\n1 2 3 4\n".replace(old, new))
    with pytest.raises(MapFormatError, match=message):
        read_clouds(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(MapFormatError, match=r"none\.ply"):
        read_clouds(tmp_path / "none.ply")


@pytest.mark.parametrize("clouds", [{1: np.zeros((2, 2))}, {1: np.full((1, 3), np.inf)}, {-1: np.zeros((1, 3))}, {2**31: np.zeros((1, 3))}])
def test_what_cannot_be_written_is_refused(tmp_path, clouds):
    with pytest.raises(MapError):
        write_clouds(tmp_path / "clouds.ply", clouds)
    assert not (tmp_path / "clouds.ply").exists()
