"""Worlds by name."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from seo_slam.errors import ConfigError, DatasetError, MissingBackendError
from seo_slam.simulation import named, rendering
from seo_slam.simulation.inventories import inventory
from seo_slam.simulation.manifest import manifest_of
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.named import NAMES, known_name, simulate
from seo_slam.simulation.scene import Scene


@pytest.mark.parametrize("name", NAMES)
def test_names_in_any_case(name: str) -> None:
    assert known_name(name.upper()) == known_name(name.lower()) == name


def test_the_desk() -> None:
    desk = simulate("Desk", seed=4, level=0.2, frames=5, width=64, height=48)
    assert (desk.seed, desk.level, len(desk), desk.camera.width, desk.camera.height) == (4, 0.2, 5, 64, 48)


@pytest.mark.parametrize("changes", [True, False])
def test_a_room(changes: bool) -> None:
    room = simulate("sm1", seed=1, frames=4, width=64, height=48, changes=changes)
    labels = [thing.label for thing in room.scene.start.things]
    assert sorted(labels) == sorted(label for label, count in inventory("SM1").items() for _ in range(count))
    assert bool(room.scene.changes) == changes


def test_models_of_a_mesh_folder_are_named_with_their_licences(tmp_path: Path) -> None:
    model = {"file": "a.glb", "label": "cup", "kind": "volatile", "size": [1, 1, 1], "licence": "CC BY 4.0", "creator": "somebody"}
    (tmp_path / "manifest.json").write_text(json.dumps([{**model, "name": name} for name in ("cup_a", "cup_b")]))
    desk = simulate("desk", frames=2)
    things = (replace(desk.scene.start.things[0], model="cup_b"), *desk.scene.start.things[1:])
    desk.scene = Scene(replace(desk.scene.start, things=things))
    desk.meshes = MeshLibrary(tmp_path)
    manifest = manifest_of(desk)
    assert manifest["models"] == {"cup_b": {"licence": "CC BY 4.0", "creator": "somebody"}}
    assert manifest["things"][0]["model"] == "cup_b"
    assert str(tmp_path) not in json.dumps(manifest)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("SM7", {}, r"got 'SM7', wanted one of desk, SM1, .*house; did you mean"),
        ("garden", {}, "got 'garden', wanted one of"),
        ("SM1", {"level": -0.5}, "level: got -0.5"),
        ("house", {}, "house: got no mesh folder"),
        ("desk", {"meshes": Path()}, "desk: got a mesh folder"),
        ("desk", {"frames": 1}, "frames"),
        ("SM1", {"width": 8}, "image size"),
    ],
)
def test_what_cannot_be_is_refused(name: str, options: dict, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        simulate(name, **options)


def test_a_mesh_folder_without_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"manifest\.json"):
        simulate("SM1", meshes=tmp_path)


def test_the_house_needs_no_manifest(tmp_path: Path) -> None:
    (tmp_path / "scene.json").write_text("no list")
    with pytest.raises(DatasetError, match=r"scene\.json: not readable"):
        simulate("house", meshes=tmp_path)
    with pytest.raises(DatasetError, match="nowhere: no such folder"):
        simulate("house", meshes=tmp_path / "nowhere")


def test_meshes_without_the_extra_say_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "embree_is_installed", lambda: False)
    assert named.require_embree is rendering.require_embree
    with pytest.raises(MissingBackendError, match=r"pip install 'seo-slam\[sim\]'"):
        simulate("SM1", meshes=tmp_path)
