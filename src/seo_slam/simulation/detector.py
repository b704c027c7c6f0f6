"""A detector that knows the truth and gets it wrong in the ways that real ones do.

It is given the instance image of each frame (``show``) and answers ``detect`` for that frame. What goes wrong is set by
``DetectorKnobs``; every draw is keyed by the seed, the thing, and the frame or the side from which the thing is seen, so that the
same mistakes come back however frames are asked for, and whatever else is in the image.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.draws import generator
from seo_slam.simulation.false_boxes import PhantomSpot, phantom_boxes, spurious_boxes
from seo_slam.simulation.labels import LOOK_ALIKES
from seo_slam.simulation.masks import KeptDetections, PackedMasks, Patch, patches_of
from seo_slam.simulation.simulated_box import SimulatedBox, clipped_score
from seo_slam.simulation.visible import View, octant, visibility
from seo_slam.simulation.world import Thing
from seo_slam.types import Detections, Frame

__all__ = ["DetectorKnobs", "PhantomSpot", "SimulatedBox", "SimulatedDetector", "View", "octant", "visibility"]


class SimulatedDetector:
    """A ``Detector`` for simulated frames."""

    def __init__(
        self,
        knobs: DetectorKnobs | None = None,
        seed: int = 0,
        phantoms: Sequence[PhantomSpot] = (),
        look_alikes: Mapping[str, tuple[str, ...]] = LOOK_ALIKES,
    ) -> None:
        """Make a detector; without knobs a perfect one.

        Args:
            knobs: what goes wrong, and how often.
            seed: of all draws.
            phantoms: places where it sees what is not there.
            look_alikes: label -> labels that it is taken for; other labels are never mistaken.
        """
        self.knobs = knobs or DetectorKnobs()
        self.seed = seed
        self.phantoms = tuple(phantoms)
        self.look_alikes = {label.casefold(): others for label, others in look_alikes.items()}
        self._shown: dict[float, KeptDetections] = {}

    def show(self, timestamp_s: float, view: View) -> None:
        """Tell what is in the frame of this stamp; ``detect`` can then be asked for it."""
        boxes = self.boxes(view)
        self._shown[timestamp_s] = KeptDetections(
            boxes_px=np.array([box.box_px for box in boxes], dtype=np.float64).reshape(-1, 4),
            labels=tuple(box.label for box in boxes),
            scores=np.array([box.score for box in boxes], dtype=np.float64),
            masks=PackedMasks([box.patch for box in boxes if box.patch is not None], *view.rendered.instance_ids.shape),
        )

    def detect(self, frame: Frame) -> Detections:
        """Return what is seen in a frame, with the mask of every box: the pixels of the thing in it, exact; an ellipse in a false box.

        Raises:
            FrameError: the frame was never shown.
        """
        if frame.timestamp_s not in self._shown:
            raise FrameError(f"frame {frame.index} (t={frame.timestamp_s}): not a frame that was shown to the simulated detector")
        return self._shown[frame.timestamp_s].detections()

    def boxes(self, view: View) -> list[SimulatedBox]:
        """Return all boxes of a view, best score first. A pure function of the view, the knobs and the seed."""
        patches = patches_of(view.rendered.instance_ids)
        things = sorted(view.world.things, key=lambda thing: thing.id)
        seen = [box for thing in things if thing.id in patches and (box := self._see(thing, patches[thing.id], view)) is not None]
        true = [part for box in self._merged(seen, view) for part in self._reported(box, view)]
        false = [*phantom_boxes(self.phantoms, view, self.knobs, self.seed), *spurious_boxes(view, self.knobs, self.seed)]
        finished = [box for raw in (*true, *false) if (box := raw.finished(view.camera)) is not None]
        return sorted(finished, key=lambda box: -box.score)

    def _see(self, thing: Thing, patch: Patch, view: View) -> SimulatedBox | None:
        visible_px = int(patch.pixels.sum())
        smallest_px = self.knobs.smallest_in(*view.rendered.instance_ids.shape)
        if visible_px < smallest_px:
            return None
        ease = 1.0
        if self.knobs.visibility:
            ease += self.knobs.visibility * (visibility(thing, view, visible_px, smallest_px) - 1.0)
        draws = generator(self.seed, "see", thing.id, view.index)
        chance, noise = float(draws.random()), float(draws.standard_normal())
        if chance >= (1.0 - self.knobs.miss) * ease:
            return None
        label = self._label(thing, view)
        score = 0.6 + 0.32 * ease - (0.15 if label != thing.label else 0.0) + 0.05 * self.knobs.visibility * noise
        return SimulatedBox(patch.box_px(), label, clipped_score(score), (thing.id,), patch)

    def _label(self, thing: Thing, view: View, again: int = 0) -> str:
        """The label of a thing, or of a look-alike: drawn for the side it is seen from, or now and then for this frame."""
        others = self.look_alikes.get(thing.label.casefold(), ())
        if not others or not self.knobs.relabel:
            return thing.label
        fresh = generator(self.seed, "label", thing.id, view.index, again)
        sticks = bool(fresh.random() < self.knobs.sticky) and not again
        draws = generator(self.seed, "label", thing.id, f"octant {octant(thing, view)}") if sticks else fresh
        return str(draws.choice(others)) if draws.random() < self.knobs.relabel else thing.label

    def _merged(self, boxes: list[SimulatedBox], view: View) -> list[SimulatedBox]:
        """Join some pairs of neighbours of one class."""
        left, out = list(boxes), []
        while left:
            box = left.pop(0)
            partner = next((other for other in left if self._run_together(box, other, view)), None)
            if partner is not None:
                left.remove(partner)
                box = box.joined(partner)
            out.append(box)
        return out

    def _run_together(self, a: SimulatedBox, b: SimulatedBox, view: View) -> bool:
        pair = (*a.thing_ids, *b.thing_ids)
        if not self.knobs.merge or view.world.thing(pair[0]).label != view.world.thing(pair[1]).label:
            return False
        near = a.gap_px(b) < 0.5 * min(a.diagonal_px, b.diagonal_px)
        return near and bool(generator(self.seed, "merge", *pair, view.index).random() < self.knobs.merge)

    def _reported(self, box: SimulatedBox, view: View) -> list[SimulatedBox]:
        """The parts of a box, with their edges moved."""
        parts = self._split(box, view)
        if not self.knobs.box_jitter:
            return parts
        draws = [generator(self.seed, "jitter", *box.thing_ids, part, view.index) for part in range(len(parts))]
        return [part.jittered(self.knobs.box_jitter, own) for part, own in zip(parts, draws, strict=True)]

    def _split(self, box: SimulatedBox, view: View) -> list[SimulatedBox]:
        """One box, or now and then two: the thing cut in two, or seen twice."""
        if not self.knobs.split:
            return [box]
        draws = generator(self.seed, "split", *box.thing_ids, view.index)
        chance, twice, at = draws.random(), draws.random() < 0.5, float(draws.uniform(0.35, 0.65))
        if chance >= self.knobs.split:
            return [box]
        weaker = clipped_score(box.score - 0.2)
        if twice:
            label = self._label(view.world.thing(box.thing_ids[0]), view, again=1)
            return [box, replace(box, label=label, score=weaker)]
        return [replace(box, box_px=half, score=weaker) for half in box.cut(at)]
