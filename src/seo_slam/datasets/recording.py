"""What every recording on disk is: pairs of colour and depth images with a camera, read one frame at a time."""

import logging
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from seo_slam.camera import Camera
from seo_slam.datasets.camera_files import find_camera
from seo_slam.datasets.images import ImageHeader, read_depth, read_header, read_rgb, require_depth_header
from seo_slam.datasets.trajectory_files import GROUNDTRUTH_FILE, ODOMETRY_FILE, pick_trajectory, read_trajectory
from seo_slam.errors import ConfigError, DatasetError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.types import Frame

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ImagePair:
    """A colour image and the depth image that belongs to it.

    Attributes:
        timestamp_s: stamp of the colour image; it is the frame's stamp.
        rgb, depth: the files.
        depth_timestamp_s: stamp of the depth image.
        index: number of the pair in the whole recording, before ``stride``.
    """

    timestamp_s: float
    rgb: Path
    depth: Path
    depth_timestamp_s: float
    index: int


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a layout's search for images gives.

    Attributes:
        pairs: by rising stamp.
        stamps_s: (N,) of all colour images, paired or not.
        warnings, missing: as in ``Recording``.
        position_of_number: number in a colour image's name -> its row in ``stamps_s``; for pose files beside plain images.
    """

    pairs: tuple[ImagePair, ...]
    stamps_s: FloatArray
    warnings: tuple[str, ...] = ()
    missing: tuple[Path, ...] = ()
    position_of_number: Mapping[float, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class ReaderOptions:
    """Options that every reader takes.

    Attributes:
        camera: intrinsics; wins over every file.
        camera_file: a ``camera.json`` elsewhere; wins over the one in the folder.
        depth_scale: units of the depth images a metre; wins over every file.
        trajectory_file: poses to replay; wins over ``odometry.txt`` and ``groundtruth.txt``.
        stride: every how many-th pair is read.
        max_frames: at most so many.
        skip_broken: leave images that are damaged, of another size or no depth out, instead of refusing the recording.
    """

    camera: Camera | None = None
    camera_file: str | Path | None = None
    depth_scale: float | None = None
    trajectory_file: str | Path | None = None
    stride: int = 1
    max_frames: int | None = None
    skip_broken: bool = False

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise ConfigError(f"stride: got {self.stride}, wanted 1 or more")
        if self.max_frames is not None and self.max_frames < 1:
            raise ConfigError(f"max_frames: got {self.max_frames}, wanted 1 or more")
        if self.depth_scale is not None and not self.depth_scale > 0:
            raise ConfigError(f"depth_scale: got {self.depth_scale}, wanted above 0")


class Recording:
    """A recording: iterate over it, or ask for ``frame(i)``; only one frame is held in memory.

    Opening it looks at every list, every image's header and end, the intrinsics and the poses, so that a run fails before it has
    written anything. An image that turns out damaged only when it is decoded raises ``DatasetError`` while iterating, with
    ``skip_broken`` it is left out.

    Attributes:
        path: the folder.
        kind: "tum" or "folder".
        camera: intrinsics of the colour images.
        camera_source: where they come from, for the user.
        depth_scale: units of an integer depth image a metre.
        pairs: what will be read, by rising stamp.
        warnings: what is odd but no obstacle, for the user.
        missing: files that the recording names but does not have.
        groundtruth, odometry: the files, if they exist.
        trajectory: the poses to replay (see ``pick_trajectory``; else pose files), or None.
    """

    def __init__(
        self,
        path: Path,
        kind: str,
        found: Found,
        options: ReaderOptions,
        *,
        default_depth_scale: float | None = None,
        pose_files: Trajectory | None = None,
    ) -> None:
        """Readers call this with what they found.

        Raises:
            DatasetError: no intrinsics, bad images or bad poses.
        """
        self.path, self.kind, self.missing = path, kind, found.missing
        if options.camera is None:
            self.camera, scale, self.camera_source = find_camera(path, options.camera_file)
        else:
            self.camera, scale, self.camera_source = options.camera, None, "given"
        self._scale = options.depth_scale or scale or default_depth_scale
        self._skip_broken = options.skip_broken
        selected = found.pairs[:: options.stride][: options.max_frames]
        self.pairs, broken = self._sound(selected)
        self.groundtruth, self.odometry = _if_file(path / GROUNDTRUTH_FILE), _if_file(path / ODOMETRY_FILE)
        poses_file = pick_trajectory(path, options.trajectory_file)
        self.trajectory = read_trajectory(poses_file) if poses_file else pose_files
        self.warnings = (*found.warnings, *broken, *self._uncovered())
        for warning in self.warnings:
            logger.info("%s: %s", path, warning)

    @property
    def depth_scale(self) -> float:
        """Units of an integer depth image a metre; 1 where all depth is stored in metres."""
        return self._scale or 1.0

    def __len__(self) -> int:
        return len(self.pairs)

    def __iter__(self) -> Iterator[Frame]:
        for i in range(len(self.pairs)):
            try:
                frame = self.frame(i)
            except DatasetError as error:
                if not self._skip_broken:
                    raise
                logger.warning("left out: %s", error)
                continue
            yield frame

    def frame(self, i: int) -> Frame:
        """Read the ``i``-th frame.

        Raises:
            DatasetError: names frame and file of an image that is damaged or of another size.
        """
        pair = self.pairs[i]
        try:
            rgb, depth_m = read_rgb(pair.rgb), read_depth(pair.depth, self.depth_scale)
            if depth_m.shape != rgb.shape[:2]:
                raise DatasetError(f"{pair.depth}: size {depth_m.shape[::-1]} differs from {pair.rgb}: {rgb.shape[1::-1]}")
            return Frame(timestamp_s=pair.timestamp_s, rgb=rgb, depth_m=depth_m, camera=self.camera, index=pair.index)
        except (DatasetError, FrameError) as error:
            raise DatasetError(f"frame {pair.index} (t={pair.timestamp_s:.6f}): {error}") from None

    def _sound(self, pairs: tuple[ImagePair, ...]) -> tuple[tuple[ImagePair, ...], tuple[str, ...]]:
        """Return the pairs whose headers are right, and warnings about the others."""
        kept, faults = [], []
        for pair in pairs:
            try:
                check_pair(pair, self.camera, self.camera_source, self._scale)
                kept.append(pair)
            except DatasetError as error:
                if not self._skip_broken:
                    raise DatasetError(f"frame {pair.index}: {error} (open with skip_broken to leave out images like this)") from None
                faults.append(str(error))
        if not kept:
            raise DatasetError(f"{self.path}: none of {len(pairs)} image pairs can be used; the first: {faults[0]}")
        if not faults:
            return tuple(kept), ()
        return tuple(kept), (f"{len(faults)} of {len(pairs)} image pairs are left out as damaged; the first: {faults[0]}",)

    def _uncovered(self) -> tuple[str, ...]:
        if self.trajectory is None:
            return ()
        stamps_s = np.array([pair.timestamp_s for pair in self.pairs])
        first_s, last_s = self.trajectory.timestamps_s[[0, -1]]
        outside = int(((stamps_s < first_s) | (stamps_s > last_s)).sum())
        if not outside:
            return ()
        return (
            f"{outside} of {len(stamps_s)} frames lie outside the poses (frames {stamps_s[0]:.3f}..{stamps_s[-1]:.3f} s, "
            f"poses {first_s:.3f}..{last_s:.3f} s)",
        )


def check_pair(pair: ImagePair, camera: Camera, camera_source: str, depth_scale: float | None) -> None:
    """Check headers and ends of the files of a pair.

    Raises:
        DatasetError: damaged, of another size than the camera, no depth, or integer depth without a scale.
    """
    rgb, depth = read_header(pair.rgb), read_header(pair.depth)
    require_depth_header(pair.depth, depth)
    if not depth.floating and depth_scale is None:
        raise DatasetError(
            f"{pair.depth}: integer depth, but no depth_scale: write it into camera.json (1000 for millimetres, 5000 for TUM)"
        )
    _require_size(pair.rgb, rgb, camera, f"the camera's ({camera_source})")
    _require_size(pair.depth, depth, camera, "the colour image's; register depth to colour first")


def _require_size(path: Path, header: ImageHeader, camera: Camera, whose: str) -> None:
    if (header.width, header.height) != (camera.width, camera.height):
        raise DatasetError(f"{path}: is {header.width}x{header.height}, wanted {camera.width}x{camera.height}, {whose}")


def _if_file(path: Path) -> Path | None:
    return path if path.is_file() else None


def require_folder(path: str | Path) -> Path:
    """Return ``path`` if it is a folder.

    Raises:
        DatasetError: it is not; the message says what is there.
    """
    folder = Path(path)
    if not folder.exists():
        raise DatasetError(f"{folder}: no such folder")
    if not folder.is_dir():
        raise DatasetError(f"{folder}: is a file, wanted the folder of a recording")
    if not os.access(folder, os.R_OK | os.X_OK):
        raise DatasetError(f"{folder}: may not be read (permissions)")
    return folder


def contents(folder: Path, most: int = 10) -> str:
    """Names in a folder, for messages: "rgb/, depth/, notes.txt"."""
    names = sorted(entry.name + ("/" if entry.is_dir() else "") for entry in folder.iterdir())
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "") if names else "nothing"
