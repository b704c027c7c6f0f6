"""A folder of plain images: rgb/, depth/ and poses, named by stamp or by number."""

from pathlib import Path

import numpy as np

from seo_slam.camera import Camera
from seo_slam.datasets.images import DEPTH_SUFFIXES, IMAGE_SUFFIXES, name_number
from seo_slam.datasets.pose_files import read_folder_poses
from seo_slam.datasets.recording import Found, ImagePair, ReaderOptions, Recording, contents, require_folder
from seo_slam.datasets.stamps import associate, nearest_difference_s
from seo_slam.datasets.text_files import read_numbers
from seo_slam.datasets.tum import MAX_TIME_DIFFERENCE_S
from seo_slam.errors import ConfigError, DatasetError
from seo_slam.geometry import FloatArray

RGB_FOLDERS = ("rgb", "color", "colour", "images", "image")
DEPTH_FOLDERS = ("depth", "depths")
DEFAULT_FPS = 30.0
STAMPS_FILE = "timestamps.txt"
_STAMP_DIGITS = {13: 1e3, 16: 1e6, 19: 1e9}  # whole numbers of today's dates in ms, us and ns


class FolderDataset(Recording):
    """Images in ``rgb/`` and ``depth/``, poses in ``pose/``, ``poses.txt`` or ``groundtruth.txt``; ``camera.json`` beside them.

    Names are stamps (seconds with a fraction, or whole milli-, micro- or nanoseconds), or numbers. For numbers the stamps come from
    ``timestamps.txt`` (seconds, one a line, one a colour image), else from ``fps``.
    """

    def __init__(
        self,
        path: str | Path,
        camera: Camera | None = None,
        camera_file: str | Path | None = None,
        max_time_difference_s: float = MAX_TIME_DIFFERENCE_S,
        stride: int = 1,
        max_frames: int | None = None,
        depth_scale: float | None = None,
        trajectory_file: str | Path | None = None,
        skip_broken: bool = False,
        fps: float | None = None,
    ) -> None:
        """Open a folder.

        Args:
            path: the folder.
            camera: see ``ReaderOptions``.
            camera_file: see ``ReaderOptions``.
            max_time_difference_s: colour and depth named by stamps farther apart than this do not belong together.
            stride: see ``ReaderOptions``.
            max_frames: see ``ReaderOptions``.
            depth_scale: see ``ReaderOptions``.
            trajectory_file: see ``ReaderOptions``.
            skip_broken: see ``ReaderOptions``.
            fps: images a second, where names are numbers.

        Raises:
            DatasetError: missing folders or images; no pairs; no intrinsics; images of unequal size; damaged images, 8-bit depth;
                bad poses.
            ConfigError: an option out of range.
        """
        if fps is not None and not fps > 0:
            raise ConfigError(f"fps: got {fps}, wanted above 0")
        options = ReaderOptions(camera, camera_file, depth_scale, trajectory_file, stride, max_frames, skip_broken)
        folder = require_folder(path)
        found = find_folder_images(folder, max_time_difference_s, fps)
        poses = read_folder_poses(folder, found.position_of_number, found.stamps_s)
        super().__init__(folder, "folder", found, options, pose_files=poses)


def find_folder_images(folder: Path, max_time_difference_s: float = MAX_TIME_DIFFERENCE_S, fps: float | None = None) -> Found:
    """List both image folders and pair what belongs together.

    Raises:
        DatasetError: a folder is missing or empty, a name holds no number, or no two images belong together.
    """
    rgb = _numbered(_image_folder(folder, RGB_FOLDERS), IMAGE_SUFFIXES)
    depth = _numbered(_image_folder(folder, DEPTH_FOLDERS), DEPTH_SUFFIXES)
    units = _stamp_units([*rgb, *depth])
    notes: tuple[str, ...] = ()
    if units is not None:
        stamps_s = np.array([float(name) / units for name in rgb])
        pairs = _pairs_by_stamp(folder, rgb, depth, units, max_time_difference_s)
    else:
        stamps_s, notes = _stamps_of_numbers(folder, rgb, fps)
        pairs = _pairs_by_number(folder, rgb, depth, stamps_s)
    if len(pairs) < len(rgb):
        notes += (f"{len(rgb) - len(pairs)} of {len(rgb)} colour images have no depth image and are left out",)
    return Found(pairs, stamps_s, notes, position_of_number={float(name): i for i, name in enumerate(rgb)})


