"""Agents propose, the map disposes: where proposals are judged, one desk a pipeline.

With the rails on, a verdict is evidence (``verdicts``): a landmark is removed, renamed or merged once what was said of it, together with
what was seen of it, leaves little doubt. With the rails off every edit is applied whose version holds, as in SEO-SLAM III-D.
"""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from seo_slam.config import EditSettings
from seo_slam.errors import EditRefused, FrameError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder, Smoother
from seo_slam.mapping.edit_records import ids_and_versions, ids_of, in_words, percent, record_of
from seo_slam.mapping.edits import apply_edit, merge_landmarks, require_close
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.thing import Thing
from seo_slam.mapping.verdicts import Belief, Verdict, VerdictKind, Verdicts
from seo_slam.perception.labels import clean_label
from seo_slam.records import Confirm, Doubt, Edit, EditOutcome, EditRecord, MapEvent, Merge, Proposal, Relabel, Remove
from seo_slam.types import Landmark

SURELY_NOTHING = 0.75
"""A landmark is removed once it is nothing with this probability: what is there after all is soon found again …"""

FOUND_TOO_SELDOM = 0.8
"""… and, if only one verdict says so, existence is below this: the sightings are against it, too."""

SURELY_NAMED = 0.6
"""It is renamed once another word has this probability."""

SIDES = 8
"""Directions, seen from above, from which a landmark is looked at."""

LEAST_REACH_M = 0.1
"""A landmark this near to where one was removed is at the same place."""

MOST_REFUSED = 500
"""Places remembered from which agents had landmarks removed."""

MOST_WAITING = 256


class _Stale(EditRefused):
    """The landmark has changed since the agent saw it."""


@dataclass(slots=True, eq=False)
class _Told:
    """The names that agents gave a landmark.

    Attributes:
        before: version after a renaming -> version and plain word before it.
        labels: category -> the newest descriptive label that goes with it.
        is_final: it came from an agent of role "any", which is taken at its word.
    """

    before: dict[int, tuple[int, str]] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    is_final: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Refused:
    """A place from which a landmark was removed, and what was said of it."""

    p_world: FloatArray
    reach_m: float
    verdicts: tuple[Verdict, ...]


@dataclass(slots=True, eq=False)
class Judged:
    """What came of a handful of proposals.

    Attributes:
        events: what changed in the map.
        records: one a proposal.
        warnings: what the user should know.
    """

    events: list[MapEvent] = field(default_factory=list)
    records: list[EditRecord] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def add(self, later: "Judged") -> None:
        """Append what was judged afterwards."""
        self.events += later.events
        self.records += later.records
        self.warnings += later.warnings


