"""Image lists (``rgb.txt``, ``depth.txt``) and the association of two streams by their stamps."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from seo_slam.datasets.text_files import read_fields, to_number
from seo_slam.errors import DatasetError
from seo_slam.geometry import FloatArray
from seo_slam.types import IntArray


@dataclass(frozen=True, slots=True, eq=False)
class ImageList:
    """Images with stamps.

    Attributes:
        timestamps_s: (N,), strictly rising.
        files: N paths.
    """

    timestamps_s: FloatArray
    files: tuple[Path, ...]

    def __len__(self) -> int:
        return len(self.files)

    def present(self) -> tuple["ImageList", tuple[Path, ...]]:
        """Split into the images that exist and the files that do not."""
        exists = [file.is_file() for file in self.files]
        kept = tuple(file for file, here in zip(self.files, exists, strict=True) if here)
        missing = tuple(file for file, here in zip(self.files, exists, strict=True) if not here)
        return ImageList(self.timestamps_s[np.array(exists, dtype=np.bool_)], kept), missing


def read_image_list(path: Path) -> ImageList:
    """Read a list of ``timestamp filename`` lines; file names are relative to the list's folder.

    Raises:
        DatasetError: names file and line of a malformed line or of a stamp that repeats or goes backwards; or the list is
            missing or empty.
    """
    stamps_s: list[float] = []
    files: list[Path] = []
    for number, fields in read_fields(path):
        where = f"{path}:{number}"
        if len(fields) != 2:
            raise DatasetError(f"{where}: got {len(fields)} columns, wanted 2 (timestamp filename)")
        stamp_s = to_number(fields[0], where)
        if stamps_s and stamp_s <= stamps_s[-1]:
            what = "repeats" if stamp_s == stamps_s[-1] else "goes backwards"
            raise DatasetError(f"{where}: the stamp {what}: {stamp_s:.6f} after {stamps_s[-1]:.6f} s; wanted rising stamps")
        stamps_s.append(stamp_s)
        files.append(path.parent / fields[1])
    if not files:
        raise DatasetError(f"{path}: lists no images; wanted lines of: timestamp filename")
    return ImageList(np.array(stamps_s), tuple(files))


def associate(first_s: FloatArray, second_s: FloatArray, max_difference_s: float) -> IntArray:
    """Pair two rising lists of stamps, the nearest pairs first, each stamp at most once (as the TUM benchmark does).

    Args:
        first_s: (N,) stamps.
        second_s: (M,) stamps.
        max_difference_s: pairs must be nearer than this.

    Returns:
        (P, 2) indices into both, by rising first stamp.
    """
    low = np.searchsorted(second_s, first_s - max_difference_s, side="left")
    high = np.searchsorted(second_s, first_s + max_difference_s, side="right")
    counts = high - low
    i = np.repeat(np.arange(len(first_s)), counts)
    j = np.arange(len(i)) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(low, counts)
    difference_s = np.abs(first_s[i] - second_s[j])
    free_first, free_second = np.ones(len(first_s), dtype=bool), np.ones(len(second_s), dtype=bool)
    pairs = []
    for k in np.argsort(difference_s, kind="stable"):
        if free_first[i[k]] and free_second[j[k]] and difference_s[k] < max_difference_s:
            free_first[i[k]] = free_second[j[k]] = False
            pairs.append((int(i[k]), int(j[k])))
    return np.array(sorted(pairs), dtype=np.int64).reshape(-1, 2)


def nearest_difference_s(first_s: FloatArray, second_s: FloatArray) -> float:
    """The smallest time between any stamp of one list and any of the other; infinity if one is empty."""
    if not len(first_s) or not len(second_s):
        return float("inf")
    after = np.clip(np.searchsorted(second_s, first_s), 0, len(second_s) - 1)
    before = np.clip(after - 1, 0, None)
    return float(np.minimum(np.abs(second_s[after] - first_s), np.abs(second_s[before] - first_s)).min())
