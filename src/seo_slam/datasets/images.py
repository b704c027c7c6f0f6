"""Image files: headers for cheap checks before a run, pixels when a frame is wanted."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import DatasetError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")
DEPTH_SUFFIXES = (".png", ".npy")
_TAIL_BYTES = 1024
_LAST_NUMBER = re.compile(r"(\d+(?:\.\d+)?)(?!.*\d)")
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What an image file says of itself.

    Attributes:
        width, height: pixels.
        channels: 1 for grey and depth.
        bits: a channel.
        floating: whether values are floating point (.npy in metres).
    """

    width: int
    height: int
    channels: int
    bits: int
    floating: bool = False


def name_number(path: Path) -> str | None:
    """The last number in a file's name: "000123" of frame-000123.color.jpg; None if there is none."""
    match = _LAST_NUMBER.search(path.stem)
    return match[1] if match else None


def read_header(path: Path) -> ImageHeader:
    """Read the header of a PNG, JPEG or .npy file, and look whether its end is there.

    Raises:
        DatasetError: the file is missing, empty, cut off, or none of these formats.
    """
    try:
        if path.suffix.lower() == ".npy":
            return _npy_header(path)
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(0)
            head = file.read(32)
            if not head:
                raise DatasetError(f"{path}: empty file")
            header, end = (_png_header(head, path), b"IEND") if head[:4] == b"\x89PNG" else (_jpeg_header(file, path), b"\xff\xd9")
            file.seek(max(0, size - _TAIL_BYTES))
            if end not in file.read():
                raise DatasetError(f"{path}: cut off in the middle (no end marker after {size} bytes)")
            return header
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read: {error.strerror}") from None


def _png_header(head: bytes, path: Path) -> ImageHeader:
    if len(head) < 26 or head[12:16] != b"IHDR" or head[25] not in _PNG_CHANNELS:
        raise DatasetError(f"{path}: damaged PNG header")
    width, height = int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    return ImageHeader(width, height, _PNG_CHANNELS[head[25]], head[24])


def _jpeg_header(file: Any, path: Path) -> ImageHeader:
    """Walk the segments to the start-of-frame one (ITU T.81, B.2.2)."""
    file.seek(0)
    if file.read(2) != b"\xff\xd8":
        raise DatasetError(f"{path}: neither PNG nor JPEG")
    while True:
        marker = file.read(2)
        while marker == b"\xff\xff":  # fill bytes
            marker = b"\xff" + file.read(1)
        length = int.from_bytes(file.read(2), "big")
        if len(marker) < 2 or marker[0] != 0xFF or length < 2:
            raise DatasetError(f"{path}: damaged or cut off JPEG header")
        if 0xC0 <= marker[1] <= 0xCF and marker[1] not in (0xC4, 0xC8, 0xCC):
            frame = file.read(6)
            if len(frame) < 6:
                raise DatasetError(f"{path}: cut off JPEG header")
            return ImageHeader(int.from_bytes(frame[3:5], "big"), int.from_bytes(frame[1:3], "big"), frame[5], frame[0])
        file.seek(length - 2, 1)


def _npy_header(path: Path) -> ImageHeader:
    array = _open_npy(path)
    if array.ndim != 2:
        raise DatasetError(f"{path}: got an array of shape {array.shape}, wanted (height, width)")
    return ImageHeader(array.shape[1], array.shape[0], 1, 8 * array.dtype.itemsize, array.dtype.kind == "f")


def _open_npy(path: Path) -> NDArray[Any]:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise DatasetError(f"{path}: not a .npy array, or cut off: {error}") from None
    return np.asarray(array)


def require_depth_header(path: Path, header: ImageHeader) -> None:
    """Raise ``DatasetError`` unless the file can hold depth: one channel of 16-bit integers, or floating-point metres."""
    if header.channels != 1:
        raise DatasetError(f"{path}: got {header.channels} channels, wanted one: a coloured picture of depth holds no distances")
    if path.suffix.lower() == ".npy" and (header.floating or header.bits == 16):
        return
    if header.bits != 16:
        raise DatasetError(
            f"{path}: got {header.bits}-bit depth, wanted a 16-bit PNG (or floating-point metres as .npy); "
            "8 bits cannot hold distances, record the depth again"
        )


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """Return (H, W, 3) uint8, red first; a grey image is repeated. Rotation tags are ignored: intrinsics belong to the stored pixels.

    Raises:
        DatasetError: the image does not decode.
    """
    image = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise DatasetError(f"{path}: the image does not decode; it is missing or damaged")
    return np.asarray(image, dtype=np.uint8)


def read_depth(path: Path, depth_scale: float) -> NDArray[np.float32]:
    """Return (H, W) float32 metres, 0 = no return.

    Args:
        path: a 16-bit PNG or integer .npy, divided by ``depth_scale``; or a floating-point .npy, in metres.
        depth_scale: units a metre.

    Raises:
        DatasetError: it does not decode, is no depth, or holds negative distances.
    """
    raw: NDArray[Any] | None = _open_npy(path) if path.suffix.lower() == ".npy" else cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if raw is None:
        raise DatasetError(f"{path}: the depth image does not decode; it is missing or damaged")
    floating = raw.dtype.kind == "f"
    channels = 1 if raw.ndim == 2 else raw.shape[-1]
    require_depth_header(path, ImageHeader(raw.shape[1], raw.shape[0], channels, 8 * raw.dtype.itemsize, floating))
    if not floating:
        return np.asarray(raw * np.float32(1.0 / depth_scale), dtype=np.float32)
    depth_m = np.where(np.isfinite(raw), raw, 0).astype(np.float32)
    if float(depth_m.min(initial=0.0)) < 0:
        raise DatasetError(f"{path}: holds negative depth ({float(depth_m.min()):.3g} m); wanted metres along z, 0 where no return")
    return depth_m
