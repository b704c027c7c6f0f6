"""What a simulated recording was made from, in the form of ``simulation.json``: enough to make it again, and whose models it shows."""

import dataclasses
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import cv2

from seo_slam.simulation.simulated_recording import SimulatedRecording
from seo_slam.simulation.world import STRUCTURE_ID, Thing

MANIFEST_SCHEMA = "seo_slam.simulation/1"
_PACKAGES = ("seo-slam", "numpy", "scipy", "trimesh", "embreex")


def manifest_of(recording: SimulatedRecording) -> dict[str, Any]:
    """Return the content of ``simulation.json``: no paths and no dates, so that the same arguments give the same bytes."""
    things = {thing.id: thing for world in reversed(recording.scene.worlds) for thing in world.things}
    structure = {thing.model or thing.label: thing for world in recording.scene.worlds for thing in world.structure}
    shown = [*(things[thing_id] for thing_id in sorted(things)), *structure.values()]
    return {
        "schema": MANIFEST_SCHEMA,
        "name": recording.name,
        "seed": recording.seed,
        "level": recording.level,
        "frames": len(recording),
        "width": recording.camera.width,
        "height": recording.camera.height,
        "renderer": recording.renderer.name,
        "sensor": dataclasses.asdict(recording.sensor_knobs),
        "detector": dataclasses.asdict(recording.detector_knobs),
        "look_alikes": {label: list(others) for label, others in recording.look_alikes.items()},
        "things": [_described(things[thing_id]) for thing_id in sorted(things)],
        "structure": [_described(thing) for thing in structure.values()],
        "models": _models(recording, shown),
        "packages": _versions(),
    }


def _described(thing: Thing) -> dict[str, Any]:
    row: dict[str, Any] = {"label": thing.label}
    if thing.id != STRUCTURE_ID:
        row = {"id": thing.id, **row, "kind": thing.kind}
    return {**row, "model": thing.model} if thing.model else row


def _models(recording: SimulatedRecording, shown: list[Thing]) -> dict[str, dict[str, str]]:
    """Model name -> licence and creator, of the models of the mesh folder that are shown."""
    if recording.meshes is None:
        return {}
    models = [recording.meshes[name] for name in sorted({thing.model for thing in shown}) if name in recording.meshes]
    return {model.name: {"licence": model.licence, "creator": model.creator} for model in models}


def _versions() -> dict[str, str]:
    found = {"opencv": str(cv2.__version__)}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return dict(sorted(found.items()))
