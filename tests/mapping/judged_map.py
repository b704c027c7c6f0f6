"""An object map with an edit desk before it: tests say what agents propose, from where, and see what becomes of it."""

from collections import Counter

import numpy as np
from small_map import AT, SmallMap

from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.config import EditSettings
from seo_slam.mapping.edit_desk import EditDesk
from seo_slam.records import Confirm, Doubt, Merge, Proposal, Relabel, Remove

ROLES = {Confirm: "verification", Doubt: "verification", Remove: "verification", Relabel: "description", Merge: "merging"}


def aside(metres):
    return AT + np.array([0.0, metres, 0.0])


def beside(degrees):
    """A camera a metre from the first thing, so many degrees around it."""
    angle = np.radians(degrees)
    return (float(AT[0] + np.cos(angle)), float(AT[1] + np.sin(angle)), float(AT[2]))


class JudgedMap(SmallMap):
    """Things seen in five keyframes each are sure to be there, unless a test says otherwise."""

    def __init__(self, things=None, times=5, **settings):
        super().__init__(merge_duplicates=False)
        for _ in range(times):
            self.see(things or {0: (AT, "cup")})
        self.settings = EditSettings(**settings)
        self.desk = EditDesk(self.settings, self.objects, self.smoother, HashedEmbedder(size=8))
        self.views = Counter()

    def propose(self, *edits, agent="agent", model="m", view=None, camera=None, role=None):
        """Have edits judged, all from one view; a new view each time unless it is named."""
        self.views["all"] += 1
        number = self.views["all"] if view is None else view
        sent = [Proposal(edit, agent, model, "", number, float(number), camera, role or ROLES[type(edit)]) for edit in edits]
        return self.desk.judge(sent, number, float(number) + 0.5)

    def outcome(self, edit, **where):
        """What becomes of one edit: "applied", "noted", …"""
        (record,) = self.propose(edit, **where).records
        return record.outcome

    def version(self, landmark_id=0):
        return self.objects[landmark_id].version

    def remove(self, landmark_id=0):
        return Remove(landmark_id, self.version(landmark_id))

    def confirm(self, landmark_id=0):
        return Confirm(landmark_id, self.version(landmark_id))

    def doubt(self, landmark_id=0):
        return Doubt(landmark_id, self.version(landmark_id))

    def relabel(self, label, category="", landmark_id=0):
        return Relabel(landmark_id, self.version(landmark_id), label, category=category)

    def merge(self, keep_id=0, drop_id=1):
        return Merge(keep_id, self.version(keep_id), drop_id, self.version(drop_id))
