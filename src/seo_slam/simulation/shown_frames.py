"""What was in each frame of a recording, kept small: a few kilobytes a frame."""

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.simulation.colour_words import colours_of_things
from seo_slam.simulation.visible import View
from seo_slam.simulation.world import World

_DEPTH_STEP_PX = 4  # of the depth that is kept; it only says which place of the room is meant


@dataclass(frozen=True, slots=True, eq=False)
class ShownFrame:
    """One frame.

    Attributes:
        index: its number.
        world, camera: what there was, and with what it was seen.
        T_world_camera: (4, 4) true pose.
        colours: id of a thing -> the word for its colour, from the pixels of the image.
        covered_px: id -> pixels that it would cover if nothing stood before it.
        packed_ids: the instance image, compressed.
        coarse_depth_m: every fourth pixel of every fourth row of the true depth; 0 where a ray meets nothing.
    """

    index: int
    world: World
    camera: Camera
    T_world_camera: FloatArray
    colours: dict[int, str]
    covered_px: dict[int, int]
    packed_ids: bytes
    coarse_depth_m: NDArray[np.float16]

    @classmethod
    def of(cls, view: View) -> "ShownFrame":
        """Keep what a view has."""
        drawn = view.rendered
        return cls(
            view.index,
            view.world,
            view.camera,
            view.T_world_camera,
            colours_of_things(drawn.rgb, drawn.instance_ids),
            dict(drawn.covered_px),
            zlib.compress(drawn.instance_ids.astype(np.uint16).tobytes(), level=1),
            drawn.depth_m[::_DEPTH_STEP_PX, ::_DEPTH_STEP_PX].astype(np.float16),
        )

    def instance_ids(self) -> NDArray[np.uint16]:
        """Return the (H, W) instance image."""
        return np.frombuffer(zlib.decompress(self.packed_ids), dtype=np.uint16).reshape(self.camera.height, self.camera.width)

    def place_world(self, u: float, v: float) -> FloatArray:
        """Return the (3,) point that is seen at a pixel, world frame, metres; 10 m away where nothing is seen."""
        height, width = self.coarse_depth_m.shape
        column = min(max(int(u) // _DEPTH_STEP_PX, 0), width - 1)
        row = min(max(int(v) // _DEPTH_STEP_PX, 0), height - 1)
        depth_m = float(self.coarse_depth_m[row, column]) or 10.0
        return np.asarray(transform_points(self.T_world_camera, self.camera.back_project([u, v], depth_m)))
