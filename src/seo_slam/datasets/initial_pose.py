"""The pose of a first camera, as a user writes it."""

from pathlib import Path

import numpy as np

from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import FloatArray, require_transform, rotation_from_quaternion


def read_initial_pose(text_or_file: str) -> FloatArray:
    """Return ``T_world_camera`` (4, 4).

    Args:
        text_or_file: seven numbers ``tx ty tz qx qy qz qw`` as in TUM files, sixteen numbers of a 4x4 matrix by rows, or a file
            that holds either.

    Raises:
        ConfigError: it is neither, or no rigid transform.
    """
    text = text_or_file
    try:
        if Path(text_or_file).is_file():
            text = Path(text_or_file).read_text(encoding="utf-8")
    except OSError:
        pass  # too long for a file name: it is the numbers themselves
    except UnicodeDecodeError as error:
        raise ConfigError(f"initial pose: {text_or_file}: not a text file: {error.reason} at byte {error.start}") from error
    try:
        numbers = np.array([float(field) for field in text.replace(",", " ").split()])
        if len(numbers) == 16:
            return require_transform(numbers.reshape(4, 4), "initial pose")
        if len(numbers) == 7:
            T = np.eye(4)
            T[:3, :3] = rotation_from_quaternion(numbers[[6, 3, 4, 5]])
            T[:3, 3] = numbers[:3]
            return require_transform(T, "initial pose")
    except FrameError as error:
        raise ConfigError(f"initial pose: {error}") from error
    except ValueError as error:
        raise ConfigError(f"initial pose: {text_or_file!r:.80} is neither a file that is there nor numbers: {error}") from error
    raise ConfigError(f"initial pose: got {len(numbers)} numbers, wanted 7 (tx ty tz qx qy qz qw) or 16 (a 4x4 matrix), or a file")
