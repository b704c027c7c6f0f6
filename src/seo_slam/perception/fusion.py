"""One thing, one box: detectors fire twice on a thing under two labels (monitor and laptop) more often than two things coincide."""

import numpy as np

from seo_slam.perception.boxes import iou
from seo_slam.types import BoolArray, Detections


def distinct(detections: Detections, max_iou: float) -> BoolArray:
    """Return (N,) bool: keep this detection. Of boxes that overlap more than ``max_iou``, whatever their labels, the best stays."""
    keep = np.ones(len(detections), dtype=np.bool_)
    overlap = iou(detections.boxes_px, detections.boxes_px)
    order = np.argsort(-detections.scores, kind="stable")
    for position, row in enumerate(order):
        if keep[row]:
            rest = order[position + 1 :]
            keep[rest[overlap[row, rest] > max_iou]] = False
    return keep
