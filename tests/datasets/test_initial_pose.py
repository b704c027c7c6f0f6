"""The pose of a first camera: numbers as users have them, or a file with them."""

import numpy as np
import pytest

from seo_slam.datasets.initial_pose import read_initial_pose
from seo_slam.errors import ConfigError
from seo_slam.geometry import exp, quaternion_from_rotation

T = exp([0.3, -0.5, 0.8, 1.0, -2.0, 0.5])
w, x, y, z = quaternion_from_rotation(T[:3, :3])
SEVEN = " ".join(repr(float(v)) for v in (*T[:3, 3], x, y, z, w))
SIXTEEN = " ".join(repr(float(v)) for v in T.ravel())


@pytest.mark.parametrize("text", [SEVEN, SIXTEEN, SEVEN.replace(" ", ","), SIXTEEN.replace(" ", ", "), f"\n{SEVEN}\n"])
def test_seven_or_sixteen_numbers(text, tmp_path):
    np.testing.assert_allclose(read_initial_pose(text), T, atol=1e-9)
    (tmp_path / "pose.txt").write_text(text)
    np.testing.assert_allclose(read_initial_pose(str(tmp_path / "pose.txt")), T, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("pose.txt", "'pose.txt' is neither a file"),
        ("1 2 3", "got 3 numbers, wanted 7"),
        ("", "got 0 numbers"),
        ("0 0 0 0 0 0 0", "quaternion"),
        ("nan 0 0 0 0 0 1", "initial pose"),
        (" ".join(["2.0"] * 16), "rotation|bottom|last row"),
        ("1 2 x 0 0 0 1", "neither a file that is there nor numbers"),
        ("0" * 5000, "numbers"),
    ],
)
def test_anything_else_is_refused_with_what_was_wanted(text, words):
    with pytest.raises(ConfigError, match=words):
        read_initial_pose(text)


def test_a_binary_file_is_refused(tmp_path):
    (tmp_path / "pose").write_bytes(bytes(range(256)))
    with pytest.raises(ConfigError, match="initial pose"):
        read_initial_pose(str(tmp_path / "pose"))
