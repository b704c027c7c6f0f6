"""One thing, one box: detectors fire twice on a thing, under two labels too (monitor, laptop), more often than two things coincide."""

import numpy as np

from seo_slam.perception.boxes import containment, iou
from seo_slam.types import BoolArray, Detections, Observations


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


INSIDE = 0.7
"""Share of the smaller box in the larger one from which two boxes may be of one thing."""

LIKE_SIZE = 2.0
"""… if their longer sides differ by less than this factor: a mouse on its pad is not the pad."""


def coincident(observations: Observations) -> BoolArray:
    """Return (K,) bool: this observation is a second box of a thing that a better one has.

    Two bodies cannot fill the same place: of boxes in each other, of like size, with centres nearer than half the smaller one's
    longer side, the one with the best score stays. (A cup and a mouse are both seen where a cup stands, in boxes too different to
    overlap as much as ``distinct`` asks.)
    """
    out = np.zeros(len(observations), dtype=np.bool_)
    if len(observations) < 2:
        return out
    side_m = observations.size_m.max(axis=1)
    smaller = np.minimum(side_m[:, None], side_m[None])
    apart_m = np.linalg.norm(observations.p_camera[:, None] - observations.p_camera[None], axis=2)
    same = containment(observations.boxes_px, observations.boxes_px) > INSIDE
    same &= (apart_m < 0.5 * smaller) & (np.maximum(side_m[:, None], side_m[None]) < LIKE_SIZE * smaller)
    order = np.argsort(-observations.scores, kind="stable")
    for position, row in enumerate(order):
        if not out[row]:
            rest = order[position + 1 :]
            out[rest[same[row, rest]]] = True
    return out
