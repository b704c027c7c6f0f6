"""``seo-slam check``: what is this recording, and is it sane."""

from pathlib import Path
from typing import Annotated

import typer

from seo_slam.cli.progress import with_progress


def check(
    path: Annotated[Path, typer.Argument(help="folder of the recording")],
    kind: Annotated[str, typer.Option(help="layout: auto, tum or folder")] = "auto",
    camera: Annotated[Path | None, typer.Option(help="camera.json elsewhere than in the folder")] = None,
    trajectory: Annotated[Path | None, typer.Option(help="poses (TUM format) elsewhere than in the folder")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="one JSON object instead of a list")] = False,
) -> None:
    """Say what a recording is, whether it is sane, and what to fix. Exit status 1 if a run would fail or map wrongly."""
    from seo_slam.datasets.checks import RecordingCheck

    checking = RecordingCheck(path, kind, camera, trajectory)
    for stage in with_progress(checking.stages, len(checking.stages), "checking"):
        stage()
    report = checking.report()
    if as_json:
        typer.echo(report.model_dump_json(indent=2))
    else:
        typer.echo(f"{report.path}: {report.kind} recording" if report.kind != "unknown" else f"{report.path}: not a recording")
        for finding in report.findings:
            typer.echo(f"  {finding.level:<8}{finding.topic:<10} {finding.what}")
            if finding.fix:
                typer.echo(f"          {'':<10} -> {finding.fix}")
        counts = {level: sum(finding.level == level for finding in report.findings) for level in ("error", "warning")}
        typer.echo("sane" if report.level == "ok" else f"{counts['error']} errors, {counts['warning']} warnings")
    raise typer.Exit(1 if report.level == "error" else 0)
