"""Boxes of what is not there: phantoms at fixed places, and loose ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.draws import generator
from seo_slam.simulation.labels import PHANTOM_LABELS
from seo_slam.simulation.simulated_box import SimulatedBox, clipped_score
from seo_slam.simulation.visible import View
from seo_slam.simulation.world import STRUCTURE_ID

_BEFORE_M = 0.05  # what is this much nearer than a spot hides it


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


def phantom_boxes(spots: Sequence[PhantomSpot], view: View, knobs: DetectorKnobs, seed: int) -> Iterator[SimulatedBox]:
    """Yield the phantoms of a view: those whose place is in it, not hidden by anything, and drawn this time."""
    for k, spot in enumerate(spots):
        draws = generator(seed, "phantom", k, view.index)
        if draws.random() >= knobs.phantom_rate:
            continue
        score = clipped_score(draws.uniform(0.3, 0.65))
        p_camera = transform_points(inverse(view.T_world_camera), spot.p_world)
        uv = view.camera.project(p_camera)
        if _in_sight(p_camera, uv, view):
            half = 0.5 * spot.size_m * view.camera.fx / p_camera[2]
            box = SimulatedBox(np.tile(uv, 2) + half * np.array([-1, -1, 1, 1]), spot.label, score)
            yield box.jittered(knobs.box_jitter, draws)


def _in_sight(p_camera: FloatArray, uv: FloatArray, view: View) -> bool:
    """Whether a spot is in the image, with nothing before it: a thing that was put there later hides it as well."""
    height, width = view.rendered.depth_m.shape
    if not (np.isfinite(uv).all() and 0 <= uv[0] < width - 1 and 0 <= uv[1] < height - 1):
        return False
    row, column = round(float(uv[1])), round(float(uv[0]))
    is_structure = view.rendered.instance_ids[row, column] == STRUCTURE_ID
    return bool(is_structure and view.rendered.depth_m[row, column] >= p_camera[2] - _BEFORE_M)


def spurious_boxes(view: View, knobs: DetectorKnobs, seed: int) -> Iterator[SimulatedBox]:
    """Yield the loose false boxes of a view: anywhere, of any word."""
    draws = generator(seed, "spurious", view.index)
    words = (*PHANTOM_LABELS, *sorted({thing.label for thing in view.world.things}))
    for _ in range(int(draws.poisson(knobs.spurious))):
        centre = draws.uniform(0, 1, 2) * [view.camera.width, view.camera.height]
        half = draws.uniform(0.03, 0.12, 2) * view.camera.width
        label = str(draws.choice(words))
        yield SimulatedBox(np.concatenate([centre - half, centre + half]), label, clipped_score(draws.uniform(0.2, 0.5)))
