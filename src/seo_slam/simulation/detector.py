"""A detector that knows the truth and gets it wrong in the ways that real ones do.

It is given the instance image of each frame (``show``) and answers ``detect`` for that frame. What goes wrong is set by
``DetectorKnobs``; every draw is keyed by the seed, the thing, and the frame or the side from which the thing is seen, so that the
same mistakes come back however frames are asked for.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.simulation.draws import generator
from seo_slam.simulation.labels import LOOK_ALIKES, PHANTOM_LABELS
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.sensors import require_level
from seo_slam.simulation.world import STRUCTURE_ID, Thing, World
from seo_slam.types import Detections, Frame


@dataclass(frozen=True, slots=True)
class DetectorKnobs:
    """How imperfect the detector is.

    Attributes:
        miss: chance that a thing in plain view is missed in a frame.
        visibility: how much small, hidden and cut-off things are missed beyond that (0: not at all, 1: fully).
        relabel: chance that a box bears a look-alike's label.
        sticky: share of the label draws that belong to the thing and the side it is seen from; the rest are made anew each frame.
        box_jitter: standard deviation of each edge, as a share of the box's size.
        merge: chance that two neighbours of one class, closer than half the smaller box's diagonal, come as one box.
        split: chance that a thing comes as two boxes: half of the time cut in two, half of the time seen twice.
        phantom_spots, phantom_rate: fixed places where something is seen that is not there, and how often when in view.
        spurious: mean number of loose false boxes a frame.
        smallest_px: visible pixels, in a 640x480 image, below which nothing is detected; scaled to the size of the image.
    """

    miss: float = 0.0
    visibility: float = 0.0
    relabel: float = 0.0
    sticky: float = 0.7
    box_jitter: float = 0.0
    merge: float = 0.0
    split: float = 0.0
    phantom_spots: int = 0
    phantom_rate: float = 0.35
    spurious: float = 0.0
    smallest_px: float = 60.0

    @classmethod
    def at_level(cls, level: float) -> Self:
        """Return the knobs of a level: 0 is perfect, 1 the reference.

        Raises:
            ConfigError: the level is below 0.
        """
        require_level(level)

        def chance(at_one: float) -> float:
            return min(at_one * level, 0.95)

        return cls(
            miss=chance(0.12),
            visibility=min(level, 1.0),
            relabel=chance(0.22),
            box_jitter=0.04 * level,
            merge=chance(0.35),
            split=chance(0.06),
            phantom_spots=int(6 * level),
            spurious=0.15 * level,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PhantomSpot:
    """A place where the detector sees something that is not there.

    Attributes:
        p_world: (3,) metres.
        size_m: side of its square box.
        label: what it is taken for.
    """

    p_world: FloatArray
    size_m: float
    label: str


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """All that the simulated detector knows about a frame.

    Attributes:
        index: number of the frame, key of its draws.
        world, camera: what there is, and with what it is seen.
        T_world_camera: (4, 4) true pose.
        rendered: instance image and depth of the perfect camera.
    """

    index: int
    world: World
    camera: Camera
    T_world_camera: FloatArray
    rendered: Rendered


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedBox:
    """A box and where it comes from.

    Attributes:
        box_px: (4,) x0, y0, x1, y1.
        label, score: as reported.
        thing_ids: what is in it: one thing, two that were merged, none for a false box.
    """

    box_px: FloatArray
    label: str
    score: float
    thing_ids: tuple[int, ...] = ()


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
        self.look_alikes = look_alikes
        self._shown: dict[float, Detections] = {}

    def show(self, timestamp_s: float, view: View) -> None:
        """Tell what is in the frame of this stamp; ``detect`` can then be asked for it."""
        self._shown[timestamp_s] = _as_detections(self.boxes(view))

    def detect(self, frame: Frame) -> Detections:
        """Return what is seen in a frame.

        Raises:
            FrameError: the frame was never shown.
        """
        if frame.timestamp_s not in self._shown:
            raise FrameError(f"frame {frame.index} (t={frame.timestamp_s}): not a frame that was shown to the simulated detector")
        return self._shown[frame.timestamp_s]

    def boxes(self, view: View) -> list[SimulatedBox]:
        """Return all boxes of a view, best score first. A pure function of the view, the knobs and the seed."""
        seen = [box for thing in view.world.things if (box := self._see(thing, view)) is not None]
        true = [part for box in self._merged(seen, view) for part in self._split(box, view)]
        jittered = [self._jittered(box, k, view) for k, box in enumerate(true)]
        found = [*jittered, *self._phantoms(view), *self._spurious(view)]
        clipped = [box for raw in found if (box := _clipped(raw, view.camera)) is not None]
        return sorted(clipped, key=lambda box: -box.score)

    def _see(self, thing: Thing, view: View) -> SimulatedBox | None:
        mask = view.rendered.instance_ids == thing.id
        visible_px = int(mask.sum())
        smallest_px = self.knobs.smallest_px * mask.size / (640 * 480)
        if visible_px < max(smallest_px, 1):
            return None
        ease = self.knobs.visibility * (visibility(thing, view, visible_px, smallest_px) - 1.0) + 1.0
        draws = generator(self.seed, "see", thing.id, view.index)
        chance, noise = float(draws.random()), float(draws.standard_normal())
        if chance >= (1.0 - self.knobs.miss) * ease:
            return None
        label = self._label(thing, view)
        score = 0.6 + 0.32 * ease - (0.15 if label != thing.label else 0.0) + 0.05 * self.knobs.visibility * noise
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        box_px = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], dtype=np.float64)
        return SimulatedBox(box_px, label, _score(score), (thing.id,))

    def _label(self, thing: Thing, view: View, again: int = 0) -> str:
        """The label of a thing, or of a look-alike: drawn for the side it is seen from, or now and then for this frame."""
        others = self.look_alikes.get(thing.label, ())
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
            for other in left:
                pair = (*box.thing_ids, *other.thing_ids)
                same = view.world.thing(pair[0]).label == view.world.thing(pair[1]).label
                if (
                    same
                    and _gap_px(box.box_px, other.box_px) < 0.5 * min(_diagonal_px(box.box_px), _diagonal_px(other.box_px))
                    and generator(self.seed, "merge", *pair, view.index).random() < self.knobs.merge
                ):
                    low = np.minimum(box.box_px[:2], other.box_px[:2])
                    high = np.maximum(box.box_px[2:], other.box_px[2:])
                    box = SimulatedBox(np.concatenate([low, high]), box.label, min(box.score, other.score), pair)
                    left.remove(other)
                    break
            out.append(box)
        return out

    def _split(self, box: SimulatedBox, view: View) -> list[SimulatedBox]:
        """One box, or now and then two: the thing cut in two, or seen twice."""
        draws = generator(self.seed, "split", *box.thing_ids, view.index)
        chance, twice, at = draws.random(), draws.random() < 0.5, float(draws.uniform(0.35, 0.65))
        if chance >= self.knobs.split:
            return [box]
        weaker = _score(box.score - 0.2)
        if twice:
            label = self._label(view.world.thing(box.thing_ids[0]), view, again=1)
            return [box, replace(box, label=label, score=weaker)]
        x0, y0, x1, y1 = box.box_px
        if x1 - x0 >= y1 - y0:
            cut = x0 + at * (x1 - x0)
            halves = np.array([[x0, y0, cut, y1], [cut, y0, x1, y1]])
        else:
            cut = y0 + at * (y1 - y0)
            halves = np.array([[x0, y0, x1, cut], [x0, cut, x1, y1]])
        return [replace(box, box_px=half, score=weaker) for half in halves]

    def _jittered(self, box: SimulatedBox, k: int, view: View) -> SimulatedBox:
        if not self.knobs.box_jitter:
            return box
        size = np.tile(box.box_px[2:] - box.box_px[:2], 2)
        noise = generator(self.seed, "jitter", *box.thing_ids, k, view.index).standard_normal(4)
        return replace(box, box_px=box.box_px + self.knobs.box_jitter * size * noise)

    def _phantoms(self, view: View) -> Iterable[SimulatedBox]:
        T_camera_world = inverse(view.T_world_camera)
        height, width = view.rendered.depth_m.shape
        for k, spot in enumerate(self.phantoms):
            p_camera = transform_points(T_camera_world, spot.p_world)
            uv = view.camera.project(p_camera)
            if not (np.isfinite(uv).all() and 0 <= uv[0] < width - 1 and 0 <= uv[1] < height - 1):
                continue
            row, column = round(float(uv[1])), round(float(uv[0]))
            hidden = view.rendered.instance_ids[row, column] != STRUCTURE_ID or view.rendered.depth_m[row, column] < p_camera[2] - 0.05
            draws = generator(self.seed, "phantom", k, view.index)
            if hidden or draws.random() >= self.knobs.phantom_rate:
                continue
            half = 0.5 * spot.size_m * view.camera.fx / p_camera[2] * (1.0 + self.knobs.box_jitter * draws.standard_normal(4))
            yield SimulatedBox(np.tile(uv, 2) + half * [-1, -1, 1, 1], spot.label, _score(draws.uniform(0.3, 0.65)))

    def _spurious(self, view: View) -> Iterable[SimulatedBox]:
        draws = generator(self.seed, "spurious", view.index)
        words = (*PHANTOM_LABELS, *sorted({thing.label for thing in view.world.things}))
        for _ in range(int(draws.poisson(self.knobs.spurious))):
            centre = draws.uniform(0, 1, 2) * [view.camera.width, view.camera.height]
            half = draws.uniform(0.03, 0.12, 2) * view.camera.width
            yield SimulatedBox(np.concatenate([centre - half, centre + half]), str(draws.choice(words)), _score(draws.uniform(0.2, 0.5)))


def visibility(thing: Thing, view: View, visible_px: int, smallest_px: float) -> float:
    """Return how easily a thing is seen, in 0..1: from its visible area, the share that is not hidden, and the share inside the image."""
    area = 1.0 - float(np.exp(-visible_px / (4.0 * max(smallest_px, 1.0))))
    free = visible_px / max(view.rendered.covered_px.get(thing.id, visible_px), visible_px)
    uv = view.camera.project(transform_points(inverse(view.T_world_camera), thing.corners_world()))
    if not np.isfinite(uv).all():
        return area * _ramp(free, 0.1, 0.5)
    low, high = uv.min(axis=0), uv.max(axis=0)
    inside = np.clip(np.minimum(high, [view.camera.width, view.camera.height]) - np.maximum(low, 0.0), 0.0, None)
    return area * _ramp(free, 0.1, 0.5) * _ramp(float(np.prod(inside) / np.prod(high - low)), 0.1, 0.6)


def octant(thing: Thing, view: View) -> int:
    """Return from which of eight sides (45 degrees each, around the vertical) a thing is seen."""
    x, y = (view.T_world_camera[:3, 3] - thing.p_world)[:2]
    return int(np.floor(np.arctan2(y, x) / (np.pi / 4.0))) % 8


def _ramp(value: float, low: float, high: float) -> float:
    s = min(max((value - low) / (high - low), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


def _gap_px(a: FloatArray, b: FloatArray) -> float:
    apart = np.maximum(np.maximum(a[:2] - b[2:], b[:2] - a[2:]), 0.0)
    return float(np.hypot(*apart))


def _diagonal_px(box: FloatArray) -> float:
    return float(np.hypot(box[2] - box[0], box[3] - box[1]))


def _score(value: float) -> float:
    return round(min(max(float(value), 0.05), 0.99), 4)


def _clipped(box: SimulatedBox, camera: Camera) -> SimulatedBox | None:
    """The part of a box that is in the image, to a hundredth of a pixel; None if less than a pixel is left."""
    limits = np.array([camera.width, camera.height, camera.width, camera.height], dtype=np.float64)
    box_px = np.asarray(np.round(np.clip(box.box_px, 0.0, limits), 2), dtype=np.float64)
    if (box_px[2:] - box_px[:2] < 1.0).any():
        return None
    return replace(box, box_px=box_px)


def _as_detections(boxes: Sequence[SimulatedBox]) -> Detections:
    if not boxes:
        return Detections.empty()
    return Detections(
        boxes_px=np.stack([box.box_px for box in boxes]),
        labels=tuple(box.label for box in boxes),
        scores=np.array([box.score for box in boxes]),
    )
