"""What became of landmarks: ghosts of things that left, things that were only hidden, and ids of things that moved.

Everything here is a pure function of the keyframes that ``life_watch`` collected.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from life_watch import Moment, Seen, events_of, heir_of

from seo_slam.evaluation.landmarks import distances
from seo_slam.evaluation.true_objects import TruthObject, reach_m

GHOST_KEYFRAMES = 10
GHOST_SECONDS = 5.0
HIDDEN_SHARE = 0.5
SEEN_SHARE = 0.2
HIDDEN_KEYFRAMES = 5
SEEN_AGAIN_KEYFRAMES = 5

DEFINITIONS = {
    "landmark of a thing": "the stable landmark that stands for it at the last keyframe before the change (or before it was first hidden): "
    "one-to-one with all things present then, by place alone (labels ignored), as many as possible, then nearest; within the radius, or "
    "half the thing's smaller horizontal extent, of the centre of its box or of its surface seen so far",
    "ghosts": "things removed or moved that had a landmark; looked at when their old place should have been seen in "
    f"{GHOST_KEYFRAMES} keyframes (centre of the old box inside the true image by a margin of 5 %, in range, no true surface nearer) and "
    f"{GHOST_SECONDS:g} s have gone by since the change, whichever is later. Gone: no stable landmark within reach of the old place but "
    "those that stand for a thing present, or are nearer to one; the old landmark itself counts in any case unless it stands for a "
    "thing. undecided: the recording ends before. taken_over: gone, but the old landmark stands now for another thing",
    "hidden": f"things that never changed, had a landmark, and were then less than {100 * HIDDEN_SHARE:g} % visible in at least "
    f"{HIDDEN_KEYFRAMES} keyframes with the centre of their box inside the image. removed: their landmark (or the one it was merged into) "
    "left the map after the first of them, as a 'removed' event; lost: it did not, but is not stable at the end",
    "stayed": "all things that never changed and had a landmark at some time: whether the first landmark was removed later; a wider figure",
    "moved": "things moved that had a landmark before and were seen again in at least "
    f"{SEEN_AGAIN_KEYFRAMES} keyframes (at least {100 * SEEN_SHARE:g} % visible, enough pixels for the detector). kept: the same "
    "landmark, or the one it was merged into, stands for it at the end; other_id: another one does; not_mapped_again: none does",
    "took_another_id": "things that moved and end with the landmark that stood for another thing before the first change; "
    "others_took_another_id: things that did not move, and end with the landmark of one that left",
}

Case = dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Left:
    """A change of the scene that leaves a place.

    Attributes:
        index: of the change.
        timestamp_s: when.
        event: "removed" or "moved".
        thing: as it stood there before; its id is the thing's, as text.
    """

    index: int
    timestamp_s: float
    event: str
    thing: TruthObject

    @property
    def thing_id(self) -> int:
        """Of the thing."""
        return int(self.thing.id)


def before(moments: Sequence[Moment], timestamp_s: float) -> list[Moment]:
    """Return the keyframes before a time."""
    return [moment for moment in moments if moment.timestamp_s < timestamp_s]


def after(moments: Sequence[Moment], timestamp_s: float) -> list[Moment]:
    """Return the keyframes from a time on."""
    return [moment for moment in moments if moment.timestamp_s >= timestamp_s]


def judge_ghost(moments: Sequence[Moment], left: Left, radius_m: float) -> Case:
    """Return what became of the landmark of a thing that left its place: verdict "not_mapped", "undecided", "gone" or "ghost"."""
    earlier, later = before(moments, left.timestamp_s), after(moments, left.timestamp_s)
    landmark_id = earlier[-1].owners.get(left.thing_id) if earlier else None
    case: Case = {"thing": left.thing_id, "label": left.thing.labels[0], "event": left.event, "landmark": landmark_id}
    if landmark_id is None:
        return case | {"verdict": "not_mapped"}
    views = np.cumsum([left.index in moment.true.open_places for moment in later])
    due = next((k for k, m in enumerate(later) if views[k] >= GHOST_KEYFRAMES and m.timestamp_s - left.timestamp_s >= GHOST_SECONDS), None)
    looked = later if due is None else later[: due + 1]
    heir = heir_of(landmark_id, events_of(looked))
    where = looked[-1] if looked else earlier[-1]
    standing = ghosts_at(where, left, heir, radius_m)
    case |= {
        "views": int(views[len(looked) - 1]) if looked else 0,
        "seconds": round(where.timestamp_s - left.timestamp_s, 3),
        "hits_since": sum(heir in moment.hits for moment in looked),
        "gone_after_s": gone_after_s(looked, left, landmark_id, radius_m),
        "standing": standing,
        "taken_over_by": next((thing for thing, owner in where.owners.items() if owner == heir and thing != left.thing_id), None),
    }
    return case | {"verdict": "undecided" if due is None else "ghost" if standing else "gone"}


def ghosts_at(moment: Moment, left: Left, landmark_id: int, radius_m: float) -> list[Case]:
    """Return the stable landmarks that still stand for a thing at the place it left."""
    reach = reach_m(left.thing, radius_m)
    used = set(moment.owners.values())
    found = []
    for number, known in moment.landmarks.items():
        if known.state != "stable" or number in used:
            continue
        point = known.p_world.reshape(1, 3)
        away_m = float(distances(point, [left.thing])[0, 0])
        others_m = float(distances(point, moment.true.objects).min()) if moment.true.objects else np.inf
        if away_m <= reach and (number == landmark_id or away_m < others_m):
            found.append({"landmark": number, "label": known.label, "away_m": round(away_m, 3), "existence": round(known.existence, 3)})
    return found


def gone_after_s(moments: Sequence[Moment], left: Left, landmark_id: int, radius_m: float) -> float | None:
    """Return the seconds from the change until no ghost stands at the old place any more, to the end; None: one still does."""
    standing = [bool(ghosts_at(m, left, heir_of(landmark_id, events_of(moments[: k + 1])), radius_m)) for k, m in enumerate(moments)]
    if not moments or standing[-1]:
        return None
    last = max((k for k, is_standing in enumerate(standing) if is_standing), default=-1)
    return round(moments[last + 1].timestamp_s - left.timestamp_s, 3)


def judge_hidden(moments: Sequence[Moment], thing: TruthObject, smallest_px: float) -> Case | None:
    """Return what became of the landmark of a thing that stayed but was hidden for a while; None if it was not, or had none before."""
    thing_id = int(thing.id)
    mapped = next((k for k, moment in enumerate(moments) if thing_id in moment.owners), None)
    if mapped is None:
        return None
    hidden = [k for k in range(mapped + 1, len(moments)) if is_hidden(moments[k].true.seen.get(thing_id), smallest_px)]
    if len(hidden) < HIDDEN_KEYFRAMES:
        return None
    owner = next(moments[k].owners[thing_id] for k in range(hidden[0] - 1, -1, -1) if thing_id in moments[k].owners)
    return fate(moments, thing, owner, hidden[0]) | {"hidden_keyframes": len(hidden)}


def judge_stayed(moments: Sequence[Moment], thing: TruthObject) -> Case | None:
    """Return what became of the first landmark of a thing that stayed; None if it had none."""
    thing_id = int(thing.id)
    mapped = next((k for k, moment in enumerate(moments) if thing_id in moment.owners), None)
    return None if mapped is None else fate(moments, thing, moments[mapped].owners[thing_id], mapped + 1)


def is_hidden(seen: Seen | None, smallest_px: float) -> bool:
    """Whether a thing is in the image, but behind something."""
    return seen is not None and seen.inside and seen.covered_px >= smallest_px and seen.share < HIDDEN_SHARE


def fate(moments: Sequence[Moment], thing: TruthObject, landmark_id: int, start: int) -> Case:
    """Return what became of a landmark from a keyframe on: verdict "kept", "lost" (in the map, but not stable at the end) or "removed"."""
    thing_id = int(thing.id)
    case: Case = {"thing": thing_id, "label": thing.labels[0], "landmark": landmark_id}
    for k in range(start, len(moments)):
        heir = heir_of(landmark_id, moments[k].events)
        if any(event.kind == "removed" and event.landmark_id in (landmark_id, heir) for event in moments[k].events):
            return case | removal(moments, k, heir, thing_id)
        landmark_id = heir
    known = moments[-1].landmarks.get(landmark_id)
    stable = known is not None and known.state == "stable"
    state = None if known is None else {"existence": round(known.existence, 3), "label_in_map": known.label}
    return case | {"verdict": "kept" if stable else "lost", "heir": landmark_id, "at_the_end": state}


def removal(moments: Sequence[Moment], k: int, landmark_id: int, thing_id: int) -> Case:
    """Return what is known of the removal of a landmark at a keyframe."""
    moment, known = moments[k], moments[k - 1].landmarks.get(landmark_id) if k else None
    seen = moment.true.seen.get(thing_id)
    thing = next(item for item in moment.true.objects if int(item.id) == thing_id)
    return {
        "verdict": "removed",
        "timestamp_s": moment.timestamp_s,
        "label_in_map": known.label if known else None,
        "away_m": round(float(distances(known.p_world.reshape(1, 3), [thing])[0, 0]), 3) if known else None,
        "visible_share": round(seen.share, 3) if seen and seen.covered_px else None,
        "visible_px": seen.visible_px if seen else None,
        "another_stands_for_it": moment.owners.get(thing_id),
        "and_at_the_end": moments[-1].owners.get(thing_id),
    }


def judge_moved(moments: Sequence[Moment], left: Left, smallest_px: float) -> Case:
    """Return whether a thing that moved kept its id.

    The verdict is "not_mapped" (before), "not_seen_again", "kept", "other_id" or "not_mapped_again".
    """
    earlier, later = before(moments, left.timestamp_s), after(moments, left.timestamp_s)
    landmark_id = earlier[-1].owners.get(left.thing_id) if earlier else None
    case: Case = {"thing": left.thing_id, "label": left.thing.labels[0], "landmark": landmark_id}
    if landmark_id is None:
        return case | {"verdict": "not_mapped"}
    views = [moment.true.seen.get(left.thing_id) for moment in later]
    seen_again = sum(seen is not None and seen.visible_px >= smallest_px and seen.share >= SEEN_SHARE for seen in views)
    case["views_again"] = seen_again
    if seen_again < SEEN_AGAIN_KEYFRAMES:
        return case | {"verdict": "not_seen_again"}
    heir = heir_of(landmark_id, events_of(later))
    now = later[-1].owners.get(left.thing_id)
    verdict = "not_mapped_again" if now is None else "kept" if now == heir else "other_id"
    old = later[-1].landmarks.get(heir)
    return case | {
        "verdict": verdict,
        "heir": heir,
        "landmark_now": now,
        "label_now": later[-1].landmarks[now].label if now is not None else None,
        "old_landmark_is": old.state if old else "out of the map",
        "events_of_both": [
            {"kind": e.kind, "landmark": e.landmark_id, "other": e.other_id}
            for e in events_of(later)
            if {e.landmark_id, e.other_id} & {landmark_id, heir, now} - {None}
        ],
    }


def taken_ids(moments: Sequence[Moment], first_change_s: float, moved: set[int], removed: set[int]) -> tuple[list[Case], list[Case]]:
    """Return the things that end with the landmark that stood for another thing before the first change.

    First those that moved; then those that did not, with the landmark of a thing that left. Things that stood still the whole time are
    left out: like ones stand so close together that the assignment by place may swap them without anything being wrong.
    """
    earlier, later = before(moments, first_change_s), after(moments, first_change_s)
    if not (earlier and later):
        return [], []
    was: dict[int, int] = {}  # landmark at the end -> the thing it stood for
    for thing_id, landmark_id in earlier[-1].owners.items():
        was.setdefault(heir_of(landmark_id, events_of(later)), thing_id)
    own: list[Case] = []
    others: list[Case] = []
    for thing_id, landmark_id in later[-1].owners.items():
        stood_for = was.get(landmark_id, thing_id)
        if stood_for == thing_id:
            continue
        case: Case = {"thing": thing_id, "landmark": landmark_id, "stood_for": stood_for}
        if thing_id in moved:
            own.append(case)
        elif stood_for in moved | removed:
            others.append(case)
    return own, others


def counted(cases: Sequence[Mapping[str, Any]]) -> dict[str, int]:
    """Return how often each verdict was given."""
    verdicts = [str(case["verdict"]) for case in cases]
    return {verdict: verdicts.count(verdict) for verdict in sorted(set(verdicts))}
