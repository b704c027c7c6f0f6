"""The part of the report that shows what agents did to the map."""

from collections.abc import Mapping, Sequence, Set
from typing import Any

from seo_slam.records import EditRecord
from seo_slam.report.edit_log import EditLog, NotedEdit
from seo_slam.report.escaping import escaped
from seo_slam.report.landmark_table import picture
from seo_slam.report.sections import folded
from seo_slam.types import Landmark

OUTCOMES = ("applied", "noted", "stale", "refused")
_SHOWN_AT_ONCE = 16
_MOST_AGENTS = 40
_MEANINGS = {
    "applied": "the map was changed, or the landmark confirmed",
    "noted": "it counts, but changes nothing by itself",
    "stale": "the landmark had changed since it was looked at",
    "refused": "the geometry, or what else is known, was against it",
}
Counts = Mapping[tuple[str, str, str], int]


def edit_section(log: EditLog | None, counts: Counts, asked: Mapping[str, Any], start_s: float, in_map: Set[str]) -> str:
    """HTML: counts by agent and outcome, what was changed, newest first and with pictures, and what was not, folded.

    Args:
        log: edits of the run; None where nobody noted them.
        counts: agent, kind and outcome -> how many.
        asked: figures of the run's agents, as run.json has them; may be empty.
        start_s: stamp that times are counted from.
        in_map: ids of landmarks that have a row in the report.
    """
    parts = [_counts_table(counts)] if counts else ['<p class="dim">They proposed nothing.</p>']
    if log and log.changes:
        newest = log.changes[::-1]
        parts.append(_cards(newest[:_SHOWN_AT_ONCE], start_s, in_map))
        if newest[_SHOWN_AT_ONCE:]:
            parts.append(folded(f"{len(newest) - _SHOWN_AT_ONCE} earlier changes", _cards(newest[_SHOWN_AT_ONCE:], start_s, in_map)))
        left_out = sum(n for (_, kind, outcome), n in counts.items() if outcome == "applied" and kind != "confirm") - len(newest)
        parts.append(f'<p class="dim">{left_out} older changes are not shown.</p>' if left_out > 0 else "")
        parts.append(
            '<p class="dim"><code>seo-slam edits</code> lists all of them; with <code>--undo</code> and its number it takes one back.</p>'
        )
    if log and log.others:
        parts.append(
            folded(f"the last {len(log.others)} proposals that changed nothing, newest first", _lines(log.others[::-1], start_s, in_map))
        )
    if asked:
        parts.append(folded("how often they were asked", _pairs(asked)))
    return "".join(parts)


def counts_of(run_agents: Mapping[str, Any]) -> dict[tuple[str, str, str], int]:
    """Counts as run.json has them; lines of another form are left out."""
    lines = run_agents.get("edits")
    found: dict[tuple[str, str, str], int] = {}
    for line in lines if isinstance(lines, Sequence) and not isinstance(lines, str) else ():
        if isinstance(line, Mapping) and isinstance(line.get("number"), int):
            key = (str(line.get("agent", "")), str(line.get("kind", "")), str(line.get("outcome", "")))
            found[key] = found.get(key, 0) + line["number"]
    return found


def _counts_table(counts: Counts) -> str:
    agents = sorted({agent for agent, _, _ in counts})
    heads = "".join(f'<th scope="col" title="{_MEANINGS[outcome]}">{outcome}</th>' for outcome in OUTCOMES)
    rows = "".join(_counts_row(agent, counts) for agent in agents[:_MOST_AGENTS])
    more = f'<p class="dim">and {len(agents) - _MOST_AGENTS} other agents</p>' if len(agents) > _MOST_AGENTS else ""
    return (
        f'<div class="table-frame"><table class="numbers"><thead><tr><th scope="col">agent</th>{heads}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>{more}"
    )


