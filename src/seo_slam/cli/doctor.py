"""``seo-slam doctor``: what is installed, and what each extra would add."""

import json
from typing import Annotated

import typer

from seo_slam.config import describe_settings
from seo_slam.diagnosis import Diagnosis, diagnose


def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    settings: Annotated[bool, typer.Option("--settings", help="List every setting with its default instead.")] = False,
) -> None:
    """What is installed here, and what each extra would add."""
    if settings:
        rows = [{"key": key, "default": json.loads(default), "description": text} for key, default, text in describe_settings()]
        plain = [f"{row['key']:<32}{json.dumps(row['default']):<42}{row['description']}" for row in rows]
        typer.echo(json.dumps(rows, indent=1) if as_json else "\n".join(plain))
        return
    found = diagnose()
    typer.echo(json.dumps(found.as_dict(), indent=1) if as_json else "\n".join(_lines(found)))


def _lines(found: Diagnosis) -> list[str]:
    tree = "with" if found.sqlite_rtree else "without"
    lines = [
        f"seo_slam  {found.seo_slam}",
        f"python    {found.python}",
        f"platform  {found.platform}, {found.cores} cores",
        f"sqlite    {found.sqlite}, {tree} R*Tree",
        f"embedder  'auto' takes {found.embedder}",
        "",
        "required packages",
    ]
    lines += [f"  {package.name:<32}{package.version or 'not installed'}" for package in found.packages]
    lines += ["", "extras"]
    for extra in found.extras:
        state = "installed" if extra.installed else f"not installed; to add it: {extra.install}"
        lines.append(f"  {extra.name:<8}{extra.adds}: {state}")
    lines += ["", "plug-ins"]
    lines += [f"  {kind:<18}{', '.join(names) or 'none'}" for kind, names in found.plug_ins.items()]
    lines += ["", *(f"problem: {problem}" for problem in found.problems)] if found.problems else ["", "no problems"]
    return lines
