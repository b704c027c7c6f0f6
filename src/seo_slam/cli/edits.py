"""``seo-slam edits``: what agents changed in a map, and taking one edit back."""

import json
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from seo_slam.errors import ConfigError
from seo_slam.map_document import landmark_fields
from seo_slam.records import EditOutcome, EditRecord
from seo_slam.undo import read_edits, touched_by, undo_edit, undone_by

_NUMBERS = (0, 1, 8)  # columns of the table that are set to the right
_LONGEST = {"agent": 24, "model": 24, "prompt": 12, "text": 100}


def edits(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result, or its map.json or map.db.")],
    undo: Annotated[int | None, typer.Option("--undo", metavar="N", help="Take back edit N, in map.db and map.json.")] = None,
    agent: Annotated[str | None, typer.Option("--agent", help="Only edits of this agent.")] = None,
    landmark: Annotated[int | None, typer.Option("--landmark", help="Only edits of this landmark.")] = None,
    outcome: Annotated[str | None, typer.Option("--outcome", help="Only these: applied, noted, stale or refused.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For a program: JSON with every field, and the landmarks as they were.")] = False,
) -> None:
    """List what agents proposed for MAP and what became of it; or take one edit back."""
    if undo is not None:
        if agent is not None or landmark is not None or outcome is not None:
            raise ConfigError("--undo takes no --agent, --landmark or --outcome: the number says which edit")
        record = undo_edit(map_path, undo)
        number = len(read_edits(map_path))
        said = f"Undone: {_printable(record.detail, 400)}. This is edit {number}.{_about_report(map_path)}"
        typer.echo(_json([(number, record)], {}) if as_json else said)
        return
    if outcome not in (None, *get_args(EditOutcome)):
        raise ConfigError(f"--outcome: got {outcome!r}, wanted applied, noted, stale or refused")
    every = read_edits(map_path)
    chosen = [
        (number, edit)
        for number, edit in enumerate(every, start=1)
        if (agent is None or edit.agent == agent)
        and (landmark is None or landmark in touched_by(edit))
        and (outcome is None or edit.outcome == outcome)
    ]
    undone = undone_by(every)
    if as_json:
        typer.echo(_json(chosen, undone))
    elif chosen:
        typer.echo(_table(chosen, undone))
    else:
        typer.echo("No edits." if not every else f"None of the {len(every)} edits is like that.")


def _about_report(map_path: Path) -> str:
    folder = map_path if map_path.is_dir() else map_path.parent
    return " report.html is as the run left it, and still shows the map before the undo." if (folder / "report.html").is_file() else ""


def _json(chosen: list[tuple[int, EditRecord]], undone: dict[int, int]) -> str:
    # In ASCII: what a model said shall not steer the terminal that this may end in.
    return json.dumps({"edits": [_fields(number, edit, undone.get(number)) for number, edit in chosen]}, indent=1)


def _fields(number: int, edit: EditRecord, undone: int | None) -> dict[str, Any]:
    return {
        "number": number,
        "kind": edit.kind,
        "landmark_id": edit.landmark_id,
        "other_id": edit.other_id,
        "outcome": edit.outcome,
        "undone_by": undone,
        "detail": edit.detail,
        "agent": edit.agent,
        "model": edit.model,
        "prompt_hash": edit.prompt_hash,
        "view_keyframe_id": edit.view_keyframe_id,
        "view_s": edit.view_s,
        "keyframe_id": edit.keyframe_id,
        "timestamp_s": edit.timestamp_s,
        "before": [landmark_fields(row) for row in edit.before],
    }


def _table(chosen: list[tuple[int, EditRecord]], undone: dict[int, int]) -> str:
    head = ("edit", "time (s)", "kind", "landmark", "outcome", "agent", "model", "prompt", "view", "what or why")
    rows = [head, *(_row(number, edit, undone.get(number)) for number, edit in chosen)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(head) - 1)]
    lines = []
    for row in rows:
        cells = [cell.rjust(widths[n]) if n in _NUMBERS else cell.ljust(widths[n]) for n, cell in enumerate(row[:-1])]
        lines.append("  ".join([*cells, row[-1]]).rstrip())
    return "\n".join(lines)


def _row(number: int, edit: EditRecord, undone: int | None) -> tuple[str, ...]:
    merged = f" -> {edit.other_id}" if edit.kind == "merge" and edit.other_id is not None else ""
    return (
        str(number),
        f"{edit.timestamp_s:.2f}",
        _printable(edit.kind, 10),
        f"{edit.landmark_id}{merged}",
        f"undone by {undone}" if undone is not None else edit.outcome,
        _printable(edit.agent, _LONGEST["agent"]),
        _printable(edit.model, _LONGEST["model"]) or "-",
        _printable(edit.prompt_hash, _LONGEST["prompt"]) or "-",
        str(edit.view_keyframe_id),
        _printable(edit.detail, _LONGEST["text"]),
    )


def _printable(text: str, most: int) -> str:
    # An edit's words come from detectors and language models: they must not steer the terminal, nor fill it.
    safe = "".join(c if c.isprintable() else "?" for c in text[: most + 1])
    return safe if len(text) <= most else safe[: most - 1] + "…"
