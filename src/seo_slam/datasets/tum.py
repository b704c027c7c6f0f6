"""Recordings in the layout of the TUM RGB-D benchmark (Sturm et al., IROS 2012): rgb.txt, depth.txt, groundtruth.txt."""

from pathlib import Path

from seo_slam.camera import Camera
from seo_slam.datasets.camera_files import TUM_DEPTH_SCALE
from seo_slam.datasets.recording import Found, ImagePair, ReaderOptions, Recording, contents, require_folder
from seo_slam.datasets.stamps import ImageList, associate, nearest_difference_s, read_image_list
from seo_slam.errors import DatasetError

RGB_LIST, DEPTH_LIST = "rgb.txt", "depth.txt"
MAX_TIME_DIFFERENCE_S = 0.02


class TumDataset(Recording):
    """A TUM RGB-D folder.

    Colour and depth are associated by their stamps, nearest pairs first; the colour stamp is the frame's. Files that the lists name
    but that do not exist are counted in ``warnings`` and left out. Intrinsics: ``camera``, else ``camera_file``, else
    ``camera.json`` in the folder, else the published ones of freiburg1-3.
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
    ) -> None:
        """Open a folder.

        Args:
            path: the folder.
            camera: see ``ReaderOptions``.
            camera_file: see ``ReaderOptions``.
            max_time_difference_s: colour and depth farther apart than this do not belong together.
            stride: see ``ReaderOptions``.
            max_frames: see ``ReaderOptions``.
            depth_scale: see ``ReaderOptions``.
            trajectory_file: see ``ReaderOptions``.
            skip_broken: see ``ReaderOptions``.

        Raises:
            DatasetError: missing folder, list or images; a malformed list; no colour and depth within the time; no intrinsics; images
                of unequal size; damaged images, 8-bit depth; bad poses.
            ConfigError: an option out of range.
        """
        options = ReaderOptions(camera, camera_file, depth_scale, trajectory_file, stride, max_frames, skip_broken)
        folder = require_folder(path)
        super().__init__(folder, "tum", find_tum_images(folder, max_time_difference_s), options, default_depth_scale=TUM_DEPTH_SCALE)


def find_tum_images(folder: Path, max_time_difference_s: float = MAX_TIME_DIFFERENCE_S) -> Found:
    """Read both lists and pair what exists.

    Raises:
        DatasetError: a list is missing or malformed, none of its images exists, or no two belong together.
    """
    rgb, missing_rgb, rgb_note = listed_images(folder, RGB_LIST)
    depth, missing_depth, depth_note = listed_images(folder, DEPTH_LIST)
    pairs = _pair(folder, rgb, depth, max_time_difference_s)
    notes = [note for note in (rgb_note, depth_note) if note]
    if len(pairs) < len(rgb):
        notes.append(
            f"{len(rgb) - len(pairs)} of {len(rgb)} colour images have no depth image within "
            f"{1000 * max_time_difference_s:.0f} ms and are left out"
        )
    return Found(pairs, rgb.timestamps_s, tuple(notes), missing_rgb + missing_depth)


def listed_images(folder: Path, name: str) -> tuple[ImageList, tuple[Path, ...], str]:
    """Return the images of a list that exist, the files that do not, and a warning about those ("" if all do).

    Raises:
        DatasetError: the list is missing or malformed, or none of its images exists.
    """
    if not (folder / name).is_file():
        raise DatasetError(f"{folder}: no {name}; wanted the TUM layout (rgb.txt, depth.txt), found {contents(folder)}")
    listed = read_image_list(folder / name)
    present, missing = listed.present()
    if not len(present):
        raise DatasetError(f"{folder / name}: none of the {len(listed)} images it lists exists, for example {missing[0]}")
    note = f"{len(missing)} of the {len(listed)} images in {name} do not exist (first: {missing[0].name})" if missing else ""
    return present, missing, note


def _pair(folder: Path, rgb: ImageList, depth: ImageList, max_difference_s: float) -> tuple[ImagePair, ...]:
    rows = associate(rgb.timestamps_s, depth.timestamps_s, max_difference_s)
    if not len(rows):
        nearest_s = nearest_difference_s(rgb.timestamps_s, depth.timestamps_s)
        raise DatasetError(
            f"{folder}: no colour and depth image within {1000 * max_difference_s:.0f} ms of each other; the nearest are "
            f"{nearest_s:.3f} s apart (colour {rgb.timestamps_s[0]:.3f}..{rgb.timestamps_s[-1]:.3f} s, depth "
            f"{depth.timestamps_s[0]:.3f}..{depth.timestamps_s[-1]:.3f} s): are both stamped by the same clock?"
        )
    return tuple(
        ImagePair(float(rgb.timestamps_s[i]), rgb.files[i], depth.files[j], float(depth.timestamps_s[j]), index)
        for index, (i, j) in enumerate(rows)
    )
