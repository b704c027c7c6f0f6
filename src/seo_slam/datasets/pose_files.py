"""Poses beside plain images: one 4x4 text file a frame, or one row of 16 or 12 numbers a frame. All are ``T_world_camera``."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from seo_slam.datasets.images import name_number
from seo_slam.datasets.text_files import read_numbers
from seo_slam.errors import DatasetError, FrameError
from seo_slam.geometry import FloatArray, require_transform
from seo_slam.records import Trajectory

POSE_FOLDERS = ("pose", "poses")
POSES_FILE = "poses.txt"


def read_folder_poses(folder: Path, position_of_number: Mapping[float, int], stamps_s: FloatArray) -> Trajectory | None:
    """Read ``pose/``, ``poses/`` or ``poses.txt``; None if there is none.

    Args:
        folder: the recording.
        position_of_number: number in a colour image's name -> its position in the recording.
        stamps_s: (N,) stamps of the colour images.

    Raises:
        DatasetError: names the file (and line) of what is not a pose, or says how many poses were wanted.
    """
    for name in POSE_FOLDERS:
        if (folder / name).is_dir():
            return _one_file_a_pose(folder / name, position_of_number, stamps_s)
    file = folder / POSES_FILE
    return _one_row_a_pose(file, stamps_s) if file.is_file() else None


def _one_file_a_pose(folder: Path, position_of_number: Mapping[float, int], stamps_s: FloatArray) -> Trajectory:
    poses: dict[int, FloatArray] = {}
    for file in sorted(folder.glob("*.txt")):
        number = name_number(file)
        position = position_of_number.get(float(number)) if number else None
        if position is None:
            continue
        rows, _ = read_numbers(file, (4,), "4 rows of 4 numbers, T_world_camera")
        if rows.shape != (4, 4):
            raise DatasetError(f"{file}: got {rows.shape[0]} rows, wanted 4 rows of 4 numbers, T_world_camera")
        poses[position] = _pose(rows, str(file))
    if not poses:
        raise DatasetError(f"{folder}: holds no pose file (*.txt) with the number or stamp of a colour image")
    positions = sorted(poses)
    return Trajectory(timestamps_s=stamps_s[positions], T_world_camera=np.array([poses[i] for i in positions]))


def _one_row_a_pose(file: Path, stamps_s: FloatArray) -> Trajectory:
    rows, lines = read_numbers(file, (16, 12), "T_world_camera by rows; name a file of stamps and quaternions groundtruth.txt")
    if len(rows) != len(stamps_s):
        raise DatasetError(f"{file}: holds {len(rows)} poses, wanted {len(stamps_s)}, one a colour image")
    if rows.shape[1] == 12:
        rows = np.hstack([rows, np.tile([0.0, 0.0, 0.0, 1.0], (len(rows), 1))])
    poses = [_pose(row.reshape(4, 4), f"{file}:{line}") for row, line in zip(rows, lines, strict=True)]
    return Trajectory(timestamps_s=stamps_s, T_world_camera=np.array(poses))


def _pose(M: FloatArray, where: str) -> FloatArray:
    try:
        return require_transform(M, "T_world_camera")
    except FrameError as error:
        raise DatasetError(f"{where}: {error}") from None
