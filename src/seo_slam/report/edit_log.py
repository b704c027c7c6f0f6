"""Notes, while a pipeline runs, what agents changed, each with the pictures that its landmarks had just then."""

from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from seo_slam.records import EditRecord, MapEvent
from seo_slam.report.crop import Crop

_CHANGES = {"relabel": "relabelled", "remove": "removed", "merge": "merged"}


@dataclass(frozen=True, slots=True)
class NotedEdit:
    """An edit of the run.

    Attributes:
        number: counted from 1, as in the run's map.db.
        edit: what became of a proposal.
        crops: of what it changed: the landmark's best picture, and for a merge that of the one that stayed; None where there is none.
    """

    number: int
    edit: EditRecord
    crops: tuple[Crop | None, ...] = ()


def is_change(edit: EditRecord) -> bool:
    """Whether an edit renamed, removed or merged something."""
    return edit.outcome == "applied" and edit.kind in _CHANGES


def event_of(edit: EditRecord) -> MapEvent | None:
    """Return the event that an edit made, or None if it changed nothing."""
    return MapEvent(_CHANGES[edit.kind], edit.landmark_id, edit.detail, edit.agent, edit.other_id) if is_change(edit) else None


class EditLog:
    """The newest edits of a run, and counts of all of them.

    Args:
        crop: gives the best picture of a landmark, as it is when called.
        most_changes: edits kept that changed the map, with pictures.
        most_others: edits kept that did not.
    """

    def __init__(self, crop: Callable[[int], Crop | None], most_changes: int = 300, most_others: int = 300) -> None:
        self._crop = crop
        self._changes: deque[NotedEdit] = deque(maxlen=most_changes)
        self._others: deque[NotedEdit] = deque(maxlen=most_others)
        self._counts: Counter[tuple[str, str, str]] = Counter()

    @property
    def changes(self) -> tuple[NotedEdit, ...]:
        """The newest edits that changed the map, oldest first."""
        return tuple(self._changes)

    @property
    def others(self) -> tuple[NotedEdit, ...]:
        """The newest edits that did not, oldest first."""
        return tuple(self._others)

    @property
    def counts(self) -> dict[tuple[str, str, str], int]:
        """Agent, kind and outcome -> how many there were in the whole run."""
        return dict(self._counts)

    def note(self, edits: Iterable[EditRecord]) -> None:
        """Take in edits, before what they did to the landmarks is followed."""
        for edit in edits:
            self._counts[edit.agent, edit.kind, edit.outcome] += 1
            number = self._counts.total()
            if not is_change(edit):
                self._others.append(NotedEdit(number, edit))
                continue
            ids = (edit.landmark_id, edit.other_id) if edit.kind == "merge" and edit.other_id is not None else (edit.landmark_id,)
            self._changes.append(NotedEdit(number, edit, tuple(self._crop(i) for i in ids)))
