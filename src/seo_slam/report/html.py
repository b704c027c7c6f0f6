"""Writes the report of a run: one HTML file that needs no network and no other file."""

from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from seo_slam.records import Trajectory
from seo_slam.report import sections
from seo_slam.report.crops import ReportRecorder
from seo_slam.report.edit_section import counts_of, edit_section
from seo_slam.report.escaping import escaped
from seo_slam.report.landmark_table import LabelColours, TableContext, gone_table, landmark_table, last_name, sigma_m
from seo_slam.report.map_svg import NARROW, WIDE, Scene, make_scene, render_map
from seo_slam.report.page import document, section, write_whole
from seo_slam.report.run_facts import RunFacts, read_run
from seo_slam.types import Landmark

SCHEMA = "seo_slam.report/1"


class ReportedMap(Protocol):
    """What the report needs of a map; ``seo_slam.Map`` has it."""

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """The stable ones."""
        ...

    @property
    def tentative(self) -> tuple[Landmark, ...]:
        """Those that are not stable: tentative or lost."""
        ...

    @property
    def gravity(self) -> str:
        """How the world's z axis came to point up, or "unknown"."""
        ...

    @property
    def embedder(self) -> str:
        """Name of the text embedding."""
        ...


def write_report(
    path: str | Path, *, map: ReportedMap, trajectory: Trajectory, recorder: ReportRecorder | None, run: Mapping[str, Any]
) -> None:
    """Write the report of a run; the same input gives the same bytes.

    Args:
        path: the file to write; replaced only once the new one is complete.
        map: the map at the end of the run.
        trajectory: camera poses, world frame, metres; may be empty.
        recorder: what was seen on the way; None leaves pictures and label histories out.
        run: content of ``run.json``; every key may be absent.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, render_report(map=map, trajectory=trajectory, recorder=recorder, run=run))


def render_report(*, map: ReportedMap, trajectory: Trajectory, recorder: ReportRecorder | None, run: Mapping[str, Any]) -> str:
    """Return the page that ``write_report`` writes."""
    stable, tentative = tuple(map.landmarks), tuple(map.tentative)
    facts = read_run(run, recorder)
    start_s, end_s = _time_span(trajectory, (*stable, *tentative))
    context = TableContext(recorder, LabelColours((*stable, *tentative)), start_s, end_s)
    scene = make_scene((*stable, *tentative), map.gravity, trajectory)
    length_m = float(np.linalg.norm(np.diff(trajectory.T_world_camera[:, :3, 3], axis=0), axis=1).sum()) if len(trajectory) else 0.0
    duration_s = end_s - start_s if end_s > start_s else None
    name = sections.recording_name(facts)
    gone = recorder.gone if recorder else ()
    ids = {str(i) for i in (*(m.id for m in (*stable, *tentative)), *gone)}
    lost = sum(m.state == "lost" for m in tentative)
    counts = {"stable": len(stable), "tentative": len(tentative) - lost, "lost": lost, "no longer there": len(gone)}
    main = (
        _header(facts, name),
        sections.facts_tiles(facts, counts, duration_s, length_m),
        _map_section(scene, context.colours, len(tentative)),
        _landmark_section(stable, tentative, context),
        *_edits(facts, recorder, start_s, ids),
        section("times", "Time per stage", sections.stage_bars(facts.stages)),
        section("warnings", "Warnings", sections.warning_list(facts.warnings)),
        section("events", "Events of the map", sections.event_list(facts.event_counts, facts.events, start_s, ids)),
        section("settings", "Settings and versions", sections.settings_and_versions(facts, map.embedder)),
    )
    data = _page_data(map, trajectory, context, facts, scene, {"duration_s": duration_s, "path_length_m": length_m})
    return document(f"{name}: map of things", "".join(main), data)


def _edits(facts: RunFacts, recorder: ReportRecorder | None, start_s: float, ids: Set[str]) -> tuple[str, ...]:
    """The section of a run that had agents; nothing for others."""
    log = recorder.edits if recorder else None
    counts = _edit_counts(facts, recorder)
    if not counts and not facts.agents:
        return ()
    asked = {key: value for key, value in facts.agents.items() if key != "edits"}
    return (section("edits", "Edits by agents", edit_section(log, counts, asked, start_s, ids)),)


def _edit_counts(facts: RunFacts, recorder: ReportRecorder | None) -> dict[tuple[str, str, str], int]:
    """Agent, kind and outcome -> number, as the run counted them, else as the recorder saw them."""
    return counts_of(facts.agents) or (recorder.edits.counts if recorder else {})


def _time_span(trajectory: Trajectory, landmarks: Sequence[Landmark]) -> tuple[float, float]:
    stamps = [*trajectory.timestamps_s[[0, -1]]] if len(trajectory) else []
    stamps += [s for m in landmarks for s in (m.first_seen_s, m.last_seen_s) if np.isfinite(s)]
    return (float(min(stamps)), float(max(stamps))) if stamps else (0.0, 0.0)


def _header(facts: RunFacts, name: str) -> str:
    where = f'<p class="dim path-name">{escaped(facts.dataset, 500)}</p>' if facts.dataset != name else ""
    short = "" if facts.complete else '<p class="cut-short">The run was interrupted: this is what was seen until then.</p>'
    return f'<header><p class="kicker">seo_slam · report of a run</p><h1>{escaped(name)}</h1>{where}{short}</header>'


def _map_section(scene: Scene, colours: LabelColours, tentative: int) -> str:
    gone = ", ".join(f'<a href="#landmark-{i}">#{i}</a>' for i in scene.left_out[:40])
    more = f" and {len(scene.left_out) - 40} more" if len(scene.left_out) > 40 else ""
    left_out = f'<p class="dim">Too far away to be drawn with the others: {gone}{more}.</p>' if gone else ""
    toggle = (
        '<label><input type="checkbox" id="show-tentative" checked><i class="key tentative"></i>tentative or lost</label>'
        if tentative
        else ""
    )
    body = (
        f'<p class="dim">{escaped(scene.projection.caption, 300)} Touch a landmark for its details.</p>'
        f'<div id="map">'
        f"{render_map(scene, WIDE, colours.css_class)}{render_map(scene, NARROW, colours.css_class)}</div>"
        '<div id="details" aria-live="polite" hidden></div>'
        '<p class="legend"><span><i class="key dot"></i>landmark</span><span><i class="key sigma"></i>its 2-sigma ellipse</span>'
        f'<span><i class="key foot"></i>its size</span>{toggle}'
        '<span><i class="key path"></i>camera path</span>'
        '<span><i class="key start"></i>start</span><span><i class="key end"></i>end</span></p>'
        f"{left_out}"
    )
    return section("map", "Map", body)


def _landmark_section(stable: Sequence[Landmark], others: Sequence[Landmark], context: TableContext) -> str:
    controls = (
        '<div class="controls" hidden><label>find <input type="search" id="filter" placeholder="label or id"></label>'
        '<label>sort by <select id="sort"><option value="id">id<option value="label">label<option value="observations">times seen'
        '<option value="existence">existence<option value="sigma">sigma<option value="size">size'
        '<option value="first">first seen</select></label></div>'
    )
    empty = '<p class="dim">The map holds no stable landmark.</p>'
    body = controls + (landmark_table(stable, "stable", context) if stable else empty)
    lost = [m for m in others if m.state == "lost"]
    tentative = [m for m in others if m.state != "lost"]
    if lost:
        body += sections.folded(f"{len(lost)} lost: not seen where they should be", landmark_table(lost, "lost", context))
    if context.recorder and context.recorder.gone:
        title = f"{len(context.recorder.gone)} no longer there: removed, and what was known of them"
        body += sections.folded(title, gone_table(context.recorder, context))
    if tentative:
        title = f"{len(tentative)} tentative: not seen often or long enough yet"
        body += sections.folded(title, landmark_table(tentative, "tentative", context))
    return section("landmarks", "Landmarks", body)


def _landmark_data(m: Landmark, context: TableContext) -> dict[str, Any]:
    recorder = context.recorder
    return {
        "id": m.id,
        "label": m.label,
        "category": m.category,
        "labels": dict(m.labels),
        "position_m": m.position_m,
        "sigma_m": sigma_m(m),
        "size_m": m.size_m,
        "observations": m.observations,
        "existence": m.existence,
        "first_seen_s": m.first_seen_s,
        "last_seen_s": m.last_seen_s,
        "state": m.state,
        "has_crop": bool(recorder and recorder.crop(m.id)),
        **_history_data(m.id, recorder),
    }


def _history_data(landmark_id: int, recorder: ReportRecorder | None) -> dict[str, Any]:
    runs, life = (recorder.label_history(landmark_id), recorder.life(landmark_id)) if recorder else ((), ())
    return {
        "history": [[run.first_s, run.last_s, run.label, run.count] for run in runs],
        "life": [[item.timestamp_s, item.event.kind, item.event.detail] for item in life],
    }


def _gone_data(recorder: ReportRecorder) -> list[dict[str, Any]]:
    return [{"id": i, "label": last_name(i, recorder), **_history_data(i, recorder)} for i in recorder.gone]


def _page_data(
    map: ReportedMap, trajectory: Trajectory, context: TableContext, facts: RunFacts, scene: Scene, extra: Mapping[str, Any]
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "dataset": facts.dataset,
        "gravity": map.gravity,
        "embedder": map.embedder,
        "counts": {
            **facts.counts,
            "stable": len(map.landmarks),
            "tentative": len(map.tentative),
            "lost": sum(m.state == "lost" for m in map.tentative),
            "gone": len(context.recorder.gone) if context.recorder else 0,
            "warnings": facts.warning_total,
            "poses": len(trajectory),
        },
        **extra,
        "landmarks": [_landmark_data(m, context) for m in map.landmarks],
        "tentative": [_landmark_data(m, context) for m in map.tentative],
        "gone": _gone_data(context.recorder) if context.recorder else [],
        "not_drawn": scene.left_out,
        "seconds_per_stage": {s.name: {"p50": s.p50_s, "p95": s.p95_s, "max": s.max_s} for s in facts.stages},
        "warnings": [{"message": message, "count": count} for message, count in facts.warnings.items()],
        "events": facts.event_counts,
        "edits": [
            {"agent": agent, "kind": kind, "outcome": outcome, "number": n}
            for (agent, kind, outcome), n in sorted(_edit_counts(facts, context.recorder).items())
        ],
        "peak_memory_mb": facts.peak_memory_mb,
        "complete": facts.complete,
    }
