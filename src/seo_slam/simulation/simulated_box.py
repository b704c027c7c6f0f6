"""One box of the simulated detector, on its way from the truth to what is reported."""

from dataclasses import dataclass, replace

import numpy as np

from seo_slam.camera import Camera
from seo_slam.geometry import FloatArray
from seo_slam.simulation.masks import Patch


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedBox:
    """A box and where it comes from.

    Attributes:
        box_px: (4,) x0, y0, x1, y1.
        label, score: as reported.
        thing_ids: what is in it: one thing, two that were merged, none for a false box.
        patch: its mask; None while a false box has none yet.
    """

    box_px: FloatArray
    label: str
    score: float
    thing_ids: tuple[int, ...] = ()
    patch: Patch | None = None

    @property
    def diagonal_px(self) -> float:
        """Length of its diagonal."""
        return float(np.hypot(*(self.box_px[2:] - self.box_px[:2])))

    def gap_px(self, other: "SimulatedBox") -> float:
        """Return how far it is from another box; 0 if they overlap."""
        apart = np.maximum(np.maximum(self.box_px[:2] - other.box_px[2:], other.box_px[:2] - self.box_px[2:]), 0.0)
        return float(np.hypot(*apart))

    def joined(self, other: "SimulatedBox") -> "SimulatedBox":
        """Return one box around both, under this one's label."""
        low = np.minimum(self.box_px[:2], other.box_px[:2])
        high = np.maximum(self.box_px[2:], other.box_px[2:])
        both = [box.patch for box in (self, other) if box.patch is not None]
        patch = both[0].joined(both[1]) if len(both) == 2 else None
        ids = (*self.thing_ids, *other.thing_ids)
        return SimulatedBox(np.concatenate([low, high]), self.label, min(self.score, other.score), ids, patch)

    def cut(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Return the boxes of its two parts when its longer side is cut at ``share`` of its length."""
        x0, y0, x1, y1 = self.box_px
        if x1 - x0 >= y1 - y0:
            at = x0 + share * (x1 - x0)
            return np.array([x0, y0, at, y1]), np.array([at, y0, x1, y1])
        at = y0 + share * (y1 - y0)
        return np.array([x0, y0, x1, at]), np.array([x0, at, x1, y1])

    def jittered(self, share: float, draws: np.random.Generator) -> "SimulatedBox":
        """Return it with every edge moved by a normal draw, of ``share`` of the box's size."""
        size = np.tile(self.box_px[2:] - self.box_px[:2], 2)
        return replace(self, box_px=self.box_px + share * size * draws.standard_normal(4))

    def finished(self, camera: Camera) -> "SimulatedBox | None":
        """Return what is reported of it: the part in the image, to a hundredth of a pixel, with the mask in it.

        A box that none of its pixels is in, as every false one, has an ellipse. None if less than a pixel of the box is left.
        """
        limits = np.array([camera.width, camera.height, camera.width, camera.height], dtype=np.float64)
        box_px = np.asarray(np.round(np.clip(self.box_px, 0.0, limits), 2), dtype=np.float64)
        if (box_px[2:] - box_px[:2] < 1.0).any():
            return None
        own = None if self.patch is None else self.patch.inside(box_px)
        return replace(self, box_px=box_px, patch=Patch.ellipse(box_px) if own is None else own)


def clipped_score(value: float) -> float:
    """Return a score as it is reported: between 0.05 and 0.99, to four digits."""
    return round(min(max(float(value), 0.05), 0.99), 4)
