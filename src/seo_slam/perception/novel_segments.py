"""Segments without a word that show what the detector has not seen (DualMap III-A1)."""

import numpy as np

from seo_slam.errors import FrameError
from seo_slam.perception.mask_overlap import Masks, disjoint, mask_iou, shared_pixels
from seo_slam.settings.hybrid import HybridSettings
from seo_slam.types import BoolArray, Detections

PIXELS_OF_VGA = 640 * 480


def novel(segments: Masks, detected: Masks, background: Masks, settings: HybridSettings) -> BoolArray:
    """Return (M,) which of M segments overlap none of N detected masks, and are none of L masks of the background.

    At most ``novel_iou`` of their union may be shared, and at most ``novel_share`` of the segment, and of the detection; what lies in a
    wall's mask may be a thing before it. Of those segments that overlap each other by more than ``merge_iou`` the first one counts.
    """
    known = _overlapping(segments, detected, settings.novel_iou, settings.novel_share)
    known |= _overlapping(segments, background, settings.novel_iou, 1.0)
    news = (segments.areas > 0) & ~known
    rows = np.flatnonzero(news)
    left = segments[rows]
    alike = mask_iou(shared_pixels(left, left), left, left) > settings.merge_iou
    for position, row in enumerate(rows):
        if news[row]:
            news[rows[position + 1 :][alike[position, position + 1 :]]] = False
    return np.asarray(news)


def _overlapping(segments: Masks, others: Masks, iou: float, share: float) -> BoolArray:
    """(M,) which segments share more than ``iou`` of the union, or ``share`` of the smaller one, with any of the others."""
    shared = shared_pixels(segments, others)
    smaller = np.minimum(segments.areas[:, None], others.areas[None, :])
    overlaps = (mask_iou(shared, segments, others) > iou) | (shared / np.maximum(smaller, 1) > share)
    return np.asarray(overlaps.any(axis=1))


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
