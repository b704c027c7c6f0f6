"""Segments without a word that show what the detector has not seen (DualMap III-A1)."""

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.perception.mask_overlap import Masks, disjoint, mask_iou, shared_pixels
from seo_slam.settings.hybrid import HybridSettings
from seo_slam.types import BoolArray, Detections

PIXELS_OF_VGA = 640 * 480


def novel(segments: Masks, detected: Masks, settings: HybridSettings) -> BoolArray:
    """Return (M,) which of M segments overlap none of N detected masks.

    At most ``novel_iou`` of their union may be shared, and at most ``novel_share`` of the segment, and of the detection. Of segments that
    overlap each other by more than ``merge_iou`` the first one counts.
    """
    shared = shared_pixels(segments, detected)
    smaller = np.minimum(segments.areas[:, None], detected.areas[None, :])
    overlaps = mask_iou(shared, segments, detected) > settings.novel_iou
    overlaps |= shared / np.maximum(smaller, 1) > settings.novel_share
    news = (segments.areas > 0) & ~overlaps.any(axis=1)
    rows = np.flatnonzero(news)
    left = segments[rows]
    alike = mask_iou(shared_pixels(left, left), left, left) > settings.merge_iou
    for position, row in enumerate(rows):
        if news[row]:
            news[rows[position + 1 :][alike[position, position + 1 :]]] = False
    return np.asarray(news)


def joined(detected: Detections, segments: Detections, where: str = "hybrid") -> Detections:
    """Return detections and segments as one, the detections first. Where only one has embeddings, the other's rows are zero.

    Raises:
        FrameError: their embeddings are of different lengths; says ``where``.
    """
    if not len(segments):
        return detected
    parts = (detected, segments) if len(detected) else (segments,)
    sizes = [part.embeddings.shape[1] for part in parts if part.embeddings is not None]
    if len(set(sizes)) > 1:
        raise FrameError(f"{where}: embeddings of the detector are {sizes[0]} long, of the segmenter {sizes[1]}; wanted those of one model")
    embeddings = None
    if sizes:
        embeddings = np.concatenate([np.zeros((len(part), sizes[0])) if part.embeddings is None else part.embeddings for part in parts])
    return Detections(
        boxes_px=np.concatenate([part.boxes_px for part in parts]),
        labels=tuple(label for part in parts for label in part.labels),
        scores=np.concatenate([part.scores for part in parts]),
        masks=np.concatenate([part.masks for part in parts if part.masks is not None]),
        embeddings=embeddings,
    )


def parted(detections: Detections, settings: HybridSettings) -> Detections:
    """Return detections whose masks share no pixel (the larger of two loses the overlap), without those left too small."""
    if detections.masks is None or not len(detections):
        return detections
    masks = Masks(disjoint(Masks(detections.masks)))
    least = np.array([settings.smallest_named_px if label else settings.smallest_px for label in detections.labels])
    smallest_px = np.maximum(least * masks.pixels[0].size / PIXELS_OF_VGA, 1.0)
    parted_ones = Detections(detections.boxes_px, detections.labels, detections.scores, masks.pixels, detections.embeddings)
    return parted_ones[masks.areas >= smallest_px]
