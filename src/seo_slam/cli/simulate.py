"""``seo-slam simulate``: write a recording of a simulated world, in which everything is known."""

import re
import shlex
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from seo_slam.cli.progress import with_progress
from seo_slam.errors import ConfigError

if TYPE_CHECKING:
    from seo_slam.simulation.simulated_recording import SimulatedRecording


def simulate(
    name: Annotated[str, typer.Argument(metavar="NAME", help="SM1, SM2, MD1, MD2, LG1, LG2 (rooms), apartment, house, or desk.")],
    out: Annotated[Path, typer.Option(help="New or empty folder to write the recording to.")],
    seed: Annotated[int, typer.Option(min=0, help="Other places, another walk, other mistakes.")] = 0,
    level: Annotated[float, typer.Option(help="How imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.")] = 0.5,
    meshes: Annotated[Path | None, typer.Option(help="Folder of models with manifests; without it, coloured primitives.")] = None,
    frames: Annotated[int | None, typer.Option(min=2, help="How many frames; default: as many as suit the world.")] = None,
    size: Annotated[str, typer.Option(metavar="WxH", help="Size of the images, pixels.")] = "320x240",
    changes: Annotated[bool, typer.Option("--changes/--no-changes", help="Whether things are taken away and moved meanwhile.")] = True,
    truth_cloud: Annotated[bool, typer.Option("--truth-cloud", help="Also write the true points, for `eval segmentation`.")] = False,
) -> None:
    """Write a simulated recording in TUM layout: noisy depth, drifting odometry, detections with masks, and the truth."""
    from seo_slam.simulation.named import known_name
    from seo_slam.simulation.named import simulate as make
    from seo_slam.simulation.writing import require_empty, write_recording

    width, height = image_size(size)
    require_empty(out)  # a large room takes a while to furnish
    recording = make(name, seed=seed, level=level, meshes=meshes, frames=frames, width=width, height=height, changes=changes)
    write_recording(recording, out, with_progress(recording, len(recording), "drawing"))
    if truth_cloud:
        _write_truth_cloud(recording, out)
    typer.echo(_summary(known_name(name), recording, out))


def _write_truth_cloud(recording: "SimulatedRecording", folder: Path) -> None:
    from seo_slam.simulation.labelled_cloud import labelled_cloud
    from seo_slam.simulation.truth_cloud import TRUTH_CLOUD_FILE, write_labelled_cloud

    write_labelled_cloud(folder / TRUTH_CLOUD_FILE, labelled_cloud(recording))


def image_size(text: str) -> tuple[int, int]:
    """Return width and height of "320x240".

    Raises:
        ConfigError: it is something else.
    """
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if found is None:
        raise ConfigError(f"--size: got {text!r}, wanted WIDTHxHEIGHT in pixels, for example 640x480")
    return int(found[1]), int(found[2])


def _summary(name: str, recording: "SimulatedRecording", folder: Path) -> str:
    events = Counter(change.event for change in recording.scene.changes)
    changed = ", ".join(f"{count} {event}" for event, count in sorted(events.items()))
    here, result = shlex.quote(str(folder)), shlex.quote(f"{folder}_map")
    truth = shlex.quote(str(folder / "truth.json"))
    lines = [
        f"{name}, seed {recording.seed}, level {recording.level:g}: {len(recording)} frames of "
        f"{recording.camera.width}x{recording.camera.height}, {len(recording.scene.end.things)} things at the end"
        + (f" ({changed} meanwhile)" if changed else ""),
        f"written to  {folder}",
        "",
        f"check       seo-slam check {here}",
        f"map         seo-slam run tum {here} --detector recorded --out {result}",
        f"score       seo-slam eval landmarks {result} {truth}",
    ]
    return "\n".join(lines)
