"""What happened to a thing of the map, told in the report: when it was lost, found, moved or removed."""

from collections.abc import Sequence

from seo_slam.report.crops import RecordedEvent
from seo_slam.report.escaping import escaped

_TOLD = frozenset({"lost", "found", "moved", "merged", "removed"})  # that it was created and became stable goes without saying
_MOST_TOLD = 6


def life_line(events: Sequence[RecordedEvent], start_s: float) -> str:
    """HTML: what happened in order of time, "lost 8.0 s → found 9.1 s"; "" for a thing that was simply there."""
    told = [item for item in events if item.event.kind in _TOLD]
    if not told:
        return ""
    more = f"{len(told) - _MOST_TOLD} earlier → " if len(told) > _MOST_TOLD else ""
    return f'<small class="life">{more}{" → ".join(_words(item, start_s) for item in told[-_MOST_TOLD:])}</small>'


def _words(item: RecordedEvent, start_s: float) -> str:
    event = item.event
    what = f"took in #{event.landmark_id}" if event.kind == "merged" else event.kind
    until_then = f", #{event.other_id} until then" if event.kind == "moved" and event.other_id is not None else ""
    detail = escaped(f"{event.detail}{until_then}", 200)
    title = f' title="{detail}"' if detail else ""
    return f'<span class="{event.kind}"{title}>{what} {item.timestamp_s - start_s:.1f} s</span>'


def away_spans(events: Sequence[RecordedEvent], end_s: float) -> list[tuple[float, float]]:
    """When a thing was lost or gone: stamps of each beginning and end, the last one open to ``end_s``."""
    spans, since = [], None
    for item in events:
        if item.event.kind in ("lost", "removed") and since is None:
            since = item.timestamp_s
        elif item.event.kind in ("found", "moved", "stable") and since is not None:
            spans.append((since, item.timestamp_s))
            since = None
    return spans if since is None else [*spans, (since, end_s)]
