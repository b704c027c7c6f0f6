"""The three inputs of SEO-SLAM, Fig 4: what each agent's model gets to see.

They are drawn where the agent runs, never in the robot's loop; the same view gives the same bytes. Every image is a JPEG that says where
its pixels come from (``provenance``), and names no landmark: the numbers in it are 1, 2, … anew for each question.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.agents.chips import Rect
from seo_slam.agents.drawing import COLOURS, Drawing, cells, window_around
from seo_slam.agents.projection import without_covered
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.interfaces import AgentView

IMAGE_PX = 512
CROP_PX = 256

VERIFICATION_CROPS, MERGING_CROPS = 4, 8

_BOXES_WIDE = {"verification": 2.0, "description": 2.5, "merging": 1.7}
"""How much of its surroundings is shown with a thing: the side of a crop in longer sides of its box."""

_LEAST_SHARE = {"verification": 0.1, "description": 0.16, "merging": 0.1}
"""A crop is at least this share of the frame's longer side: more magnification shows nothing more."""


_SCENE_WIDE, _LEAST_SCENE = 1.3, 0.6
"""The side of a scene, in longer sides of what is around all its boxes; and at least so much of the frame's height."""


@dataclass(frozen=True, slots=True)
class Composed:
    """Images for a question.

    Attributes:
        images: JPEG files.
        ids: the landmark of number 1, 2, … in them.
    """

    images: tuple[bytes, ...]
    ids: tuple[int, ...]


def verification_image(view: AgentView, ids: Sequence[int]) -> Composed:
    """Draw one 512x512 tile of up to four crops, each with the red box of one landmark and its number (Fig 4a)."""
    chosen = tuple(ids[:VERIFICATION_CROPS])
    drawing = Drawing(view.frame, IMAGE_PX, IMAGE_PX)
    places = cells(1, 1, IMAGE_PX, 0) if len(chosen) == 1 else cells(2, 2, CROP_PX)
    for number, landmark_id in enumerate(chosen, start=1):
        box = view.boxes_px[landmark_id]
        drawing.add(_window(view, box, "verification"), places[number - 1], {number: box})
    return Composed((drawing.jpeg(),), chosen)


def description_image(view: AgentView, landmark_id: int) -> Composed:
    """Draw the 512x512 projection of one landmark: its red box, number 1, with its surroundings (Fig 4b)."""
    box = view.boxes_px[landmark_id]
    drawing = Drawing(view.frame, IMAGE_PX, IMAGE_PX)
    drawing.add(_window(view, box, "description"), (0, 0, IMAGE_PX, IMAGE_PX), {1: box})
    return Composed((drawing.jpeg(),), (landmark_id,))


def merging_images(view: AgentView, ids: Sequence[int]) -> Composed:
    """Draw the 512x512 scene with up to eight boxes, and a tile of their 256x256 crops (Fig 4c).

    Each number has a colour of its own, the same in both. Landmarks that mostly lie behind something much nearer are left out.
    """
    boxes = {i: view.boxes_px[i] for i in ids[:MERGING_CROPS]}
    chosen = without_covered(boxes, depths_m(view, list(boxes))).kept
    numbered = {number: boxes[i] for number, i in enumerate(chosen, start=1)}
    scene = Drawing(view.frame, IMAGE_PX, IMAGE_PX)
    scene.add(_scene_window(view, list(numbered.values())), (0, 0, IMAGE_PX, IMAGE_PX), numbered, COLOURS)
    columns = 2 if len(chosen) <= VERIFICATION_CROPS else 4
    tile = Drawing(view.frame, columns * CROP_PX, (1 if len(chosen) <= 2 else 2) * CROP_PX)
    for (number, box), place in zip(numbered.items(), cells(columns, 2, CROP_PX), strict=False):
        tile.add(_window(view, box, "merging"), place, {number: box}, COLOURS)
    return Composed((scene.jpeg(), tile.jpeg()), chosen)


def depths_m(view: AgentView, ids: Sequence[int]) -> dict[int, float]:
    """Return landmark id -> its depth in the view."""
    rows = [row_of(view, landmark_id) for landmark_id in ids]
    p_camera = transform_points(inverse(view.T_world_camera), view.landmarks.p_world[rows].reshape(-1, 3))
    return dict(zip(ids, p_camera[:, 2].tolist(), strict=True))


def row_of(view: AgentView, landmark_id: int) -> int:
    """Return the row of a landmark in ``view.landmarks``."""
    return int(np.flatnonzero(view.landmarks.ids == landmark_id)[0])


def _window(view: AgentView, box_px: FloatArray, kind: str) -> Rect:
    camera = view.frame.camera
    longer = max(camera.width, camera.height)
    return window_around(box_px, _BOXES_WIDE[kind], _LEAST_SHARE[kind] * longer, longer, camera.width, camera.height)


def _scene_window(view: AgentView, boxes_px: Sequence[FloatArray]) -> Rect:
    """A square around all boxes, with some of the scene; the whole frame if they do not fit into one, or there are none."""
    camera = view.frame.camera
    whole = (0, 0, camera.width, camera.height)
    if not boxes_px:
        return whole
    stacked = np.array(boxes_px)
    around = np.concatenate([stacked[:, :2].min(axis=0), stacked[:, 2:].max(axis=0)])
    side = min(camera.width, camera.height)
    if (around[2:] - around[:2]).max() > side:
        return whole
    return window_around(around, _SCENE_WIDE, _LEAST_SCENE * side, side, camera.width, camera.height)
