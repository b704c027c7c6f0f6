"""What is this recording, and is it sane? Reports every problem it can see instead of stopping at the first."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from seo_slam.camera import Camera
from seo_slam.datasets.camera_files import TUM_DEPTH_SCALE, find_camera
from seo_slam.datasets.check_camera import check_camera
from seo_slam.datasets.check_images import Facts, check_alignment, check_depth, check_files, check_stamps
from seo_slam.datasets.check_poses import check_agreement, check_coverage, check_jumps
from seo_slam.datasets.findings import Finding, RecordingReport, error, ok, warning
from seo_slam.datasets.folder import find_folder_images
from seo_slam.datasets.images import read_depth, read_header, read_rgb
from seo_slam.datasets.open import KINDS, detect_kind
from seo_slam.datasets.pose_files import read_folder_poses
from seo_slam.datasets.recording import Found, contents, require_folder
from seo_slam.datasets.trajectory_files import pick_trajectory, read_trajectory
from seo_slam.datasets.tum import DEPTH_LIST, RGB_LIST, find_tum_images, listed_images
from seo_slam.errors import ConfigError, DatasetError, FrameError
from seo_slam.records import Trajectory
from seo_slam.types import Frame

Value = TypeVar("Value")
_SAMPLES = 20


@dataclass(slots=True)
class _Look:
    """What is known so far of a recording under examination."""

    folder: Path
    kind: str
    camera_file: Path | None
    camera: Camera | None = None
    camera_source: str = ""
    scale: float | None = None
    found: Found | None = None
    trajectory: Trajectory | None = None
    findings: list[Finding] = field(default_factory=list)
    facts: Facts = field(default_factory=dict)

    def attempt(self, topic: str, fix: str, action: Callable[[], Value]) -> Value | None:
        """Return what ``action`` gives; a failure of it becomes a finding."""
        try:
            return action()
        except (DatasetError, FrameError) as fault:
            self.findings.append(error(topic, str(fault), fix))
            return None

    def frame(self, i: int) -> Frame | None:
        """Read a frame; a failure becomes a finding."""
        return self.attempt("images", "remove the file, or record it again", lambda: self._read(i))

    def _read(self, i: int) -> Frame:
        if self.found is None or self.camera is None:
            raise DatasetError(f"{self.folder}: no images or no intrinsics")
        pair = self.found.pairs[i]
        depth_m = read_depth(pair.depth, self.scale or 1.0)
        return Frame(pair.timestamp_s, read_rgb(pair.rgb), depth_m, self.camera, pair.index)


class RecordingCheck:
    """A check in stages, so that a caller can show progress: call each of ``stages`` in order, then ``report``."""

    def __init__(
        self,
        path: str | Path,
        kind: str = "auto",
        camera_file: str | Path | None = None,
        trajectory_file: str | Path | None = None,
    ) -> None:
        """Arguments and errors are those of ``check_recording``."""
        if kind not in KINDS:
            raise ConfigError(f"unknown kind of recording {kind!r} (known: {', '.join(KINDS)})")
        self._path, self._look = path, _Look(Path(path), kind, Path(camera_file) if camera_file else None)
        looks = (
            _look_at_lists,
            _look_at_camera,
            partial(_look_at_poses_file, trajectory_file=trajectory_file),
            _look_at_files,
            _look_at_pixels,
            _look_at_motion,
        )
        self.stages: tuple[Callable[[], None], ...] = (
            partial(_look_at_layout, self._look),
            *(partial(_if_known, self._look, look) for look in looks),
        )

    def report(self) -> RecordingReport:
        """What the stages found."""
        look = self._look
        return RecordingReport(path=str(self._path), kind=look.kind, findings=tuple(look.findings), facts=look.facts)


def check_recording(
    path: str | Path,
    kind: str = "auto",
    camera_file: str | Path | None = None,
    trajectory_file: str | Path | None = None,
) -> RecordingReport:
    """Look at a recording: layout, stamps, files, intrinsics, depth, alignment, poses.

    Pixels of some 20 frames are read, headers of all. A folder that is broken gives findings, not exceptions.

    Args:
        path: the folder.
        kind: "tum", "folder" or "auto".
        camera_file: intrinsics elsewhere than in the folder.
        trajectory_file: poses elsewhere than in the folder.

    Raises:
        ConfigError: unknown ``kind``.
    """
    check = RecordingCheck(path, kind, camera_file, trajectory_file)
    for stage in check.stages:
        stage()
    return check.report()


def _look_at_layout(look: _Look) -> None:
    fix = "give the folder that holds rgb.txt and depth.txt, or rgb/ and depth/; see docs/recordings.md"
    look.kind = look.attempt("layout", fix, partial(_layout, look.folder, look.kind)) or "unknown"
    if look.kind != "unknown":
        look.findings.append(ok("layout", f"kind {look.kind}: {contents(look.folder)}"))


def _if_known(look: _Look, action: Callable[[_Look], None]) -> None:
    if look.kind != "unknown":
        action(look)


def _layout(folder: Path, kind: str) -> str:
    require_folder(folder)
    return detect_kind(folder) if kind == "auto" else kind


def _look_at_lists(look: _Look) -> None:
    fix = "correct the line or file named; both lists hold lines of: timestamp filename, rising stamps, one clock"
    if look.kind == "folder":
        look.found = look.attempt("images", "see docs/recordings.md, plain folders", lambda: find_folder_images(look.folder))
    else:
        listed = [look.attempt("images", fix, partial(listed_images, look.folder, name)) for name in (RGB_LIST, DEPTH_LIST)]
        if None not in listed:
            look.found = look.attempt("images", fix, lambda: find_tum_images(look.folder))
    if look.found is None:
        return
    look.facts["missing_files"] = len(look.found.missing)
    for note in look.found.warnings:
        look.findings.append(warning("images", note, "fine if you meant it; else copy the missing files or correct the stamps"))
    look.findings += check_stamps(look.found.pairs, look.facts)


def _look_at_camera(look: _Look) -> None:
    intrinsics = look.attempt("camera", "write camera.json", lambda: find_camera(look.folder, look.camera_file))
    size = None
    if look.found is not None:
        first = look.found.pairs[0].rgb
        header = look.attempt("images", "record it again", lambda: read_header(first))
        size = (header.width, header.height) if header else None
    look.facts["image_size_px"] = f"{size[0]}x{size[1]}" if size else None
    look.scale = TUM_DEPTH_SCALE if look.kind == "tum" else None
    if intrinsics is not None:
        camera, scale, look.camera_source = intrinsics
        look.scale = scale or look.scale
        look.findings += check_camera(camera, look.camera_source, size)
        if size in (None, (camera.width, camera.height)):
            look.camera = camera
    if look.camera is None and size is not None:  # so that the other checks can go on
        f = 0.9 * size[0]
        look.camera, look.camera_source = Camera(f, f, size[0] / 2, size[1] / 2, *size), "a guess"


def _look_at_poses_file(look: _Look, trajectory_file: str | Path | None) -> None:
    def read() -> Trajectory | None:
        file = pick_trajectory(look.folder, trajectory_file)
        if file is not None:
            return read_trajectory(file)
        if look.kind == "folder" and look.found is not None:
            return read_folder_poses(look.folder, look.found.position_of_number, look.found.stamps_s)
        return None

    before = len(look.findings)
    look.trajectory = look.attempt("poses", "correct the line or file named, or remove it and use visual odometry", read)
    if look.trajectory is None and len(look.findings) == before:
        look.findings.append(ok("poses", "none recorded: a run needs visual odometry (or a trajectory file)"))


def _look_at_files(look: _Look) -> None:
    if look.found is not None and look.camera is not None:
        look.findings += check_files(look.found.pairs, look.camera, look.camera_source, look.scale)


def _look_at_pixels(look: _Look) -> None:
    if look.found is None or look.camera is None:
        return
    chosen = np.unique(np.linspace(0, len(look.found.pairs) - 1, _SAMPLES).astype(int))
    known_broken = any(finding.topic == "images" and finding.level == "error" for finding in look.findings)
    frames = [frame for frame in map(_quiet(look) if known_broken else look.frame, chosen) if frame is not None]
    if frames:
        floating = read_header(look.found.pairs[frames[0].index].depth).floating
        look.findings += check_depth(frames, None if floating else look.scale, look.facts)
        look.findings += check_alignment(frames, look.facts)


def _look_at_motion(look: _Look) -> None:
    if look.trajectory is None or look.found is None:
        return
    coverage = check_coverage(look.trajectory, look.found.pairs, look.facts)
    look.findings += coverage
    if look.facts["frames_with_pose"] == 0:
        return
    look.findings += check_jumps(look.trajectory, look.found.pairs, look.facts)
    if look.camera is not None and look.camera_source != "a guess":
        look.findings += check_agreement(look.trajectory, look.found.pairs, _quiet(look), look.scale, look.facts)


def _quiet(look: _Look) -> Callable[[int], Frame | None]:
    """Read frames without adding findings, where broken files are known already."""

    def read(i: int) -> Frame | None:
        known = len(look.findings)
        frame = look.frame(i)
        del look.findings[known:]
        return frame

    return read
