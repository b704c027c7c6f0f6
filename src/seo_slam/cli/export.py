"""``seo-slam export``: a map for other programs."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from seo_slam.map import Map
from seo_slam.map_document import write_atomically
from seo_slam.map_export import to_csv, to_ply


class Format(StrEnum):
    """What ``--format`` takes."""

    JSON = "json"
    CSV = "csv"
    PLY = "ply"


def export(
    map_path: Annotated[Path, typer.Argument(metavar="MAP", help="Folder of a result, or its map.json or map.db.")],
    to: Annotated[Format, typer.Option("--format", help="json: map.json. csv: a line a landmark. ply: a coloured box a landmark.")],
    out: Annotated[Path | None, typer.Option("--out", help="File to write; without it, standard output.")] = None,
    tentative: Annotated[
        bool, typer.Option("--tentative", help="In csv and ply, also landmarks that are not stable yet; json always has them.")
    ] = False,
) -> None:
    """Write MAP in another format."""
    loaded = Map.load(map_path)
    data = _exported(loaded, to, tentative)
    if out is None:
        typer.echo(data, nl=False)
    else:
        write_atomically(out, data)


def _exported(loaded: Map, to: Format, tentative: bool) -> bytes:
    if to is Format.CSV:
        return to_csv(loaded, tentative).encode()
    if to is Format.PLY:
        return to_ply(loaded, tentative).encode()
    return loaded.to_json()
