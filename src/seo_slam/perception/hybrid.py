"""DualMap's front end (III-A1): a detector that knows words, and a segmenter that sees whatever else there is."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError

from seo_slam import registry
from seo_slam.config import Component
from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Detector
from seo_slam.perception.adapters import to_detections
from seo_slam.perception.background import BACKGROUND, is_background
from seo_slam.perception.box_masks import DepthMasker, Masker
from seo_slam.perception.class_list import ClassList
from seo_slam.perception.colour_merge import merged
from seo_slam.perception.features import embedded_pictures, sees
from seo_slam.perception.mask_overlap import Masks
from seo_slam.perception.novel_segments import joined, novel, parted
from seo_slam.perception.structure import is_structure
from seo_slam.settings.hybrid import HybridSettings, StructureSettings
from seo_slam.settings.observing import FeatureSettings
from seo_slam.types import BoolArray, Detections, Frame

StructureRule = Literal["auto", "looks", "shape", "keep"]


class HybridDetector:
    """A ``Detector`` made of two: named boxes first, then segments without a word of what the boxes leave out.

    Each frame: detections without background words; a mask for each; boxes of one thing merged by overlap and colour; segments that
    overlap none of them added, label None, unless they are structure; no two masks share a pixel, small ones are dropped. (A word that is
    not among the classes does not keep a segment of the same thing out: a thing without a known word is still a thing.)

    Attributes:
        detector, segmenter, masker: its parts; without a segmenter only what has a word is found.
        classes: the words that are kept; None: all.
        notes: what a user should be told about the last frame.
    """

    def __init__(
        self,
        detector: Any,
        segmenter: Any = None,
        masker: Masker | None = None,
        classes: ClassList | Iterable[str] | str | Path | None = None,
        background: Sequence[str] = BACKGROUND,
        refine: bool = True,
        structure: StructureRule = "auto",
        image_encoder: Any = None,
        settings: HybridSettings | Mapping[str, Any] | None = None,
        structure_settings: StructureSettings | Mapping[str, Any] | None = None,
    ) -> None:
        """Put the front end together.

        Args:
            detector: finds things with words: an object, a registered name, or ``{"name": …, "options": {…}}``.
            segmenter: a detector of segments, whose words are not looked at; None: no segments.
            masker: boxes to masks, for detections without a mask; None: by depth.
            classes: a class list, words, or the path of a file of words; detections of other words are dropped. None: none are.
            background: words of what is no thing; see ``is_background``.
            refine: merge boxes of one thing.
            structure: how walls, floor and ceiling are told among the segments: "looks": their picture is nearer to a background word
                than to a class; "shape": see ``perception.structure``; "auto": either tells, shape alone without an image encoder; "keep":
                not at all.
            image_encoder: for "looks" and "auto": an ``ImageEmbedder``, or something with ``embed_crops`` and ``embed_text``.
            settings: thresholds, as ``HybridSettings`` or a mapping of some of them.
            structure_settings: those of "shape", likewise.

        Raises:
            ConfigError: a part that is none, a setting out of range, duplicates in the class list, or "looks" without an image encoder.
            UnknownBackendError, MissingBackendError: a part cannot be made.
        """
        self.detector = _part(detector, "detector")
        self.segmenter = None if segmenter is None else _part(segmenter, "segmenter")
        self.masker = DepthMasker() if masker is None else masker
        if not isinstance(self.masker, Masker):
            raise ConfigError(f"hybrid: masker is a {type(masker).__name__}, wanted something with masks(frame, boxes_px)")
        self.classes = None if classes is None else ClassList.of(classes)
        self.background = tuple(background)
        self.refine = refine
        self._settings = _settings(HybridSettings, settings)
        self._structure_settings = _settings(StructureSettings, structure_settings)
        self._encoder = image_encoder
        _check_rule(structure, image_encoder)
        self._structure = structure
        self._said: dict[str, None] = dict.fromkeys(self.classes or ())
        self._last_segment_s: float | None = None
        self._silence_told = False
        self.notes: tuple[str, ...] = ()

    def detect(self, frame: Frame) -> Detections:
        """Return what is in a frame, each with a mask: first what has a word, then what has none.

        Raises:
            FrameError: the detector, the segmenter or the masker returned what does not fit the image, or embeddings of two lengths.
        """
        self.notes = ()
        found, background = self.named(frame)
        if self.refine:
            found = merged(found, frame.rgb, self._settings)
        if self.segmenter is not None:
            segments = self._unnamed(self.segmenter, frame, found, background)
            found = joined(found, segments, f"hybrid, frame {frame.index} (t={frame.timestamp_s})")
        return parted(found, self._settings)

    def named(self, frame: Frame) -> tuple[Detections, Detections]:
        """Return the detections that are kept for their words, and those whose word is background, each with a mask."""
        found = self._with_masks(to_detections(self.detector.detect(frame), frame, type(self.detector).__name__), frame)
        behind = np.array([is_background(label, self.background) for label in found.labels], dtype=np.bool_)
        wanted = np.array([self.classes is None or label in self.classes for label in found.labels], dtype=np.bool_)
        things = found if (wanted & ~behind).all() else found[wanted & ~behind]
        if self.classes is None:
            self._said |= dict.fromkeys(label for label in things.labels if label)
        return things, found[behind]

    def _unnamed(self, segmenter: Detector, frame: Frame, found: Detections, background: Detections) -> Detections:
        """The segments that show what was not found, without those that are background or structure."""
        segments = to_detections(segmenter.detect(frame), frame, type(segmenter).__name__)
        self._watch(frame, bool(len(segments)))
        segments = self._with_masks(segments, frame)
        segments = Detections(segments.boxes_px, (None,) * len(segments), segments.scores, segments.masks, segments.embeddings)
        masks, detected, behind = (Masks(_masks_of(part, frame)) for part in (segments, found, background))
        segments = segments[novel(masks, detected, behind, self._settings)]
        return segments[~self._is_structure(segments, frame)]

    def _with_masks(self, found: Detections, frame: Frame) -> Detections:
        """The same, with a mask for each that has none."""
        masks = _masks_of(found, frame)
        without = np.flatnonzero(Masks(masks).areas == 0)
        if len(without):
            masks = masks.copy()
            made = self.masker.masks(frame, found.boxes_px[without])
            wanted = (len(without), *frame.depth_m.shape)
            if not isinstance(made, np.ndarray) or made.shape != wanted or made.dtype != np.bool_:
                got = f"{made.dtype} {made.shape}" if isinstance(made, np.ndarray) else type(made).__name__
                where = f"frame {frame.index} (t={frame.timestamp_s})"
                raise FrameError(f"{type(self.masker).__name__}, {where}: masks are {got}, wanted bool {wanted}, the size of the image")
            masks[without] = made
        return Detections(found.boxes_px, found.labels, found.scores, masks, found.embeddings)

    def _is_structure(self, segments: Detections, frame: Frame) -> BoolArray:
        out = np.zeros(len(segments), dtype=np.bool_)
        if not len(segments):
            return out
        if self._structure in ("auto", "shape"):
            out |= is_structure(_masks_of(segments, frame), frame, self._structure_settings)
        if self._structure in ("auto", "looks") and self._encoder is not None and self._said and self.background:
            out |= looks_like(self._encoder, frame, segments.boxes_px, self.background, tuple(self._said))
        return out

    def _watch(self, frame: Frame, found: bool) -> None:
        """Note once if the segmenter has found nothing for long."""
        if found or self._last_segment_s is None:
            self._last_segment_s = frame.timestamp_s
        if found:
            self._silence_told = False
        silent_s = self._settings.silent_s
        if not self._silence_told and frame.timestamp_s - self._last_segment_s >= silent_s:
            self._silence_told = True
            name = type(self.segmenter).__name__
            self.notes = (
                *self.notes,
                f"the segmenter ({name}) has found nothing for {silent_s:g} s; the map goes on with named things only",
            )


def looks_like(encoder: Any, frame: Frame, boxes_px: FloatArray, these: Sequence[str], others: Sequence[str]) -> BoolArray:
    """Return (N,) whether the picture in each box (N, 4) is nearer to one of ``these`` words than to all ``others``."""
    pictures = embedded_pictures(encoder, frame, boxes_px, FeatureSettings().crop_margin_px)
    near = (pictures @ encoder.embed_text(list(these)).T).max(axis=1)
    far = (pictures @ encoder.embed_text(list(others)).T).max(axis=1)
    return np.asarray(near > far)


def _masks_of(found: Detections, frame: Frame) -> BoolArray:
    return np.zeros((len(found), *frame.depth_m.shape), dtype=np.bool_) if found.masks is None else found.masks


def _part(given: Any, what: str) -> Detector:
    if isinstance(given, Mapping):
        try:
            given = Component.model_validate(dict(given))
        except ValidationError as error:
            first = error.errors()[0]
            raise ConfigError(f'hybrid: {what}: {first["msg"]}; wanted {{"name": …, "options": {{…}}}}') from None
    made = registry.create("detector", given) if isinstance(given, str | Component | type) else given
    if not isinstance(made, Detector):
        raise ConfigError(f"hybrid: {what} is a {type(made).__name__}, wanted something with detect(frame), its name, or name and options")
    return made


def _settings(model: Any, given: Any) -> Any:
    if isinstance(given, model):
        return given
    try:
        return model.model_validate(dict(given or {}))
    except (ValidationError, TypeError, ValueError) as error:
        detail = str(error)
        if isinstance(error, ValidationError):
            first = error.errors()[0]
            detail = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
        raise ConfigError(f"hybrid: {model.__name__}: {detail} (known: {', '.join(model.model_fields)})") from None


def _check_rule(structure: str, encoder: Any) -> None:
    if structure not in ("auto", "looks", "shape", "keep"):
        raise ConfigError(f"hybrid: structure is {structure!r}, wanted auto, looks, shape or keep")
    if encoder is not None and not (sees(encoder) and hasattr(encoder, "embed_text")):
        wanted = "something with embed_image or embed_crops, and embed_text"
        raise ConfigError(f"hybrid: image_encoder is a {type(encoder).__name__}, wanted {wanted}")
    if structure == "looks" and encoder is None:
        raise ConfigError("hybrid: structure is 'looks', which needs an image_encoder")
