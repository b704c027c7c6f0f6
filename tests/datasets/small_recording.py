"""Tiny recordings written to a folder, to be broken by tests."""

import json
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 64, 48
CAMERA = {"fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5, "width": WIDTH, "height": HEIGHT, "depth_scale": 5000.0}


def picture(i: int) -> np.ndarray:
    """A white square on grey that moves right with i."""
    image = np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)
    image[14:34, 10 + i : 30 + i] = (250, 240, 30)
    return image


def distances(i: int) -> np.ndarray:
    """Units of 1/5000 m: the square at 1 m, all else at 2 m."""
    depth = np.full((HEIGHT, WIDTH), 10000, dtype=np.uint16)
    depth[14:34, 10 + i : 30 + i] = 5000
    return depth


def write_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def write_tum(folder: Path, frames: int = 5, camera: bool = True, poses: bool = True) -> Path:
    """10 Hz from t=100 s; depth stamped 5 ms later; poses at 20 Hz that move 1 cm a frame along x."""
    lists: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"]}
    for i in range(frames):
        t = 100 + 0.1 * i
        write_image(folder / f"rgb/{t:.3f}.png", picture(i))
        write_image(folder / f"depth/{t + 0.005:.3f}.png", distances(i))
        lists["rgb"].append(f"{t:.3f} rgb/{t:.3f}.png")
        lists["depth"].append(f"{t + 0.005:.3f} depth/{t + 0.005:.3f}.png")
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    if camera:
        (folder / "camera.json").write_text(json.dumps(CAMERA))
    if poses:
        rows = [f"{99.9 + 0.05 * k:.3f} {0.005 * k:.4f} 0 0 0 0 0 1" for k in range(2 * frames + 6)]
        (folder / "groundtruth.txt").write_text("# ground truth\n" + "\n".join(rows) + "\n")
    return folder


def write_folder(folder: Path, frames: int = 5) -> Path:
    """The same as plain images named by number."""
    for i in range(frames):
        write_image(folder / f"rgb/frame{i:04d}.png", picture(i))
        write_image(folder / f"depth/frame{i:04d}.png", distances(i))
    (folder / "camera.json").write_text(json.dumps(CAMERA))
    return folder
