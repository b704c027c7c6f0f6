"""Fig 3 as a state machine: which agent is asked about which landmarks of which view, and what follows from its answer.

Verification sees every landmark in view, new ones first. What it finds wrong, and what is new, goes to description; what is confirmed or
freshly labelled goes to merging. What waits is kept a landmark, not a view, so that a newer view takes the place of an older one.
No threads, no clock: a runner asks ``next`` for a question and gives the edits to ``answered``.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from seo_slam.agents.groups import near_pairs, nearby_group
from seo_slam.interfaces import Agent, AgentView
from seo_slam.records import Confirm, Doubt, Edit, Relabel, Remove

DESCRIBE, VERIFY_NEW, MERGE, VERIFY = 0, 1, 2, 3
"""What is asked first: labels that are missing or wrong, new landmarks, doubles, and then what was verified longest ago."""

MOST_LABELS = 500
"""Labels that agents gave and that are remembered; what is remembered of landmarks is looked through when so many are gone."""

PAIR_ASKED = 3
"""A pair is shown to the merging agent in at most so many views: the first answer may have been given on a poor one."""


@dataclass(frozen=True, slots=True, eq=False)
class Query:
    """One question: an agent, and a view whose ``asked`` says about which landmarks.

    Attributes:
        number: 1, 2, … in the order of asking.
    """

    number: int
    agent: Agent
    view: AgentView


@dataclass(slots=True)
class _Progress:
    """How far a landmark has come in the chain."""

    described: bool = False
    doubted: bool = False
    passed: bool = False  # confirmed or freshly labelled: may be merged
    pending: bool = False  # judged since it last came to the end of the chain
    verified: int = -1  # the keyframe it was last verified in


@dataclass(slots=True, eq=False)
class _Want:
    """A landmark that an agent is to be asked about."""

    view: AgentView
    urgency: tuple[int, int]


@dataclass(slots=True)
class ChainCounts:
    """What went through the chain.

    Attributes:
        landmarks_done: landmarks that passed the whole chain (verified, described if due, merging considered), each time they did.
        dropped: questions that were never asked, since the queue was full.
        superseded: questions that were asked of a newer view instead.
    """

    landmarks_done: int = 0
    dropped: int = 0
    superseded: int = 0


class Chain:
    """Holds what waits to be asked, and what each landmark has been through."""

    def __init__(self, agents: Sequence[Agent], most_waiting: int = 64) -> None:
        """Know the agents, in the order in which those of one role are asked; beyond ``most_waiting`` the oldest questions are dropped."""
        self._agents = list(agents)
        self._most_waiting = most_waiting
        self._waiting: dict[tuple[int, int], _Want] = {}
        self._asked: dict[tuple[int, int], tuple[int, int]] = {}  # agent, landmark -> version and keyframe it was last asked at
        self._progress: dict[int, _Progress] = {}
        self._pairs_asked: dict[tuple[int, int], list[int]] = {}  # pair -> keyframes of the views in which it was asked about
        self._stopped: set[int] = set()
        self._views_for_all: dict[int, AgentView] = {}
        self._newest: AgentView | None = None
        self._numbers = 0
        self.known_labels: dict[str, None] = {}
        self.counts = ChainCounts()

    @property
    def waiting(self) -> int:
        """How many landmarks wait for an agent, each for each agent."""
        return len(self._waiting) + len(self._views_for_all)

    def show(self, view: AgentView) -> None:
        """Take a new view: what is to be seen in it is to be asked about."""
        self._newest = view
        for index, agent in enumerate(self._agents):
            if agent.role == "any" and index not in self._stopped:
                self.counts.superseded += int(index in self._views_for_all)
                self._views_for_all[index] = view
        self._forget_gone(view)
        for landmark_id in view.boxes_px:
            progress = self._progress.setdefault(landmark_id, _Progress())
            self._want("verification", landmark_id, view)
            judged = progress.passed or progress.doubted or not self._has_judge()
            if judged and self._description_is_due(progress):  # also if it was asked before, and had no answer
                self._want("description", landmark_id, view)
        self._renew_descriptions(view)
        self._want_merging(view)
        self._drop_oldest()

    def next(self) -> Query | None:
        """Return the most urgent question, None if nothing waits. It counts as asked."""
        if self._views_for_all:
            index = min(self._views_for_all)
            return self._query(index, replace(self._views_for_all.pop(index), asked=()))
        if not self._waiting:
            return None
        (index, first), want = min(self._waiting.items(), key=lambda item: (item[1].urgency, item[0][0], item[0][1]))
        agent, view = self._agents[index], want.view
        mates = [
            (other.urgency, landmark_id)
            for (i, landmark_id), other in self._waiting.items()
            if i == index and other.view is view and landmark_id != first
        ]
        ids = [first, *(landmark_id for _, landmark_id in sorted(mates))]
        ids = self._merging_group(first, ids, view, agent) if agent.role == "merging" else ids[: max(agent.most_landmarks, 1)]
        for landmark_id in ids:
            self._waiting.pop((index, landmark_id), None)
            self._asked[index, landmark_id] = (_version(view, landmark_id), view.keyframe_id)
        if len(ids) < 2 and agent.role == "merging":
            return self.next()
        return self._query(index, replace(view, asked=tuple(ids), known_labels=tuple(self.known_labels)))

    def answered(self, query: Query, edits: Sequence[Edit]) -> None:
        """Note what an agent answered; an answer without a landmark means that the agent abstains of it."""
        if query.agent.role == "any":
            return
        verdicts = {edit.landmark_id: edit for edit in edits if not hasattr(edit, "drop_id")}
        for landmark_id in query.view.asked:
            progress = self._progress.setdefault(landmark_id, _Progress())
            if query.agent.role == "verification":
                self._verified(landmark_id, progress, verdicts.get(landmark_id), query.view)
            elif query.agent.role == "description":
                self._described(landmark_id, progress, verdicts.get(landmark_id), query.view)
            else:
                self._end(progress)
        if self._newest is not None:
            self._want_merging(self._newest)

    def stop_asking(self, agent: Agent) -> None:
        """Ask an agent no more: its budget is spent, or its server refuses it."""
        index = self._agents.index(agent)
        self._stopped.add(index)
        self._waiting = {key: want for key, want in self._waiting.items() if key[0] != index}
        self._views_for_all.pop(index, None)

    def _query(self, index: int, view: AgentView) -> Query:
        self._numbers += 1
        return Query(self._numbers, self._agents[index], view)

    def _verified(self, landmark_id: int, progress: _Progress, edit: Edit | None, view: AgentView) -> None:
        progress.verified = view.keyframe_id
        if isinstance(edit, Confirm):
            progress.passed, progress.doubted, progress.pending = True, False, True
        elif isinstance(edit, Doubt):
            progress.passed, progress.doubted = False, True
        elif isinstance(edit, Remove):
            progress.passed = progress.pending = False
            return
        if self._description_is_due(progress) and edit is not None:
            self._want("description", landmark_id, self._newest_with(landmark_id, view))
        elif not self._has("merging"):
            self._end(progress)

    def _described(self, landmark_id: int, progress: _Progress, edit: Edit | None, view: AgentView) -> None:  # noqa: ARG002
        if isinstance(edit, Relabel | Confirm):
            progress.described, progress.doubted, progress.passed, progress.pending = True, False, True, True
            if isinstance(edit, Relabel):
                self.known_labels[edit.label] = None
                while len(self.known_labels) > MOST_LABELS:
                    del self.known_labels[next(iter(self.known_labels))]
        elif isinstance(edit, Remove):
            progress.passed = progress.pending = False
            return
        if not self._has("merging"):
            self._end(progress)

    def _end(self, progress: _Progress) -> None:
        """Count a landmark at the end of the chain, once for each time it was judged; not while its description is due."""
        if progress.pending and not self._description_is_due(progress):
            progress.pending = False
            self.counts.landmarks_done += 1

    def _description_is_due(self, progress: _Progress) -> bool:
        return (progress.doubted or not progress.described) and self._has("description")

    def _renew_descriptions(self, view: AgentView) -> None:
        """Let descriptions that still wait be made from the newer view."""
        for (index, landmark_id), want in self._waiting.items():
            if self._agents[index].role == "description" and landmark_id in view.boxes_px and want.view is not view:
                want.view = view
                self.counts.superseded += 1

    def _want(self, role: str, landmark_id: int, view: AgentView) -> None:
        """Let all agents of a role be asked of a landmark in a view, unless they were asked of this version in this view."""
        for index, agent in enumerate(self._agents):
            asked = self._asked.get((index, landmark_id))
            if agent.role == role and index not in self._stopped and asked != (_version(view, landmark_id), view.keyframe_id):
                self.counts.superseded += int((index, landmark_id) in self._waiting)
                self._waiting[index, landmark_id] = _Want(view, self._urgency(role, landmark_id, asked))

    def _urgency(self, role: str, landmark_id: int, asked: tuple[int, int] | None) -> tuple[int, int]:
        progress = self._progress.setdefault(landmark_id, _Progress())
        if role == "description":  # who had no answer once may have none again, and must not keep others waiting
            return (DESCRIBE, 0) if asked is None or progress.described else (VERIFY, asked[1])
        if role == "merging":
            return MERGE, 0
        return (VERIFY_NEW, 0) if progress.verified < 0 else (VERIFY, progress.verified)

    def _want_merging(self, view: AgentView) -> None:
        """Let near pairs be looked at of which both have passed, and that were not shown often enough."""
        if not self._has("merging"):
            return
        eligible = [landmark_id for landmark_id in view.boxes_px if self._progress.get(landmark_id, _Progress()).passed]
        wanted: set[int] = set()
        for a, b in near_pairs(eligible, view):
            asked = self._pairs_asked.get((a, b), [])
            if len(asked) < PAIR_ASKED and view.keyframe_id not in asked:
                wanted |= {a, b}
        for landmark_id in sorted(wanted):
            self._want("merging", landmark_id, view)
        for landmark_id in eligible:  # nothing near it that it could be a double of: the chain ends here
            if landmark_id not in wanted:
                self._end(self._progress[landmark_id])

    def _merging_group(self, first: int, ids: list[int], view: AgentView, agent: Agent) -> list[int]:
        group = nearby_group(first, ids, view, agent.most_landmarks)
        for a, b in near_pairs(group, view):
            self._pairs_asked.setdefault((a, b), []).append(view.keyframe_id)
        return group

    def _newest_with(self, landmark_id: int, view: AgentView) -> AgentView:
        return self._newest if self._newest is not None and landmark_id in self._newest.boxes_px else view

    def _has_judge(self) -> bool:
        """Whether somebody is there who confirms."""
        return any(a.role == "verification" and a.confirms and k not in self._stopped for k, a in enumerate(self._agents))

    def _forget_gone(self, view: AgentView) -> None:
        """Drop what is known of landmarks that are not in the map any more, now and then."""
        present = set(view.landmarks.ids.tolist())
        if len(self._progress) <= 2 * len(present) + MOST_LABELS:
            return
        self._progress = {i: progress for i, progress in self._progress.items() if i in present}
        self._asked = {key: asked for key, asked in self._asked.items() if key[1] in present}
        self._waiting = {key: want for key, want in self._waiting.items() if key[1] in present}
        self._pairs_asked = {pair: asked for pair, asked in self._pairs_asked.items() if present.issuperset(pair)}

    def _has(self, role: str) -> bool:
        return any(agent.role == role and index not in self._stopped for index, agent in enumerate(self._agents))

    def _drop_oldest(self) -> None:
        over = len(self._waiting) - self._most_waiting
        if over > 0:
            oldest = sorted(self._waiting.items(), key=lambda item: (item[1].view.keyframe_id, (-item[1].urgency[0], -item[1].urgency[1])))
            for key, _ in oldest[:over]:
                del self._waiting[key]
            self.counts.dropped += over


def _version(view: AgentView, landmark_id: int) -> int:
    row = int(np.searchsorted(view.landmarks.ids, landmark_id))
    return int(view.landmarks.versions[row])
