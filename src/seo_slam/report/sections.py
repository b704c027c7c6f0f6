"""The parts of the report around map and table: facts, times, warnings, events, settings."""

import html
import json
from collections.abc import Mapping, Sequence, Set
from pathlib import PurePath
from typing import Any

from seo_slam.report.escaping import escaped
from seo_slam.report.run_facts import MESSAGE_LIMIT, EventLine, RunFacts, StageSeconds

_MOST_LINES = 500
_MOST_CHARACTERS = 60_000


def recording_name(facts: RunFacts) -> str:
    """The last part of the recording's path, not escaped."""
    return PurePath(facts.dataset.replace("\\", "/")).name or facts.dataset or "unnamed recording"


def facts_tiles(facts: RunFacts, landmarks: Mapping[str, int], duration_s: float | None, length_m: float) -> str:
    """The headline numbers; ``landmarks`` counts them by what they are ("stable", "tentative", "lost", "no longer there")."""
    tiles: list[tuple[str, str, str]] = [
        (f"{landmarks['stable']}", "stable landmarks", "main"),
        (f"{landmarks['tentative']}", "tentative", ""),
        *((f"{landmarks[name]}", name, "") for name in ("lost", "no longer there") if landmarks.get(name)),
        (_count(facts.counts.get("frames")), "frames", ""),
        (_count(facts.counts.get("keyframes")), "keyframes", ""),
        (duration(duration_s), "recorded", ""),
        (f"{length_m:.1f} m" if length_m else "–", "camera path", ""),
        (f"{facts.warning_total}", "warning" if facts.warning_total == 1 else "warnings", "alert" if facts.warning_total else ""),
    ]
    if facts.peak_memory_mb is not None:
        tiles.append((f"{facts.peak_memory_mb:.0f} MB", "peak memory", ""))
    body = "".join(f'<div class="tile {kind}"><dd>{escaped(value)}</dd><dt>{escaped(name)}</dt></div>' for value, name, kind in tiles)
    shown = {"frames", "keyframes", "landmarks_stable", "landmarks_tentative", "stable", "tentative", "warnings"}
    others = [(name, value) for name, value in facts.counts.items() if name not in shown]
    more = ", ".join(f"{escaped(name.replace('_', ' '))} {_count(value)}" for name, value in others)
    return f'<dl class="tiles">{body}</dl>' + (f'<p class="dim">Also counted: {more}.</p>' if more else "")


def duration(seconds: float | None) -> str:
    """Seconds in words for people: ``12.3 s``, ``4 min 05 s``, ``2 h 03 min``."""
    if seconds is None:
        return "–"
    if seconds < 120:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 120 else f"{minutes // 60} h {minutes % 60:02d} min"


def _count(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:,}".replace(",", "\u202f") if isinstance(value, int) else f"{value:g}"


def stage_bars(stages: Sequence[StageSeconds]) -> str:
    """Median (dark), 95th percentile (light) and maximum (tick) of every stage, on one scale."""
    if not stages:
        return '<p class="dim">No times were given.</p>'
    top = _scale_end_s(stages)
    rows = "".join(_stage_row(stage, top * 1.02) for stage in stages)
    return (
        '<table class="stages"><thead><tr><th scope="col">stage</th><th scope="col" class="bars"></th><th scope="col">p50</th>'
        f'<th scope="col">p95</th><th scope="col">max</th></tr></thead><tbody>{rows}</tbody></table>'
        '<p class="legend"><span><i class="key p50"></i>median</span><span><i class="key p95"></i>95 % are below</span>'
        f'<span><i class="key max"></i>maximum (an arrow: beyond the scale)</span><span>scale ends at {_seconds(top)}</span></p>'
    )


def _scale_end_s(stages: Sequence[StageSeconds]) -> float:
    """The greatest p95, but at most four times the greatest median: the loading of a model must not hide all else."""
    medians, high = max(s.p50_s or 0.0 for s in stages), max(s.p95_s or s.p50_s or 0.0 for s in stages)
    return (min(high, 4 * medians) if medians > 0 else high) or 1e-9