def _counts_row(agent: str, counts: Counts) -> str:
    cells = []
    for outcome in OUTCOMES:
        kinds = {kind: n for (who, kind, what), n in counts.items() if (who, what) == (agent, outcome)}
        split = escaped(", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())), 200)
        total = sum(kinds.values())
        cells.append(f'<td class="{"some" if total else "zero"}" title="{split}">{total}</td>')
    return f"<tr><td>{escaped(agent) or 'unnamed'}</td>{''.join(cells)}</tr>"


def _cards(edits: Sequence[NotedEdit], start_s: float, in_map: Set[str]) -> str:
    return f'<ol class="edits">{"".join(_card(noted, start_s, in_map) for noted in edits)}</ol>'


def _card(noted: NotedEdit, start_s: float, in_map: Set[str]) -> str:
    edit = noted.edit
    before = {row.id: row for row in edit.before}
    ids = (edit.landmark_id, edit.other_id)
    pictures = "".join(picture(crop, i or 0, _label(before.get(i or 0))) for crop, i in zip(noted.crops, ids, strict=False))
    words = f"<p>{_sentence(edit, before, in_map)}</p><small>{_origin(noted, start_s)}</small>"
    return f'<li class="{escaped(edit.kind)}"><div class="pictures">{pictures}</div><div>{words}</div></li>'


def _sentence(edit: EditRecord, before: Mapping[int, Landmark], in_map: Set[str]) -> str:
    one = _link(edit.landmark_id, in_map)
    was = escaped(_label(before.get(edit.landmark_id))) or "unnamed"
    if edit.kind == "relabel":
        return f"<b>renamed</b> {one} {escaped(edit.detail, 260).replace(' -&gt; ', ' → ')}"
    if edit.kind == "merge" and edit.other_id is not None:
        other = escaped(_label(before.get(edit.other_id))) or "unnamed"
        return f"<b>merged</b> {one} {was} into {_link(edit.other_id, in_map)} {other}"
    return f"<b>removed</b> {one} {was}"


def _origin(noted: NotedEdit, start_s: float) -> str:
    edit = noted.edit
    parts = [f"edit {noted.number}", f"{edit.timestamp_s - start_s:.1f} s", escaped(edit.agent, 60) or "unnamed", escaped(edit.model, 60)]
    parts.append(f"prompt {escaped(edit.prompt_hash, 16)}" if edit.prompt_hash else "")
    age_s = edit.timestamp_s - edit.view_s
    parts.append(f"looked at keyframe {edit.view_keyframe_id}" + (f", {age_s:.1f} s before" if age_s >= 0.05 else ""))
    return " · ".join(part for part in parts if part)


def _lines(edits: Sequence[NotedEdit], start_s: float, in_map: Set[str]) -> str:
    rows = "".join(
        f'<tr><td class="num">{noted.number}</td><td class="num">{noted.edit.timestamp_s - start_s:.1f} s</td>'
        f"<td>{escaped(noted.edit.kind, 20)}</td><td>{_ids(noted.edit, in_map)}</td><td>{escaped(noted.edit.outcome, 20)}</td>"
        f"<td>{escaped(noted.edit.detail, 300)}</td><td>{escaped(noted.edit.agent, 60)}</td></tr>"
        for noted in edits
    )
    heads = '<th scope="col" class="num">edit</th><th scope="col" class="num">time</th>'
    heads += "".join(f'<th scope="col">{name}</th>' for name in ("kind", "landmark", "outcome", "what, or why", "agent"))
    return f'<div class="table-frame"><table class="events"><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>'


def _ids(edit: EditRecord, in_map: Set[str]) -> str:
    other = f" into {_link(edit.other_id, in_map)}" if edit.kind == "merge" and edit.other_id is not None else ""
    return _link(edit.landmark_id, in_map) + other


def _link(landmark_id: int, in_map: Set[str]) -> str:
    number = escaped(landmark_id, 20)
    return f'<a href="#landmark-{number}">#{number}</a>' if str(landmark_id) in in_map else f"#{number}"


def _label(row: Landmark | None) -> str:
    return row.label if row is not None else ""


def _pairs(asked: Mapping[str, Any]) -> str:
    agents = asked.get("agents")
    rows = [_asked_row(agent) for agent in agents if isinstance(agent, Mapping)] if isinstance(agents, Sequence) else []
    plain = [(name, value) for name, value in _flat(asked) if isinstance(value, int | float | str)]
    pairs = "".join(f"<div><dt>{escaped(name.replace('_', ' '))}</dt><dd>{escaped(value)}</dd></div>" for name, value in plain)
    return "".join(rows) + (f'<dl class="pairs">{pairs}</dl>' if pairs else "")


def _flat(figures: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Figures of figures under both names: "age s p50"."""
    out: list[tuple[str, Any]] = []
    for name, value in figures.items():
        out += [(f"{name} {inner}", figure) for inner, figure in value.items()] if isinstance(value, Mapping) else [(name, value)]
    return out


def _asked_row(agent: Mapping[str, Any]) -> str:
    name = " · ".join(escaped(agent[key]) for key in ("name", "role", "model") if agent.get(key))
    rest = {key: value for key, value in agent.items() if key not in ("name", "role", "model")}
    pairs = "".join(
        f"<div><dt>{escaped(str(key).replace('_', ' '))}</dt><dd>{escaped(value, 200)}</dd></div>" for key, value in rest.items()
    )
    return f'<h3>{name}</h3><dl class="pairs">{pairs}</dl>'
