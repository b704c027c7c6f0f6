"""``seo-slam query``: which things in a map does a text describe."""

import json
from pathlib import Path
from typing import Annotated

import typer

from seo_slam.map import Map, QueryHit
from seo_slam.map_document import landmark_fields


def query(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result, or its map.json or map.db.")],
    text: Annotated[str, typer.Argument(help="What to look for, in words.")],
    k: Annotated[int, typer.Option("-k", min=1, help="How many at most.")] = 5,
    as_json: Annotated[bool, typer.Option("--json", help="For a program: JSON with every field of each landmark.")] = False,
) -> None:
    """Find the things in MAP that TEXT describes best, best first; the score is a cosine, 1 is the best."""
    loaded = Map.load(map_path)
    hits = loaded.query(text, k)
    if as_json:
        found = [{"score": round(hit.score, 6), **landmark_fields(hit.landmark)} for hit in hits]
        answer = {"query": text, "embedder": loaded.embedder, "gravity": loaded.gravity, "hits": found}
        typer.echo(json.dumps(answer, ensure_ascii=False, indent=1))
    elif hits:
        typer.echo(_table(hits))
        if loaded.features is not None and loaded.features.has_pictures:
            typer.echo(f"Features are of {_printable(loaded.features.in_words)}: a thing's own word scores less than 1.")
    else:
        typer.echo("The map holds no stable landmark that has a label.")


def _table(hits: tuple[QueryHit, ...]) -> str:
    width = max(5, *(len(_printable(hit.landmark.label)) for hit in hits))
    lines = [f"score      id  {'label':<{width}}  position x, y, z (m)     size (m)          seen"]
    for hit in hits:
        row = hit.landmark
        position = " ".join(f"{x:7.2f}" for x in row.position_m)
        size = " ".join(f"{x:5.2f}" for x in row.size_m)
        label = _printable(row.label)
        lines.append(f"{hit.score:5.2f}  {row.id:6d}  {label:<{width}} {position}  {size}  {row.observations:4d} x")
    return "\n".join(lines)


def _printable(label: str) -> str:
    # A label comes from a detector or a language model: it must not steer the terminal.
    return "".join(c if c.isprintable() else "?" for c in label)
