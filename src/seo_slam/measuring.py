"""From a frame to detections and observations: what a keyframe measures before the map is asked anything."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from seo_slam.composition import Parts
from seo_slam.config import Config
from seo_slam.perception.adapters import to_detections
from seo_slam.perception.class_list import ClassList
from seo_slam.perception.features import ObservationFeatures
from seo_slam.perception.labels import clean_label
from seo_slam.perception.lifting import observe
from seo_slam.perception.mask_clouds import box_masks, mask_clouds
from seo_slam.records import FeatureRecipe
from seo_slam.stages import StageClock
from seo_slam.types import BoolArray, Detections, Frame, Observations


class Measuring:
    """Detect, lift, and give every observation its feature and its cloud. Changes nothing of the map."""

    def __init__(self, config: Config, parts: Parts, clock: StageClock) -> None:
        """Take the detector and embedder among ``parts``; ``clock`` counts the seconds."""
        self._config = config
        self._parts = parts
        self._clock = clock
        known = config.features.classes or tuple(ClassList.of_detector(parts.detector) or ())
        self._features = ObservationFeatures(config.features.model_copy(update={"classes": known}), parts.embedder)
        self._wanted = {(clean_label(word) or "").casefold() for word in config.features.classes} if config.features.only_classes else None
        self._is_warm = False

    @property
    def recipe(self) -> FeatureRecipe | None:
        """How features are made; None where things are known by their words alone, as without clouds."""
        return self._features.recipe if self._config.clouds.enabled or self._config.features.image_weight > 0 else None

    def measure(self, frame: Frame, warnings: list[str]) -> tuple[Detections, Observations]:
        """Return what is seen, camera frame; what is worth knowing is added to ``warnings``.

        Raises:
            FrameError: the detector returned what cannot be.
        """
        parts = self._parts
        if not self._is_warm:
            with self._clock.stage("warm up"):  # a text model loads when it is first asked
                parts.embedder.embed_text(["thing"])
            self._is_warm = True
        with self._clock.stage("detect"):
            detections = to_detections(parts.detector.detect(frame), frame, type(parts.detector).__name__)
            if self._wanted is not None:
                detections = _of_classes(detections, self._wanted)
            warnings += getattr(parts.detector, "notes", ())
        if not len(detections):
            warnings.append("no detections")
        with self._clock.stage("observe"):
            if not frame.has_depth:
                warnings.append("the frame has no depth, its detections cannot be placed")
                return detections, Observations.empty(parts.embedder.size)
            observations, left_out = observe(detections, frame, self._config.lifting)
            warnings += left_out
            if not len(observations):
                return detections, Observations.empty(parts.embedder.size)
            own = None if detections.embeddings is None else detections.embeddings[observations.rows]
            features, notes = self._features.of(frame, observations.boxes_px, observations.labels, own)
            warnings += notes
            observations = replace(observations, embeddings=features)
        if self._config.clouds.enabled:
            with self._clock.stage("clouds"):
                observations = self._with_clouds(detections, observations, frame)
        return detections, observations

    def _with_clouds(self, detections: Detections, observations: Observations, frame: Frame) -> Observations:
        """Give observations their whole clouds, and leave out those that have none."""
        masks = _all_masks(detections[observations.rows], frame, self._config.lifting.max_depth_m)
        clouds = mask_clouds(masks, frame.depth_m, frame.camera, self._config.clouds, self._config.lifting.max_depth_m)
        kept = np.array([len(cloud) > 0 for cloud in clouds], dtype=np.bool_)
        return replace(observations, clouds=clouds)[kept]


def _of_classes(detections: Detections, wanted: Collection[str]) -> Detections:
    """Those whose word is wanted, or that have none."""
    kept = np.array([label is None or label.casefold() in wanted for label in detections.labels], dtype=np.bool_)
    return detections if kept.all() else detections[kept]


def _all_masks(detections: Detections, frame: Frame, max_depth_m: float) -> BoolArray:
    """(N, H, W): the detector's masks; where it has none, what in the box is as near as the object."""
    boxes_px = detections.boxes_px
    if detections.masks is None:
        return box_masks(boxes_px, frame.depth_m, frame.camera, max_depth_m)
    masks = detections.masks
    bare = ~masks.any(axis=(1, 2))
    if bare.any():
        masks = masks.copy()
        masks[bare] = box_masks(boxes_px[bare], frame.depth_m, frame.camera, max_depth_m)
    return masks