def _stage_row(stage: StageSeconds, top_s: float) -> str:
    def share(seconds: float | None) -> float:
        return 100 * min((seconds or 0.0) / top_s, 1.0)

    most = ""
    if stage.max_s is not None:
        beyond = stage.max_s > top_s
        most = '<i class="max beyond"></i>' if beyond else f'<i class="max" style="left:{share(stage.max_s):.1f}%"></i>'
    bars = f'<i class="p95" style="width:{share(stage.p95_s):.1f}%"></i><i class="p50" style="width:{share(stage.p50_s):.1f}%"></i>{most}'
    numbers = "".join(
        f'<td class="num" data-name="{name}">{_seconds(value)}</td>'
        for name, value in (("p50", stage.p50_s), ("p95", stage.p95_s), ("max", stage.max_s))
    )
    return f'<tr><th scope="row">{escaped(stage.name)}</th><td class="bars"><div class="track">{bars}</div></td>{numbers}</tr>'


def _seconds(seconds: float | None) -> str:
    if seconds is None:
        return "–"
    if seconds >= 1:
        return f"{seconds:.2f} s"
    if seconds >= 0.1:
        return f"{1000 * seconds:.0f} ms"
    return f"{1000 * seconds:.1f} ms" if seconds >= 1e-4 else f"{1e6 * seconds:.0f} µs"


def warning_list(warnings: dict[str, int]) -> str:
    """Each message once, with how often it came."""
    if not warnings:
        return '<p class="dim">None.</p>'
    total, kinds = sum(warnings.values()), len(warnings)
    shown = list(warnings.items())[:_MOST_LINES]
    rows = "".join(f"<li><b>{count}×</b> {escaped(message, MESSAGE_LIMIT)}</li>" for message, count in shown)
    more = f"<li>and {kinds - len(shown)} other messages</li>" if kinds > len(shown) else ""
    title = f"{total} warnings, {kinds} different" if total > 1 else "1 warning"
    return folded(title, f'<ul class="warnings">{rows}{more}</ul>')


def event_list(counts: dict[str, int], events: Sequence[EventLine], start_s: float, in_map: Set[str]) -> str:
    """How often each kind of event was, and the newest ones in a folded table; ids that are ``in_map`` link to their row."""
    if not counts and not events:
        return '<p class="dim">None were recorded.</p>'
    chips = "".join(f"<li><b>{count}</b> {escaped(kind)}</li>" for kind, count in counts.items())
    shown = events[-_MOST_LINES:]
    rows = "".join(_event_row(event, start_s, in_map) for event in shown)
    table = (
        '<table class="events"><thead><tr><th scope="col" class="num">time</th><th scope="col">event</th>'
        f'<th scope="col">landmark</th><th scope="col">detail</th><th scope="col">by</th></tr></thead><tbody>{rows}</tbody></table>'
    )
    title = f"all {len(events)}, oldest first" if len(shown) == sum(counts.values()) else f"the last {len(shown)}, oldest first"
    return f'<ul class="chips">{chips}</ul>' + (folded(title, table) if shown else "")


def _event_row(event: EventLine, start_s: float, in_map: Set[str]) -> str:
    time = f"keyframe {event.keyframe_id}" if event.keyframe_id is not None else "–"
    if event.timestamp_s is not None:
        time = f"{event.timestamp_s - start_s:.1f} s"
    landmark = f"#{escaped(event.landmark_id)}" if event.landmark_id else ""
    if event.landmark_id in in_map:
        landmark = f'<a href="#landmark-{escaped(event.landmark_id)}">{landmark}</a>'
    return (
        f'<tr><td class="num">{time}</td><td>{escaped(event.kind)}</td><td>{landmark}</td>'
        f"<td>{escaped(event.detail, 300)}</td><td>{escaped(event.source)}</td></tr>"
    )


def settings_and_versions(facts: RunFacts, embedder: str) -> str:
    """Configuration, versions and everything else that was given of the run, all folded."""
    versions = "".join(f"<div><dt>{escaped(name)}</dt><dd>{escaped(value)}</dd></div>" for name, value in facts.versions.items())
    parts = [f"<p>Text embedding: {escaped(embedder) or 'none'}.</p>"]
    parts += [folded("versions", f'<dl class="pairs">{versions}</dl>')] if versions else []
    parts += [folded("settings", _json_block(facts.config))] if facts.config else []
    parts += [folded("more about the run", _json_block(facts.rest))] if facts.rest else []
    return "".join(parts)


def folded(title: str, body: str) -> str:
    """A ``<details>``; ``body`` is HTML, ``title`` is text."""
    return f"<details><summary>{escaped(title)}</summary>{body}</details>"


def _json_block(data: dict[str, Any]) -> str:
    text = json.dumps(data, indent=2, ensure_ascii=False)
    shown = text if len(text) <= _MOST_CHARACTERS else text[:_MOST_CHARACTERS] + "\n… cut here, see run.json"
    return f"<pre>{html.escape(shown)}</pre>"
