"""Segments of everything in an image, without names: what a class-agnostic network such as FastSAM gives.

Every thing is one segment, named or not. Structure (walls, floor, furniture without an id) falls into its surfaces, cut where depth
jumps or bends. Small segments are missed as the detector's knobs say; the masks of those that are found are exact.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from seo_slam.camera import Camera
from seo_slam.errors import FrameError
from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.draws import generator
from seo_slam.simulation.masks import KeptDetections, PackedMasks, Patch, patches_of
from seo_slam.simulation.renderer import Rendered
from seo_slam.simulation.simulated_box import clipped_score
from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.visible import View
from seo_slam.simulation.world import STRUCTURE_ID
from seo_slam.types import BoolArray, Detections, Frame

BEND = 0.15
"""Change of a surface's slant across one pixel, relative to its distance, from which it is another surface."""


class SimulatedSegmenter:
    """A ``Detector`` of everything: boxes, masks and scores, each label None."""

    def __init__(self, knobs: DetectorKnobs | None = None, seed: int = 0) -> None:
        """Make a segmenter; without knobs a perfect one.

        Args:
            knobs: ``miss``, ``visibility`` (here: of small segments) and ``smallest_px`` are heeded, the others are a detector's only.
            seed: of all draws.
        """
        self.knobs = knobs or DetectorKnobs()
        self.seed = seed
        self._shown: dict[float, KeptDetections] = {}

    @classmethod
    def of(cls, recording: SimulatedRecording) -> "SimulatedSegmenter":
        """Return a segmenter with the knobs and seed of a recording; it knows the frames that are drawn from now on."""
        segmenter = cls(recording.detector_knobs, recording.seed)
        recording.show_to(segmenter)
        return segmenter

    def show(self, timestamp_s: float, view: View) -> None:
        """Tell what is in the frame of this stamp; ``detect`` can then be asked for it."""
        found = sorted(self._found(view), key=lambda row: -row[0])
        patches = [patch for _, patch in found]
        self._shown[timestamp_s] = KeptDetections(
            boxes_px=np.array([patch.box_px() for patch in patches], dtype=np.float64).reshape(-1, 4),
            labels=(None,) * len(patches),
            scores=np.array([score for score, _ in found], dtype=np.float64),
            masks=PackedMasks(patches, *view.rendered.instance_ids.shape),
        )

    def detect(self, frame: Frame) -> Detections:
        """Return the segments of a frame, those that are easiest to see first.

        Raises:
            FrameError: the frame was never shown.
        """
        if frame.timestamp_s not in self._shown:
            raise FrameError(f"frame {frame.index} (t={frame.timestamp_s}): not a frame that was shown to the simulated segmenter")
        return self._shown[frame.timestamp_s].detections()

    def _found(self, view: View) -> Iterator[tuple[float, Patch]]:
        """Score and pixels of every segment that is not missed."""
        smallest_px = self.knobs.smallest_in(*view.rendered.instance_ids.shape)
        things = [((f"thing {thing_id}",), patch) for thing_id, patch in patches_of(view.rendered.instance_ids).items()]
        surfaces = [((f"surface {k}",), patch) for k, patch in patches_of(surfaces_of(view.rendered, view.camera)).items()]
        for key, patch in (*things, *surfaces):
            area_px = int(patch.pixels.sum())
            if area_px < smallest_px:
                continue
            ease = 1.0 - self.knobs.visibility * float(np.exp(-area_px / (4.0 * smallest_px)))
            if generator(self.seed, "segment", *key, view.index).random() < (1.0 - self.knobs.miss) * ease:
                yield clipped_score(0.6 + 0.32 * ease), patch


def surfaces_of(rendered: Rendered, camera: Camera) -> NDArray[np.int32]:
    """Return (H, W) which surface of structure each pixel is on: 1, 2, … from the top of the image; 0 for things and emptiness."""
    structure = (rendered.instance_ids == STRUCTURE_ID) & (rendered.depth_m > 0)
    labels = ndimage.label(structure & ~_bends(rendered, camera))[0].astype(np.int32)
    grown = ndimage.maximum_filter(labels, size=3)  # a pixel at an edge goes to a surface beside it
    return np.where(structure & (labels == 0), grown, labels).astype(np.int32)


def _bends(rendered: Rendered, camera: Camera) -> BoolArray:
    """Return (H, W) where a surface ends: the inverse depth of a plane is linear in the image, so that its second differences tell."""
    depth_m = rendered.depth_m.astype(np.float64)
    nearness = 1.0 / np.where(depth_m > 0, depth_m, np.inf)
    bends = np.zeros(depth_m.shape, dtype=np.bool_)
    for axis, focal_px in ((0, camera.fy), (1, camera.fx)):
        inner: list[slice] = [slice(None), slice(None)]
        inner[axis] = slice(1, -1)
        place = (inner[0], inner[1])
        bends[place] |= np.abs(np.diff(nearness, n=2, axis=axis)) * focal_px * depth_m[place] > BEND
    return bends