class EditDesk:
    """Judges proposals, in the order they come; those beyond the quota wait for the next keyframe."""

    def __init__(self, settings: EditSettings, objects: ObjectMap, smoother: Smoother, embedder: Embedder) -> None:
        """Judge edits of ``objects`` and of the graph."""
        self._settings = settings
        self._objects = objects
        self._smoother = smoother
        self._embedder = embedder
        self._verdicts = Verdicts()
        self._waiting: deque[Proposal] = deque()
        self._applied_at: dict[int, int] = {}  # the newest keyframe -> edits applied in it
        self._merge_votes: dict[tuple[int, int], set[int]] = {}  # pair -> keyframes of the views that spoke for it
        self._told: defaultdict[int, _Told] = defaultdict(_Told)
        self._refused: dict[int, _Refused] = {}

    @property
    def waiting(self) -> int:
        """Proposals beyond the quota."""
        return len(self._waiting)

    def is_new(self, landmark_id: int) -> bool:
        """Whether no agent has said anything of a landmark."""
        return not self._verdicts.is_judged(landmark_id)

    def judge(self, proposals: Sequence[Proposal], keyframe_id: int, now_s: float, *, heed_quota: bool = True) -> Judged:
        """Judge proposals, older ones that wait first; however often it is called, a keyframe has one quota."""
        self._waiting.extend(proposals)
        out = Judged()
        applied = self._applied_at.get(keyframe_id, 0)
        while self._waiting and (applied < self._settings.quota or not heed_quota):
            proposal = self._waiting.popleft()
            before = self._rows(ids_of(proposal.edit))
            try:
                event, outcome, detail = self._decide(proposal)
            except _Stale as error:
                event, outcome, detail = None, "stale", str(error)
            except EditRefused as error:
                event, outcome, detail = None, "refused", str(error)
                out.warnings.append(f"agent {proposal.agent}: edit refused: {error}")
            if event is not None:
                out.events.append(event if event.source else replace(event, source=proposal.agent))
            changed = event is not None and event.kind != "confirmed"
            applied += int(changed)
            out.records.append(record_of(proposal, event, outcome, detail, keyframe_id, now_s, before if changed else ()))
        self._applied_at = {keyframe_id: applied}
        while len(self._waiting) > MOST_WAITING:
            dropped = self._waiting.popleft()
            out.records.append(record_of(dropped, None, "refused", "too many edits wait", keyframe_id, now_s, ()))
        return out

    def follow(self, events: Sequence[MapEvent]) -> None:
        """Learn what the map did by itself: what was said of a landmark goes with it, or is forgotten."""
        for event in events:
            if event.kind == "removed":
                self._forget(event.landmark_id)
            elif event.kind == "merged" and event.other_id is not None:
                self._join(event.other_id, event.landmark_id)
            elif event.kind == "moved" and event.other_id is not None:
                self._join(event.landmark_id, event.other_id)
        self._merge_votes = {pair: votes for pair, votes in self._merge_votes.items() if all(i in self._objects for i in pair)}

    def _join(self, keep_id: int, drop_id: int) -> None:
        self._verdicts.merge(keep_id, drop_id)
        self._forget(drop_id)

    def _forget(self, landmark_id: int) -> tuple[Verdict, ...]:
        self._told.pop(landmark_id, None)
        return self._verdicts.forget(landmark_id)

    def _decide(self, proposal: Proposal) -> tuple[MapEvent | None, EditOutcome, str]:
        edit = proposal.edit
        if not ids_of(edit):
            raise EditRefused(f"got {edit!r:.80}, wanted Confirm, Doubt, Relabel, Remove or Merge")
        if isinstance(edit, Merge) and edit.keep_id == edit.drop_id:
            raise EditRefused(f"landmark {edit.keep_id} cannot be merged with itself")
        self._require_current(edit)
        if not self._settings.rails:
            return self._as_proposed(proposal)
        if isinstance(edit, Merge):
            return self._weigh_merge(edit, proposal)
        if isinstance(edit, Relabel) and proposal.role == "any":
            decided = self._as_proposed(proposal)
            self._told[edit.landmark_id].is_final = True
            return decided
        return self._weigh(edit, proposal)

    def _as_proposed(self, proposal: Proposal) -> tuple[MapEvent | None, EditOutcome, str]:
        """Apply an edit whose version holds: the paper's way."""
        edit = self._for_now(proposal.edit)
        if isinstance(edit, Doubt):
            return None, "noted", f"{self._objects[edit.landmark_id].label!r} is doubted"
        if isinstance(edit, Relabel) and self._has_name(edit):
            return None, "noted", f"it is called {edit.label!r} already"
        if isinstance(edit, Merge):
            event = merge_landmarks(edit.keep_id, edit.drop_id, self._objects, self._smoother, edit.source)
            return event, "applied", event.detail
        thing = self._objects[edit.landmark_id]
        version, word = thing.version, _plain_word(thing)
        event = apply_edit(edit, self._objects, self._smoother, self._embedder)
        if isinstance(edit, Relabel):
            self._told[thing.id].before[thing.version] = (version, word)
        return event, "applied", event.detail

    def _for_now(self, edit: Edit) -> Edit:
        """The edit for the present version: only agents' names came between."""
        if isinstance(edit, Confirm | Relabel | Remove):
            return replace(edit, version=self._objects[edit.landmark_id].version)
        return edit

    def _weigh(self, edit: Confirm | Doubt | Relabel | Remove, proposal: Proposal) -> tuple[MapEvent | None, EditOutcome, str]:
        """Let a verdict count, and change what it leaves no doubt about."""
        thing = self._objects[edit.landmark_id]
        if self.is_new(thing.id):
            self._recall_place(thing)
        first_confirm = isinstance(edit, Confirm) and not any(v.kind == "confirm" for v in self._verdicts.of(thing.id))
        verdict = self._verdict(edit, thing, proposal)
        self._verdicts.hear(thing.id, verdict)
        if isinstance(edit, Relabel):
            self._told[thing.id].labels[verdict.word] = _clean(edit.label, thing.id)
        belief = self._verdicts.belief(thing.id, thing.existence, thing.observations, thing.weights)
        if isinstance(edit, Remove) and self._may_be_removed(thing, belief):
            return self._remove(thing, edit.source), "applied", f"{thing.label}, {percent(belief.nothing)} nothing"
        event = self._renamed(thing, belief, edit.source)
        if event is not None:
            return event, "applied", event.detail
        if first_confirm:
            return MapEvent("confirmed", thing.id, thing.label, edit.source), "applied", thing.label
        return None, "noted", in_words(edit, thing, belief)

    def _may_be_removed(self, thing: Thing, belief: Belief) -> bool:
        denials = {(v.who, v.view) for v in self._verdicts.of(thing.id) if v.kind == "remove"}
        seconded = len(denials) > 1 or (len(denials) == 1 and thing.existence < FOUND_TOO_SELDOM)
        return seconded and belief.nothing >= SURELY_NOTHING

    def _remove(self, thing: Thing, source: str) -> MapEvent:
        """Take a thing out of graph and map, and remember what was said of its place."""
        where = _Refused(self._place(thing), max(0.5 * float(thing.size_m().max()), LEAST_REACH_M), self._forget(thing.id))
        self._refused[thing.id] = where
        while len(self._refused) > MOST_REFUSED:
            del self._refused[next(iter(self._refused))]
        self._smoother.remove(thing.id)
        self._objects.forget(thing.id)
        return MapEvent("removed", thing.id, thing.label, source)

    def _recall_place(self, thing: Thing) -> None:
        """Let a thing that nobody has judged inherit what was said where one was removed: mistakes come back to their place."""
        p_world = self._place(thing)
        for landmark_id, refused in self._refused.items():
            if float(np.linalg.norm(refused.p_world - p_world)) <= refused.reach_m:
                for verdict in self._refused.pop(landmark_id).verdicts:
                    self._verdicts.hear(thing.id, verdict)
                return

    def _place(self, thing: Thing) -> FloatArray:
        ids, p_world = self._smoother.positions()
        return np.asarray(p_world[int(np.searchsorted(ids, thing.id))], dtype=np.float64)

    def _renamed(self, thing: Thing, belief: Belief, source: str) -> MapEvent | None:
        """Give a thing the word that is most likely, and the newest description that goes with it, unless it has them."""
        best = belief.best
        told = self._told[thing.id]
        if told.is_final or not best or belief.words[best] < SURELY_NAMED * (1.0 - belief.nothing):
            return None
        described = told.labels.get(best)
        now = _plain_word(thing)
        if (best == now and described in (None, thing.label)) or (best != now and described is None and thing.fixed_label is None):
            return None  # it has it already; or only the detector says so, whose word leads as soon as it is the heaviest
        category = next((word for word in thing.weights if word.casefold() == best), best)
        label = described or category
        if (label, category if label != category else "") == (thing.label, thing.fixed_category):
            return None
        before, version = thing.label, (thing.version, now)
        self._objects.relabel(thing.id, label, self._embedder.embed_text([label])[0], category if label != category else "")
        told.before[thing.version] = version
        return MapEvent("relabelled", thing.id, f"{before} -> {label}", source)

    def _weigh_merge(self, edit: Merge, proposal: Proposal) -> tuple[MapEvent | None, EditOutcome, str]:
        """Merge what lies within reach and was not seen apart, at once if the extents overlap, else at the second vote."""
        apart = self._objects.times_apart(edit.keep_id, edit.drop_id)
        if apart >= self._objects.settings.separate_frames:
            raise EditRefused(f"landmarks {edit.keep_id} and {edit.drop_id} were seen apart in {apart} keyframes: they are two")
        overlap = require_close(edit.keep_id, edit.drop_id, self._objects, self._smoother)
        low, high = sorted((edit.keep_id, edit.drop_id))
        votes = self._merge_votes.setdefault((low, high), set())
        votes.add(proposal.view_keyframe_id)
        if len(votes) < 2 and not overlap:
            return None, "noted", f"landmarks {edit.keep_id} and {edit.drop_id} are said to be one; a second view is to say so, too"
        del self._merge_votes[low, high]
        event = merge_landmarks(edit.keep_id, edit.drop_id, self._objects, self._smoother, edit.source)
        self._join(edit.keep_id, edit.drop_id)
        return event, "applied", f"{event.detail} into {edit.keep_id}"

    def _verdict(self, edit: Confirm | Doubt | Relabel | Remove, thing: Thing, proposal: Proposal) -> Verdict:
        kinds: dict[type, VerdictKind] = {Confirm: "confirm", Doubt: "doubt", Remove: "remove", Relabel: "name"}
        word = self._word_at(edit.version, thing)
        if isinstance(edit, Relabel):
            word = _clean(edit.category, thing.id) if edit.category else _clean(edit.label, thing.id)
        who, side = f"{proposal.agent} {proposal.model}".strip(), self._side(thing, proposal)
        return Verdict(who, kinds[type(edit)], "" if isinstance(edit, Remove) else word.casefold(), side, proposal.view_keyframe_id)

    def _word_at(self, version: int, thing: Thing) -> str:
        """The plain word that a thing had at a version: what a verdict was about, though the thing was renamed since."""
        word, now, before = _plain_word(thing), thing.version, self._told[thing.id].before
        while now > version and now in before:
            now, word = before[now]
        return word

    def _has_name(self, edit: Relabel) -> bool:
        thing = self._objects[edit.landmark_id]
        given = (edit.label, edit.category if edit.category != edit.label else "")
        return thing.fixed_label is not None and given == (thing.fixed_label, thing.fixed_category)

    def _side(self, thing: Thing, proposal: Proposal) -> int:
        """From where a thing was looked at; a keyframe's own number, below 0, where nothing is known of the camera."""
        if proposal.camera_world is None:
            return -1 - proposal.view_keyframe_id
        x, y, _ = np.array(proposal.camera_world) - self._place(thing)
        return int(np.floor((np.arctan2(y, x) / (2.0 * np.pi)) * SIDES)) % SIDES

    def _require_current(self, edit: Edit) -> None:
        for landmark_id, version in ids_and_versions(edit):
            if landmark_id not in self._objects:
                raise _Stale(f"landmark {landmark_id} is not in the map (any more)")
            now = self._objects[landmark_id].version
            before = self._told[landmark_id].before
            while now > version and now in before:  # an agent's own name changes nothing about the thing
                now = before[now][0]
            if now != version:
                current = self._objects[landmark_id].version
                kind = _Stale if version < current else EditRefused  # a version that never was is a fault of the agent
                raise kind(f"landmark {landmark_id}: the edit is for version {version}, it is at {current} now")

    def _rows(self, ids: Sequence[int]) -> tuple[Landmark, ...]:
        """The landmarks as they are, for the record."""
        known = [i for i in ids if i in self._objects]
        if not known:
            return ()
        every, p_world = self._smoother.positions()
        rows = np.searchsorted(every, np.array(known, dtype=np.int64))
        covariances = np.array([self._objects[i].cov_world for i in known])
        return tuple(self._objects.rows_with(every[rows], p_world[rows], covariances))


def _plain_word(thing: Thing) -> str:
    return (thing.fixed_category or thing.label).casefold()


def _clean(label: object, landmark_id: int) -> str:
    try:
        clean = clean_label(label)
    except FrameError as error:
        raise EditRefused(f"landmark {landmark_id}: {error}") from error
    if clean is None:
        raise EditRefused(f"landmark {landmark_id}: got an empty label")
    return clean
