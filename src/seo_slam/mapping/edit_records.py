"""What is written down of a proposal, and in which words."""

from seo_slam.mapping.thing import Thing
from seo_slam.mapping.verdicts import Belief
from seo_slam.records import Confirm, Doubt, Edit, EditOutcome, EditRecord, MapEvent, Merge, Proposal, Relabel, Remove
from seo_slam.types import Landmark


def ids_and_versions(edit: Edit) -> list[tuple[int, int]]:
    """Return the landmarks that an edit names, and their versions; none if it is no edit."""
    match edit:
        case Merge():
            return [(edit.keep_id, edit.keep_version), (edit.drop_id, edit.drop_version)]
        case Confirm() | Doubt() | Relabel() | Remove():
            return [(edit.landmark_id, edit.version)]
        case _:
            return []


def ids_of(edit: Edit) -> list[int]:
    """Return the landmarks that an edit names; of a merge first the one that stays."""
    return [landmark_id for landmark_id, _ in ids_and_versions(edit)]


def record_of(
    proposal: Proposal,
    event: MapEvent | None,
    outcome: EditOutcome,
    detail: str,
    keyframe_id: int,
    now_s: float,
    before: tuple[Landmark, ...],
) -> EditRecord:
    """What is kept; a verdict that led to another change is recorded as that change, since that is what can be undone."""
    edit = proposal.edit
    kinds = {"removed": "remove", "relabelled": "relabel", "merged": "merge", "confirmed": "confirm"}
    kind = kinds[event.kind] if event is not None else type(edit).__name__.lower()
    ids = ids_of(edit)
    return EditRecord(
        kind=kind,
        landmark_id=ids[-1] if ids else -1,
        other_id=ids[0] if len(ids) > 1 else None,
        outcome=outcome,
        detail=detail,
        agent=proposal.agent,
        model=proposal.model,
        prompt_hash=proposal.prompt_hash,
        view_keyframe_id=proposal.view_keyframe_id,
        view_s=proposal.view_s,
        keyframe_id=keyframe_id,
        timestamp_s=now_s,
        before=before,
    )


def in_words(edit: Edit, thing: Thing, belief: Belief) -> str:
    """A verdict that changes nothing (yet), and what is believed now."""
    best = belief.best
    believed = f"nothing {percent(belief.nothing)}" + (f", {best} {percent(belief.words[best])}" if best else "")
    said = f"{edit.label!r}" if isinstance(edit, Relabel) else f"{thing.label!r}"
    return f"{said}; believed: {believed}"


def percent(share: float) -> str:
    """Return a share as "25 %"."""
    return f"{100 * share:.0f} %"