def _image_folder(folder: Path, names: tuple[str, ...]) -> Path:
    for name in names:
        if (folder / name).is_dir():
            return folder / name
    raise DatasetError(f"{folder}: no folder {' or '.join(f'{name}/' for name in names)}; found {contents(folder)}")


def _numbered(folder: Path, suffixes: tuple[str, ...]) -> dict[str, Path]:
    """Images by the number in their names, by rising number."""
    found: dict[str, Path] = {}
    numbers: dict[float, Path] = {}
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in suffixes:
            continue
        number = name_number(file)
        if number is None:
            raise DatasetError(f"{file}: its name holds no number; wanted a stamp or a running number")
        if float(number) in numbers:
            raise DatasetError(f"{file}: has the same number or stamp as {numbers[float(number)].name}")
        found[number] = numbers[float(number)] = file
    if not found:
        raise DatasetError(f"{folder}: holds no images ({', '.join(suffixes)}); found {contents(folder)}")
    return dict(sorted(found.items(), key=lambda item: float(item[0])))


def _stamp_units(names: list[str]) -> float | None:
    """Units of the names a second if they are stamps, None if they are running numbers."""
    if all("." in name for name in names):
        return 1.0
    lengths = {len(name) for name in names}
    return _STAMP_DIGITS.get(lengths.pop()) if len(lengths) == 1 else None


def _stamps_of_numbers(folder: Path, rgb: dict[str, Path], fps: float | None) -> tuple[FloatArray, tuple[str, ...]]:
    file = folder / STAMPS_FILE
    if file.is_file():
        rows, lines = read_numbers(file, (1,), "seconds")
        if len(rows) != len(rgb):
            raise DatasetError(f"{file}: holds {len(rows)} stamps, wanted {len(rgb)}, one a colour image")
        backwards = np.flatnonzero(np.diff(rows[:, 0]) <= 0)
        if len(backwards):
            raise DatasetError(f"{file}:{lines[int(backwards[0]) + 1]}: the stamp repeats or goes backwards; wanted rising stamps")
        return rows[:, 0], ()
    numbers = np.array([float(name) for name in rgb])
    notes = () if fps else (f"no stamps in names and no {STAMPS_FILE}: taken as {DEFAULT_FPS:g} images a second (option fps)",)
    return (numbers - numbers[0]) / (fps or DEFAULT_FPS), notes


def _pairs_by_stamp(
    folder: Path, rgb: dict[str, Path], depth: dict[str, Path], units: float, max_difference_s: float
) -> tuple[ImagePair, ...]:
    rgb_s, depth_s = (np.array([float(name) / units for name in names]) for names in (rgb, depth))
    rows = associate(rgb_s, depth_s, max_difference_s)
    if not len(rows):
        raise DatasetError(
            f"{folder}: no colour and depth image within {1000 * max_difference_s:.0f} ms of each other; the nearest are "
            f"{nearest_difference_s(rgb_s, depth_s):.3f} s apart"
        )
    rgb_files, depth_files = list(rgb.values()), list(depth.values())
    return tuple(ImagePair(float(rgb_s[i]), rgb_files[i], depth_files[j], float(depth_s[j]), index) for index, (i, j) in enumerate(rows))


def _pairs_by_number(folder: Path, rgb: dict[str, Path], depth: dict[str, Path], stamps_s: FloatArray) -> tuple[ImagePair, ...]:
    depth_of = {float(name): file for name, file in depth.items()}
    common = [(i, float(name), file) for i, (name, file) in enumerate(rgb.items()) if float(name) in depth_of]
    if not common:
        raise DatasetError(
            f"{folder}: no colour and depth image with the same number (colour {next(iter(rgb))}..{list(rgb)[-1]}, "
            f"depth {next(iter(depth))}..{list(depth)[-1]})"
        )
    return tuple(
        ImagePair(float(stamps_s[i]), file, depth_of[number], float(stamps_s[i]), index) for index, (i, number, file) in enumerate(common)
    )
