"""What is in the boxes of a frame, kept small: what an image encoder sees there, if it sees what is there."""

import zlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.perception.background import BACKGROUND
from seo_slam.simulation.visible import View
from seo_slam.simulation.world import STRUCTURE_ID, Thing, World

SECOND = 0.4
"""What fills less than this share of what the main thing in a box does, middle counting most, is not seen."""

_ACROSS = 20  # samples each way in a box
_STRUCTURE_WEIGHT = 1.0 / 3.0
_DEPTH_STEP_PX = 4
_NEAR_M = 0.05


@dataclass(frozen=True, slots=True)
class InBox:
    """One thing in a box.

    Attributes:
        name: of the thing, different for each; structure of one kind shares one.
        look: what things that look alike share: the name of the model they are copies of; of things without one, and structure: the word.
        word: what it is.
        weight: how much of the box it fills, its middle counting most.
    """

    name: str
    look: str
    word: str
    weight: float


_NOTHING = InBox("wall", "wall", "wall", 1.0)


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """One frame, some kilobytes.

    Attributes:
        index: its number.
        world, camera: what there was, and with what it was seen.
        T_world_camera: (4, 4) true pose.
        packed_ids: the instance image, compressed.
        coarse_depth_m: every fourth pixel of every fourth row of the true depth.
    """

    index: int
    world: World
    camera: Camera
    T_world_camera: FloatArray
    packed_ids: bytes
    coarse_depth_m: NDArray[np.float16]

    @classmethod
    def of(cls, view: View) -> "PictureFrame":
        """Keep what a view has."""
        drawn = view.rendered
        packed = zlib.compress(drawn.instance_ids.astype(np.uint16).tobytes(), level=1)
        coarse_m = drawn.depth_m[::_DEPTH_STEP_PX, ::_DEPTH_STEP_PX].astype(np.float16)
        return cls(view.index, view.world, view.camera, view.T_world_camera, packed, coarse_m)

    def instance_ids(self) -> NDArray[np.uint16]:
        """Return the (H, W) instance image."""
        return np.frombuffer(zlib.decompress(self.packed_ids), dtype=np.uint16).reshape(self.camera.height, self.camera.width)

    def in_boxes(self, boxes_px: FloatArray) -> list[tuple[InBox, ...]]:
        """Return what is to be seen in each box (N, 4), the heaviest first; of an empty picture: a wall."""
        ids = self.instance_ids()
        return [self._in_box(ids, box_px) for box_px in boxes_px]

    def _in_box(self, ids: NDArray[np.uint16], box_px: FloatArray) -> tuple[InBox, ...]:
        u, share_u = _samples(box_px[0], box_px[2], self.camera.width)
        v, share_v = _samples(box_px[1], box_px[3], self.camera.height)
        weights = _middle(share_v)[:, None] * _middle(share_u)[None, :]
        found = ids[v[:, None], u[None, :]]
        filled = np.bincount(found.ravel(), weights=weights.ravel())
        parts = [self._thing(int(i), float(filled[i])) for i in np.flatnonzero(filled) if i != STRUCTURE_ID]
        if _STRUCTURE_WEIGHT * filled[STRUCTURE_ID] >= SECOND * max((part.weight for part in parts), default=0.0):
            parts += self._structure(v, u, np.where(found == STRUCTURE_ID, _STRUCTURE_WEIGHT * weights, 0.0))
        parts = [part for part in parts if part.weight > 0]
        heaviest = max((part.weight for part in parts), default=0.0)
        return tuple(sorted((part for part in parts if part.weight >= SECOND * heaviest), key=lambda part: -part.weight)) or (_NOTHING,)

    def _thing(self, thing_id: int, weight: float) -> InBox:
        thing = self.world.thing(thing_id)
        return InBox(f"thing {thing_id}", thing.model or thing.label, thing.label, weight)

    def _structure(self, v: NDArray[np.int64], u: NDArray[np.int64], weights: FloatArray) -> list[InBox]:
        """What the pixels of structure are, by where they are; those that see nothing count for nothing."""
        names, image = self._structure_image
        found = image[v[:, None] // _DEPTH_STEP_PX, u[None, :] // _DEPTH_STEP_PX]
        filled = np.bincount(found.ravel(), weights=weights.ravel(), minlength=len(names) + 1)[:-1]
        return [InBox(names[k], names[k], names[k], float(filled[k])) for k in np.flatnonzero(filled)]

    @cached_property
    def _structure_image(self) -> tuple[list[str], NDArray[np.int64]]:
        """Names of structure, and which of them every fourth pixel of every fourth row would be; one more where nothing is seen."""
        depth_m = self.coarse_depth_m.astype(np.float64)
        v, u = _DEPTH_STEP_PX * np.indices(depth_m.shape)
        known = depth_m > 0
        uv = np.stack([u, v], axis=-1).astype(np.float64)
        p_world = transform_points(self.T_world_camera, self.camera.back_project(uv[known], depth_m[known]))
        words = structure_words(self.world, p_world).tolist()
        names = sorted(set(words))
        image = np.full(depth_m.shape, len(names), dtype=np.int64)
        image[known] = [names.index(word) for word in words]
        return names, image


def structure_words(world: World, p_world: FloatArray) -> NDArray[np.str_]:
    """Return (N,) what the structure at points (N, 3) is called: by the smallest piece whose box holds the point."""
    volumes, words = np.full(len(p_world), np.inf), np.full(len(p_world), "wall", dtype=object)
    for piece in world.structure:
        low, high = piece.bounds_world
        volume = float(np.prod(np.maximum(high - low, _NEAR_M)))
        inside = ((p_world > low - _NEAR_M) & (p_world < high + _NEAR_M)).all(axis=1) & (volume < volumes)
        volumes[inside] = volume
        words[inside] = _word(piece)
        if _word(piece) == "room":
            words[inside] = np.select(
                [p_world[inside, 2] < low[2] + _NEAR_M, p_world[inside, 2] > high[2] - _NEAR_M], ["floor", "ceiling"], "wall"
            )
    return np.asarray(words)


def _word(piece: Thing) -> str:
    """The plain word for a piece of structure: "wall" of "house wall b"."""
    words = piece.label.casefold().split()
    plain = next((name for name in BACKGROUND if name in words or f"{name}s" in words), None)
    return plain or " ".join(word for word in words if len(word) > 1) or "wall"


def _samples(low: float, high: float, size: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Pixels of a side of a box, at most 20, and where each lies in it, 0..1."""
    first, last = max(int(np.floor(low)), 0), min(int(np.ceil(high)), size)
    pixels = np.arange(first, max(last, first + 1), max(1, -(-(last - first) // _ACROSS)))
    return pixels, np.clip((pixels + 0.5 - low) / max(high - low, 1e-9), 0.0, 1.0)


def _middle(share: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-8.0 * (share - 0.5) ** 2))
