"""Keeps drawn frames on disk, so that a recording can be made again at another level without drawing it again."""

import hashlib
import os
import zipfile
from pathlib import Path
from typing import Protocol

import numpy as np

from seo_slam.camera import Camera
from seo_slam.records import Trajectory
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.rendering import Renderer
from seo_slam.simulation.scene import Scene


class Drawn(Protocol):
    """All that decides what a perfect camera sees."""

    name: str
    scene: Scene
    camera: Camera
    trajectory: Trajectory
    renderer: Renderer


class RenderCache:
    """One file a frame, in a folder named by what is drawn: another scene, path or camera gets a folder of its own."""

    def __init__(self, folder: Path, drawn: Drawn) -> None:
        """Use ``folder``; it is made when the first frame is kept."""
        self._folder = folder / f"{drawn.name}-{_fingerprint(drawn)}"

    def get(self, index: int) -> Rendered | None:
        """Return a frame that was kept."""
        try:
            with np.load(self._folder / f"{index:05d}.npz") as kept:
                covered = dict(zip(kept["covered_ids"].tolist(), kept["covered_px"].tolist(), strict=True))
                return Rendered(kept["rgb"], kept["depth_m"], kept["instance_ids"].astype(np.int32), covered)
        except (OSError, KeyError, ValueError, zipfile.BadZipFile):
            return None

    def put(self, index: int, rendered: Rendered) -> None:
        """Keep a frame; it is there wholly or not at all, so that several processes may share a cache."""
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{index:05d}.npz"
        part = path.with_suffix(f".{os.getpid()}.part")
        covered = dict(rendered.covered_px)
        with part.open("wb") as file:
            np.savez_compressed(
                file,
                rgb=rendered.rgb,
                depth_m=rendered.depth_m,
                instance_ids=rendered.instance_ids.astype(np.uint16),
                covered_ids=np.array(list(covered), dtype=np.int64),
                covered_px=np.array(list(covered.values()), dtype=np.int64),
            )
        part.replace(path)


def _fingerprint(drawn: Drawn) -> str:
    camera = drawn.camera
    digest = hashlib.sha256(f"{drawn.renderer.name} {camera.width} {camera.height} {camera.fx} {camera.fy}".encode())
    digest.update(drawn.trajectory.T_world_camera.tobytes())
    for change in drawn.scene.changes:
        digest.update(f"{change.timestamp_s} {change.event} {change.thing.id}".encode())
    for world in drawn.scene.worlds:
        for thing in world:
            digest.update(f"{thing.id} {thing.label} {thing.model} {len(thing.parts)}".encode())
            digest.update(thing.T_world_thing.tobytes() + np.concatenate(thing.bounds_thing).tobytes())
    return digest.hexdigest()[:16]
