"""Reads the content of ``run.json`` for the report. Every key may be absent; what has another form is left out, not an error."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from seo_slam.report.crops import RecordedEvent, ReportRecorder
from seo_slam.report.escaping import clean_text, plain

_KNOWN = {
    "dataset",
    "counts",
    "seconds_per_stage",
    "warnings",
    "events",
    "agents",
    "versions",
    "config",
    "peak_memory_mb",
    "complete",
    "embedder",
    "schema",
}
MESSAGE_LIMIT = 500


@dataclass(frozen=True, slots=True)
class StageSeconds:
    """How long one stage took a keyframe (or a frame), seconds; None where not given."""

    name: str
    p50_s: float | None
    p95_s: float | None
    max_s: float | None


@dataclass(frozen=True, slots=True)
class EventLine:
    """One line of the map's history; ``timestamp_s`` and ``keyframe_id`` are None where not known."""

    timestamp_s: float | None
    keyframe_id: int | float | None
    kind: str
    landmark_id: str
    detail: str
    source: str


@dataclass(frozen=True, slots=True)
class RunFacts:
    """What is known of a run.

    Attributes:
        dataset: path or name of the recording, "" if unknown.
        counts: name -> number.
        stages: in the order of the run.
        warnings: message -> how often, the commonest first.
        event_counts: kind -> how often.
        events: the newest ones, oldest first.
        agents: how often agents were asked and what became of their proposals, made plain; empty if there were none.
        versions: package -> version.
        config, rest: as given, made plain; ``rest`` is what has no place of its own.
        peak_memory_mb: None if unknown.
        complete: False if the run was interrupted.
    """

    dataset: str
    counts: dict[str, int | float]
    stages: tuple[StageSeconds, ...]
    warnings: dict[str, int]
    event_counts: dict[str, int]
    events: tuple[EventLine, ...]
    agents: dict[str, Any]
    versions: dict[str, str]
    config: dict[str, Any]
    rest: dict[str, Any]
    peak_memory_mb: float | None
    complete: bool

    @property
    def warning_total(self) -> int:
        """All warnings, repeated ones counted each time."""
        return sum(self.warnings.values())


WARM_UP = "warm up"
"""The stage that loads models: it runs once, and would dwarf what runs on every keyframe."""


def read_run(run: Mapping[str, Any], recorder: ReportRecorder | None) -> RunFacts:
    """Sort ``run`` out; events come from the recorder (which knows their times), else from ``run["events"]``."""
    event_counts, events = _events(run.get("events"), recorder)
    return RunFacts(
        dataset=clean_text(run.get("dataset") or "", MESSAGE_LIMIT),
        counts={clean_text(key): n for key, value in _mapping(run, "counts").items() if (n := _number(value)) is not None},
        stages=tuple(_stage(name, times) for name, times in _mapping(run, "seconds_per_stage").items() if name != WARM_UP),
        warnings=_warnings(run.get("warnings")),
        event_counts=event_counts,
        events=events,
        agents=plain(_mapping(run, "agents")),
        versions={clean_text(key): clean_text(value) for key, value in _mapping(run, "versions").items()},
        config=plain(_mapping(run, "config")),
        rest=plain({key: value for key, value in run.items() if key not in _KNOWN}),
        peak_memory_mb=_number(run.get("peak_memory_mb")),
        complete=run.get("complete") is not False,
    )


def _mapping(run: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = run.get(key)
    return value if isinstance(value, Mapping) else {}


def _rows(value: Any) -> Sequence[Any]:
    return value if isinstance(value, Sequence) and not isinstance(value, str | bytes) else ()


def _number(value: Any) -> int | float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return value


def _stage(name: str, times: Any) -> StageSeconds:
    given = times if isinstance(times, Mapping) else {"p50": times}
    return StageSeconds(clean_text(name), _number(given.get("p50")), _number(given.get("p95")), _number(given.get("max")))


def _warnings(value: Any) -> dict[str, int]:
    counts: Counter[str] = Counter()
    items: Iterable[Any] = value.items() if isinstance(value, Mapping) else _rows(value)
    for item in items:
        if isinstance(item, Mapping):
            message, count = item.get("message", ""), item.get("count", 1)
        elif isinstance(item, tuple) and len(item) == 2:
            message, count = item
        else:
            message, count = item, 1
        counts[clean_text(message, MESSAGE_LIMIT)] += int(_number(count) or 1)
    return dict(counts.most_common())


def _events(value: Any, recorder: ReportRecorder | None) -> tuple[dict[str, int], tuple[EventLine, ...]]:
    lines = [_event_line(item) for item in _rows(value) if isinstance(item, Mapping)]
    if isinstance(value, Mapping):
        given = {clean_text(kind): int(n) for kind, count in value.items() if (n := _number(count)) is not None}
    else:
        given = dict(Counter(line.kind for line in lines))
    if recorder is None or not recorder.events:
        return given, tuple(lines)
    recorded = tuple(_recorded_line(item) for item in recorder.events)
    return given or {clean_text(kind): n for kind, n in recorder.event_counts.items()}, recorded


def _recorded_line(item: RecordedEvent) -> EventLine:
    e = item.event
    detail = _detail(e.kind, e.detail, e.other_id)
    return EventLine(item.timestamp_s, item.keyframe_id, clean_text(e.kind), str(e.landmark_id), detail, clean_text(e.source))


def _event_line(item: Mapping[str, Any]) -> EventLine:
    return EventLine(
        _number(item.get("timestamp_s")),
        _number(item.get("keyframe_id", item.get("keyframe"))),
        clean_text(item.get("kind", "")),
        clean_text(item.get("landmark_id", item.get("landmark", ""))),
        _detail(item.get("kind"), item.get("detail"), item.get("other_id", item.get("other"))),
        clean_text(item.get("source", "")),
    )


def _detail(kind: Any, words: Any, other_id: Any) -> str:
    relation = "until then" if kind == "moved" else "into"
    other = "" if other_id is None else f"{relation} #{clean_text(other_id)}"
    return ", ".join(filter(None, (other, clean_text(words or "", 300))))
