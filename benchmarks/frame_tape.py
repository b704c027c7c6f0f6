"""Keyframes with what a front end saw in them, in a folder: many processes can map the very same frames, and hold no simulation."""

import json
from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seo_slam.camera import Camera
from seo_slam.errors import ConfigError
from seo_slam.interfaces import Detector
from seo_slam.records import Trajectory
from seo_slam.types import Detections, Frame


@dataclass(frozen=True, slots=True)
class FrameTape:
    """Frames on disk; those that no pipeline looks at are only stamps.

    Attributes:
        folder: one file a keyframe, and ``tape.json``.
        path: ``T_world_camera`` of all frames.
        camera: of the frames.
        lap_ends: the last frame of each lap.
    """

    folder: Path
    path: Trajectory
    camera: Camera
    lap_ends: tuple[int, ...]

    @classmethod
    def record(
        cls,
        folder: Path,
        frames: Any,
        detector: Detector,
        embedder: Any,
        wanted: Collection[int],
        laps: int = 1,
        made_with: Mapping[str, Any] | None = None,
    ) -> "FrameTape":
        """Let a detector and an encoder of pictures look at the wanted frames of a recording, and keep what they say.

        Args:
            folder: a new one.
            frames: has ``frame(index)``, ``trajectory`` and ``camera``.
            detector: is asked once a frame.
            embedder: its ``embed_crops`` gives every box a vector.
            wanted: the frames that become keyframes.
            laps: how many equal laps the frames are.
            made_with: what else makes the tape what it is, JSON; kept for ``require_made_with``.
        """
        folder.mkdir(parents=True)
        path = frames.trajectory
        for index in sorted(wanted):
            frame = frames.frame(index)
            found = detector.detect(frame)
            masks = np.zeros((0, *frame.depth_m.shape), dtype=np.bool_) if found.masks is None else found.masks
            np.savez_compressed(
                _file(folder, index),
                rgb=frame.rgb,
                depth_m=frame.depth_m,
                boxes_px=found.boxes_px,
                labels=np.array(json.dumps(found.labels)),
                scores=found.scores,
                masks=np.packbits(masks, axis=2),
                embeddings=embedder.embed_crops(frame, found.boxes_px),
            )
        lap_ends = [round(len(path) * lap / laps) - 1 for lap in range(1, laps + 1)]
        about = {"camera": asdict(frames.camera), "lap_ends": lap_ends, "made_with": dict(made_with or {})}
        (folder / "tape.json").write_text(json.dumps(about), encoding="utf-8")
        np.savez(folder / "path.npz", timestamps_s=path.timestamps_s, T_world_camera=path.T_world_camera)
        return cls(folder, path, frames.camera, tuple(lap_ends))

    @classmethod
    def open(cls, folder: Path) -> "FrameTape":
        """Read what ``record`` wrote."""
        about = json.loads((folder / "tape.json").read_text(encoding="utf-8"))
        with np.load(folder / "path.npz") as kept:
            path = Trajectory(kept["timestamps_s"], kept["T_world_camera"])
        camera = Camera(**{**about["camera"], "distortion": tuple(about["camera"]["distortion"])})
        return cls(folder, path, camera, tuple(about["lap_ends"]))

    def play(self) -> Iterator[tuple[Frame, Detections]]:
        """Yield every frame with what was seen in it: black ones with nothing between the keyframes."""
        size = (self.camera.height, self.camera.width)
        black, no_depth = np.zeros((*size, 3), dtype=np.uint8), np.zeros(size, dtype=np.float32)
        for index, stamp_s in enumerate(self.path.timestamps_s.tolist()):
            if not _file(self.folder, index).is_file():
                yield Frame(stamp_s, black, no_depth, self.camera, index), Detections.empty()
                continue
            with np.load(_file(self.folder, index)) as kept:
                frame = Frame(stamp_s, kept["rgb"], kept["depth_m"], self.camera, index)
                masks = np.unpackbits(kept["masks"], axis=2, count=self.camera.width).astype(np.bool_)
                labels = tuple(json.loads(str(kept["labels"])))
                found = Detections(kept["boxes_px"], labels, kept["scores"], masks, kept["embeddings"])
            yield frame, found


def require_made_with(folder: Path, wanted: Mapping[str, Any]) -> None:
    """Check that a tape is what would be recorded now.

    Raises:
        ConfigError: it was made with something else, or does not say with what.
    """
    try:
        made = json.loads((folder / "tape.json").read_text(encoding="utf-8")).get("made_with")
    except (OSError, json.JSONDecodeError) as error:
        raise ConfigError(f"{folder}: is no tape: {error}") from error
    if not made:
        raise ConfigError(f"{folder}: does not say what it was made with; remove it, or take another folder")
    other = [f"{key} {made.get(key)} (wanted {value})" for key, value in wanted.items() if made.get(key) != value]
    if other:
        raise ConfigError(f"{folder}: was made with {', '.join(other)}; remove it, or take another folder")


def _file(folder: Path, index: int) -> Path:
    return folder / f"{index:05d}.npz"


class TapeDetector:
    """A ``Detector`` that says what the tape says of the newest frame."""

    def __init__(self) -> None:
        self.found = Detections.empty()

    def detect(self, frame: Frame) -> Detections:  # noqa: ARG002  # the interface has it
        """Return what was seen in the frame that was taken off the tape last."""
        return self.found
