"""What is in a drawn box, judged from the pixels of the instance image alone.

A box belongs to the thing that has the most pixels in its middle (60 % of its width and of its height), if

- these are at least 20 % of the pixels of the middle,
- the box shows at least 20 % of the pixels that the thing would cover in this image if nothing stood before it, and
- the box shows enough of its pixels to tell what it is: as many as the simulated detector needs.

Else what is in it cannot be told: floor, wall, furniture, or a piece of something. A box that was drawn in the wrong place thus shows
another thing or nothing, whatever landmark it was meant for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.shown_frames import ShownFrame
from seo_slam.simulation.visible import octant_of
from seo_slam.simulation.world import Thing

MIDDLE = 0.6
"""Share of a box's width and height that is its middle."""

LEAST_OF_MIDDLE = 0.2
LEAST_OF_THING = 0.2

_PLACE_M = 0.25  # errors about nothing belong to a place of this size

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class BoxContents:
    """What is in a box.

    Attributes:
        thing: what it shows; None: it cannot be told.
        colour: of the thing, in a word; "" where there is none.
        fit: how well the box goes with the thing, 0..1: share of the thing's pixels in it, times their share of the box.
        subject: what errors about it belong to: the thing, or the place that is seen.
        side: from which of eight sides it is seen.
    """

    thing: Thing | None
    colour: str
    fit: float
    subject: str
    side: int


def contents_of(box: Box, frame: ShownFrame, instance_ids: NDArray[np.uint16]) -> BoxContents:
    """Return what is in a box.

    Args:
        box: ``x0, y0, x1, y1`` in pixels of the frame.
        frame: in which it was drawn.
        instance_ids: (H, W) of that frame.
    """
    inside = _cut(instance_ids, box, 1.0)
    thing_id = _owner(_cut(instance_ids, box, MIDDLE))
    if thing_id is not None:
        in_box, visible = int((inside == thing_id).sum()), int((instance_ids == thing_id).sum())
        whole = max(frame.covered_px.get(thing_id, visible), visible)
        if in_box >= max(LEAST_OF_THING * whole, DetectorKnobs().smallest_in(*instance_ids.shape)):
            thing = frame.world.thing(thing_id)
            offset = thing.T_world_thing[:3, :3].T @ (frame.T_world_camera[:3, 3] - thing.p_world)
            fit = in_box / visible * in_box / inside.size
            return BoxContents(thing, frame.colours.get(thing_id, ""), fit, f"thing {thing_id}", octant_of(offset))
    place = frame.place_world((box[0] + box[2]) / 2.0, (box[1] + box[3]) / 2.0)
    cell = np.floor(place / _PLACE_M).astype(int)
    return BoxContents(None, "", 0.0, f"place {cell[0]} {cell[1]} {cell[2]}", octant_of(frame.T_world_camera[:3, 3] - place))


def _cut(image: NDArray[np.uint16], box: Box, share: float) -> NDArray[np.uint16]:
    """The pixels of the middle ``share`` of a box, as far as they lie in the image; at least one pixel wide where it is inside."""
    x, y = (box[0] + box[2]) / 2.0, (box[1] + box[3]) / 2.0
    half_w, half_h = share * (box[2] - box[0]) / 2.0, share * (box[3] - box[1]) / 2.0
    rows = slice(max(int(np.floor(y - half_h)), 0), max(int(np.ceil(y + half_h)), 0))
    columns = slice(max(int(np.floor(x - half_w)), 0), max(int(np.ceil(x + half_w)), 0))
    return image[rows, columns]


def _owner(middle: NDArray[np.uint16]) -> int | None:
    counts = np.bincount(middle.ravel(), minlength=1)
    counts[0] = 0
    most = int(counts.argmax())
    return most if counts[most] and counts[most] >= LEAST_OF_MIDDLE * middle.size else None
