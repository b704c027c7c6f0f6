"""Are two landmarks one thing? The merging agent that asks no model."""

from collections.abc import Sequence

import numpy as np

from seo_slam.agents.groups import near_pairs
from seo_slam.agents.local_looks import version_of
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Agent, AgentView
from seo_slam.perception.boxes import containment
from seo_slam.records import AgentRole, Edit, Merge

SLACK_M = 0.03
"""Extents are not known better than this."""

LEAST_INSIDE = 0.5
"""Share of the smaller one's extent that must lie in the larger one's, in space …"""

LEAST_BOX_INSIDE = 0.6
"""… and of its box, in the image."""

LIKE_SIZED = 2.5
"""The longer of the two is at most so many times as long: a box around two shoes is neither of them."""

SAME_LABELS = 1.0
"""Log likelihood ratio of their labels from which they are taken for one thing."""

SAME_PLACE, SAME_EXTENT = 0.25, 0.8
"""Of this share of an extent apart, and this much inside: two things cannot be there, whatever they are called …"""

NOT_UNLIKE_LABELS = -1.0
"""… unless their labels rule it out."""


class LocalMerging(Agent):
    """Proposes to merge what lies in one place, is of like size, has labels of one thing, and was never detected side by side.

    The one that was seen more often is kept; of two seen as often, the older.
    """

    role: AgentRole = "merging"

    def __init__(self, likelihood: LabelLikelihood | None = None) -> None:
        """Take what compares words; a pipeline gives its own. None: words are the same or not."""
        self._likelihood = likelihood or LabelLikelihood()

    @property
    def name(self) -> str:
        """Written beside every edit."""
        return "local merging"

    def propose(self, view: AgentView) -> Sequence[Edit]:
        """Return a ``Merge`` of each pair that is one; no landmark twice."""
        shown = [i for i in (view.asked or tuple(view.boxes_px)) if i in view.boxes_px]
        edits: list[Edit] = []
        done: set[int] = set()
        for a, b in near_pairs(shown, view):
            if not {a, b} & done and self._are_one(a, b, view):
                keep, drop = sorted((a, b), key=lambda i: (-int(view.landmarks.observations[_row(i, view)]), i))
                edits.append(Merge(keep, version_of(keep, view), drop, version_of(drop, view), self.name))
                done |= {a, b}
        return edits

    def _are_one(self, a: int, b: int, view: AgentView) -> bool:
        if _seen_apart(a, b, view):
            return False
        rows = [_row(a, view), _row(b, view)]
        p_world, size_m = view.landmarks.p_world[rows], view.landmarks.size_m[rows] + SLACK_M
        longest = size_m.max(axis=1)
        inside = extent_inside(p_world, size_m)
        boxes = np.array([view.boxes_px[a], view.boxes_px[b]])
        if longest.max() > LIKE_SIZED * longest.min() or containment(boxes[:1], boxes[1:])[0, 0] < LEAST_BOX_INSIDE:
            return False
        alike = self._likelihood.between(view.landmarks.labels[rows[0]], view.landmarks.labels[rows[1]])
        apart_m = float(np.linalg.norm(p_world[0] - p_world[1]))
        one_place = apart_m <= SAME_PLACE * float(longest.min()) and inside >= SAME_EXTENT
        return (inside >= LEAST_INSIDE and alike >= SAME_LABELS) or (one_place and alike >= NOT_UNLIKE_LABELS)


def extent_inside(p_world: FloatArray, size_m: FloatArray) -> float:
    """Return the share of the smaller of two extents that lies in the other; (2, 3) centres and sizes, all above 0."""
    low, high = p_world - 0.5 * size_m, p_world + 0.5 * size_m
    common = np.maximum(high.min(axis=0) - low.max(axis=0), 0.0)
    return float(common.prod() / size_m.prod(axis=1).min())


def _seen_apart(a: int, b: int, view: AgentView) -> bool:
    """Whether both were ever detected at once, in boxes of their own."""
    return any(view.evidence[i].seen_apart.get(j, 0) > 0 for i, j in ((a, b), (b, a)) if i in view.evidence)


def _row(landmark_id: int, view: AgentView) -> int:
    return int(np.searchsorted(view.landmarks.ids, landmark_id))
