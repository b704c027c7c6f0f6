"""Views of made-up landmarks for tests of chain and runners."""

from dataclasses import replace

import numpy as np

from seo_slam.interfaces import Agent, AgentView
from seo_slam.records import Confirm, Doubt, Merge, Relabel, Remove
from seo_slam.testing.worlds import T_WORLD_FIRST, tiny_frames
from seo_slam.types import Landmark, Landmarks

FRAME = tiny_frames(1)[0]


def landmark(landmark_id, x_m=None, version=0, size_m=0.2):
    """One thing on a row along x, a metre apart unless said otherwise."""
    return Landmark(
        id=landmark_id,
        label=f"thing {landmark_id}",
        labels={f"thing {landmark_id}": 1.0},
        position_m=np.array([float(landmark_id) if x_m is None else x_m, 2.0, 0.5]),
        covariance_m2=1e-4 * np.eye(3),
        size_m=np.full(3, size_m),
        embedding=np.ones(4) / 2.0,
        observations=5,
        first_seen_s=0.0,
        last_seen_s=1.0,
        state="stable",
        version=version,
    )


def view(landmarks, keyframe_id=0, stamp_s=None):
    """A view in which all of these are to be seen."""
    rows = Landmarks.from_rows(sorted(landmarks, key=lambda row: row.id))
    boxes = {row.id: np.array([10.0, 10.0, 30.0, 30.0]) for row in landmarks}
    frame = replace(FRAME, timestamp_s=float(keyframe_id) if stamp_s is None else stamp_s)
    return AgentView(frame, T_WORLD_FIRST, rows, boxes, keyframe_id)


def version_of(seen, landmark_id):
    return int(seen.landmarks.versions[np.searchsorted(seen.landmarks.ids, landmark_id)])


class Scripted(Agent):
    """Answers by a function of (view, landmark id) -> edit or None, and remembers what it was asked."""

    def __init__(self, role, most=1000, answer=None):
        self.role, self.most_landmarks, self.answer = role, most, answer or CONFIRM
        self.asked = []

    @property
    def name(self):
        return self.role

    def propose(self, seen):
        self.asked.append((seen.keyframe_id, seen.asked))
        return self.edits(seen)

    def edits(self, seen):
        return [edit for i in seen.asked if (edit := self.answer(seen, i)) is not None]


def CONFIRM(seen, i):
    return Confirm(i, version_of(seen, i))


def DOUBT(seen, i):
    return Doubt(i, version_of(seen, i))


def REMOVE(seen, i):
    return Remove(i, version_of(seen, i))


def RENAME(seen, i):
    return Relabel(i, version_of(seen, i), f"red thing {i}", category="thing")


def ABSTAIN(seen, i):
    return None


def MERGE_FIRST_TWO(seen, i):
    a, b = sorted(seen.asked)[:2]
    return Merge(a, version_of(seen, a), b, version_of(seen, b)) if i == a else None


def trio(verify=CONFIRM, describe=RENAME, merge=ABSTAIN):
    """The paper's three, scripted."""
    return Scripted("verification", 4, verify), Scripted("description", 1, describe), Scripted("merging", 8, merge)
