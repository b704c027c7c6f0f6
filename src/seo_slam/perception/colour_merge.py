"""One thing, several boxes: those that overlap and have like colours become one (DualMap III-A1)."""

import cv2
import numpy as np
from numpy.typing import NDArray

from seo_slam.geometry import FloatArray
from seo_slam.perception.boxes import containment
from seo_slam.perception.mask_overlap import Masks, mask_iou, shared_pixels
from seo_slam.settings.hybrid import HybridSettings
from seo_slam.types import BoolArray, Detections, IntArray

BINS = 16
"""Of each colour channel."""


def merged(detections: Detections, rgb: NDArray[np.uint8], settings: HybridSettings) -> Detections:
    """Return detections in which boxes of one thing are one: joined mask and box, word, score and embedding of the best of them.

    Two are of one thing, whatever their words, if their masks overlap by more than ``merge_iou``; or if their boxes overlap by more than
    ``merge_overlap`` of the smaller one, their masks too (``merge_by`` "boxes": or not), and their colours are alike. What overlaps what is
    followed from box to box.

    Args:
        detections: N rows, each with a mask.
        rgb: (H, W, 3) the image.
        settings: the thresholds.
    """
    if len(detections) < 2 or detections.masks is None:
        return detections
    groups = _groups(_same_thing(detections, Masks(detections.masks), rgb, settings))
    if len(groups) == len(detections):
        return detections
    best = [int(rows[np.argmax(detections.scores[rows])]) for rows in groups]
    order = np.argsort(best)
    kept = detections[np.array(best)[order]]
    members = [groups[i] for i in order]
    boxes = [np.r_[detections.boxes_px[rows, :2].min(axis=0), detections.boxes_px[rows, 2:].max(axis=0)] for rows in members]
    masks = np.array([detections.masks[rows].any(axis=0) for rows in members])
    return Detections(np.array(boxes), kept.labels, kept.scores, masks, kept.embeddings)


def _same_thing(detections: Detections, masks: Masks, rgb: NDArray[np.uint8], settings: HybridSettings) -> BoolArray:
    """(N, N) whether two boxes are of one thing."""
    shared = shared_pixels(masks, masks)
    boxes_overlap = containment(detections.boxes_px, detections.boxes_px) > settings.merge_overlap
    candidates = np.triu(boxes_overlap if settings.merge_by == "boxes" else boxes_overlap & (shared > 0), 1)
    same = np.triu(mask_iou(shared, masks, masks) > settings.merge_iou, 1)
    rows = np.unique(np.argwhere(candidates & ~same))
    histograms = dict(zip(rows.tolist(), colour_histograms(rgb, masks[rows]), strict=True))
    for i, j in np.argwhere(candidates & ~same):
        same[i, j] = histograms[i] @ histograms[j] > settings.merge_colour
    return np.asarray(same | same.T)


def colour_histograms(rgb: NDArray[np.uint8], masks: Masks) -> FloatArray:
    """Return (N, 48) histograms of the pixels under each mask, 16 bins a channel, as unit rows; zeros for an empty mask."""
    out = np.zeros((len(masks), 3 * BINS))
    for row, (mask, (x0, y0, x1, y1)) in enumerate(zip(masks.pixels, masks.boxes.tolist(), strict=True)):
        if x1 <= x0:
            continue
        patch, inside = rgb[y0:y1, x0:x1], mask[y0:y1, x0:x1].astype(np.uint8)
        channels = [cv2.calcHist([patch], [channel], inside, [BINS], [0, 256]).ravel() for channel in range(3)]
        histogram = np.concatenate(channels).astype(np.float64)
        out[row] = histogram / np.linalg.norm(histogram)
    return out


def _groups(same: BoolArray) -> list[IntArray]:
    """Rows that hang together, each group by rising row, the groups by their first row."""
    left = np.ones(len(same), dtype=np.bool_)
    groups = []
    for row in range(len(same)):
        if not left[row]:
            continue
        member = np.zeros(len(same), dtype=np.bool_)
        member[row] = True
        while True:
            grown = member | same[member].any(axis=0)
            if (grown == member).all():
                break
            member = grown
        left &= ~member
        groups.append(np.flatnonzero(member))
    return groups
