"""What a landmark was called over time, as runs of equal labels."""

from dataclasses import dataclass, replace

_NEW_RUN_AFTER_S = 2.0  # longer without a sighting than this, and the strip in the report shows a gap
_MOST_RUNS = 256


@dataclass(frozen=True, slots=True)
class LabelRun:
    """Consecutive sightings under one label.

    Attributes:
        first_s, last_s: stamps of the first and the last of them.
        label: the detector's word; None where it gave none.
        count: sightings.
    """

    first_s: float
    last_s: float
    label: str | None
    count: int


class LabelHistory:
    """Runs of labels in order of time, at most 256 of them: past that, neighbours are folded, the heavier label kept."""

    def __init__(self) -> None:
        self._runs: list[LabelRun] = []

    @property
    def runs(self) -> tuple[LabelRun, ...]:
        """Oldest first."""
        return tuple(self._runs)

    def add(self, timestamp_s: float, label: str | None) -> None:
        """Add one sighting."""
        last = self._runs[-1] if self._runs else None
        if last and last.label == label and timestamp_s - last.last_s <= _NEW_RUN_AFTER_S:
            self._runs[-1] = replace(last, last_s=timestamp_s, count=last.count + 1)
            return
        self._runs.append(LabelRun(timestamp_s, timestamp_s, label, 1))
        self._fold()

    def merge(self, other: "LabelHistory") -> None:
        """Take in all sightings of another history."""
        self._runs = sorted([*self._runs, *other._runs], key=lambda run: run.first_s)
        self._fold()

    def _fold(self) -> None:
        while len(self._runs) > _MOST_RUNS:
            pairs = zip(self._runs[::2], self._runs[1::2], strict=False)
            folded = [_one_of(a, b) for a, b in pairs]
            self._runs = folded + self._runs[2 * len(folded) :]


def _one_of(a: LabelRun, b: LabelRun) -> LabelRun:
    heavier = a if a.count >= b.count else b
    return LabelRun(a.first_s, max(a.last_s, b.last_s), heavier.label, a.count + b.count)
