"""Intrinsics of a recording: ``camera.json``, and the published ones of the TUM RGB-D benchmark."""

import json
import re
from pathlib import Path

from pydantic import Field, ValidationError, field_validator

from seo_slam.camera import Camera
from seo_slam.errors import DatasetError, FrameError
from seo_slam.settings.base import Settings

CAMERA_FILE = "camera.json"
TUM_DEPTH_SCALE = 5000.0
EXAMPLE = (
    '{"fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5, "width": 640, "height": 480, "depth_scale": 1000.0, '
    '"distortion": [0, 0, 0, 0, 0]}'
)

# Published calibration of the benchmark's three sensors (its page "Intrinsic Camera Calibration of the Kinect").
FREIBURG_CAMERAS = {
    "freiburg1": Camera(517.3, 516.5, 318.6, 255.3, 640, 480, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
    "freiburg2": Camera(520.9, 521.0, 325.1, 249.7, 640, 480, (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
    "freiburg3": Camera(535.4, 539.2, 320.1, 247.6, 640, 480),
}
_FREIBURG = re.compile(r"(?:freiburg|(?<![a-z0-9])fr)([123])(?![0-9])", re.IGNORECASE)


class CameraFile(Settings):
    """The contents of ``camera.json``."""

    fx: float = Field(gt=0, description="focal length, pixels")
    fy: float = Field(gt=0)
    cx: float = Field(description="principal point, pixels; pixel centres have whole coordinates")
    cy: float
    width: int = Field(gt=0, description="of the colour image, pixels")
    height: int = Field(gt=0)
    depth_scale: float | None = Field(None, gt=0, description="units of the depth image a metre; not needed for .npy in metres")
    distortion: tuple[float, ...] = Field((0.0, 0.0, 0.0, 0.0, 0.0), description="k1, k2, p1, p2, k3 as in OpenCV")

    @field_validator("distortion")
    @classmethod
    def _five_terms(cls, terms: tuple[float, ...]) -> tuple[float, ...]:
        if len(terms) not in (0, 4, 5):
            raise ValueError(f"got {len(terms)} terms, wanted [k1, k2, p1, p2, k3] (or the first four, or none)")
        return (*terms, *[0.0] * (5 - len(terms)))

    def camera(self) -> Camera:
        """Return the intrinsics without the depth scale."""
        k1, k2, p1, p2, k3 = self.distortion
        return Camera(self.fx, self.fy, self.cx, self.cy, self.width, self.height, (k1, k2, p1, p2, k3))


def read_camera_file(path: str | Path) -> CameraFile:
    """Read a ``camera.json``.

    Raises:
        DatasetError: it is missing, is not JSON, or lacks a value; the message names every bad or unknown key.
    """
    file = Path(path)
    try:
        values = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise DatasetError(f"{file}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise DatasetError(f"{file}: not a text file; wanted {EXAMPLE}") from None
    except json.JSONDecodeError as error:
        raise DatasetError(f"{file}:{error.lineno}: not JSON: {error.msg}") from None
    try:
        checked = CameraFile.model_validate(values)
        checked.camera()
    except ValidationError as error:
        faults = "; ".join(f"{'.'.join(map(str, item['loc'])) or 'file'}: {item['msg']}" for item in error.errors())
        raise DatasetError(f"{file}: {faults}. Wanted for example {EXAMPLE}") from None
    except FrameError as error:
        raise DatasetError(f"{file}: {error}") from None
    return checked


def write_camera_file(path: str | Path, camera: Camera, depth_scale: float) -> None:
    """Write a ``camera.json``.

    Raises:
        DatasetError: it cannot be written.
    """
    values = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    text = json.dumps({**values, "depth_scale": depth_scale, "distortion": list(camera.distortion)}, indent=2)
    try:
        Path(path).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{path}: cannot be written: {error.strerror}") from None


def known_camera(folder: Path) -> Camera | None:
    """Return the published intrinsics of a TUM sequence, told by the ``# file:`` header of rgb.txt, else by the folder's name."""
    try:
        with (folder / "rgb.txt").open(encoding="utf-8", errors="replace") as lines:
            header = " ".join(line for line, _ in zip(lines, range(5), strict=False) if line.startswith("#"))
    except OSError:  # no such list, or not ours to read: the name has to tell
        header = ""
    match = _FREIBURG.search(header) or _FREIBURG.search(folder.resolve().name)
    return FREIBURG_CAMERAS[f"freiburg{match[1]}"] if match else None


def find_camera(folder: Path, camera_file: str | Path | None = None) -> tuple[Camera, float | None, str]:
    """Return the intrinsics of a recording, its depth scale if stated, and where they come from.

    ``camera_file`` wins over ``camera.json`` in the folder, and that over published intrinsics.

    Raises:
        DatasetError: there are none; the message says what to write.
    """
    file = Path(camera_file) if camera_file is not None else folder / CAMERA_FILE
    if camera_file is not None or file.is_file():
        found = read_camera_file(file)
        return found.camera(), found.depth_scale, str(file)
    published = known_camera(folder)
    if published is None:
        raise DatasetError(
            f"{folder}: no intrinsics: no {CAMERA_FILE} in it, and it is not a known TUM sequence (freiburg1-3). "
            f"Write {folder / CAMERA_FILE} or give a camera file, for example {EXAMPLE}"
        )
    return published, TUM_DEPTH_SCALE, "published TUM intrinsics"
