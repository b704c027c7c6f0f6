"""Folders of GLB meshes with a manifest: which models there are, and the parts of each, read when first asked for."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from seo_slam.errors import DatasetError
from seo_slam.simulation.meshes import load_glb
from seo_slam.simulation.world import Part, ThingKind

MANIFEST = "manifest.json"
"""A JSON list of models: name, file, label, kind, size (width x, depth y, height z in metres), faces, licence and creator."""


@dataclass(frozen=True, slots=True)
class MeshModel:
    """One model of a library.

    Attributes:
        name: unique in the library.
        path: its GLB file.
        label: what it is, in words.
        kind: volatile, anchor or fixed.
        size_m: width (x), depth (y) and height (z).
        faces: number of triangles.
        licence, creator: whose it is; empty where the manifest does not say.
    """

    name: str
    path: Path
    label: str
    kind: ThingKind
    size_m: tuple[float, float, float]
    faces: int
    licence: str = ""
    creator: str = ""


class MeshLibrary:
    """All models of a folder and of the folders right under it."""

    def __init__(self, folder: Path | str) -> None:
        """Read the manifests; meshes are read later.

        Raises:
            DatasetError: no such folder, no manifest in it, a manifest that is malformed or names a model twice.
        """
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise DatasetError(f"{self.folder}: no such folder of meshes")
        manifests = sorted([*self.folder.glob(MANIFEST), *self.folder.glob(f"*/{MANIFEST}")])
        if not manifests:
            raise DatasetError(f"{self.folder}: got no {MANIFEST} in it or in a folder right under it; wanted meshes with one")
        self._models: dict[str, MeshModel] = {}
        self._parts: dict[str, tuple[Part, ...]] = {}
        for manifest in manifests:
            for model in _read(manifest):
                if model.name in self._models:
                    raise DatasetError(f"{manifest}: got the name {model.name!r} twice, also in {self._models[model.name].path.parent}")
                self._models[model.name] = model

    def __iter__(self) -> Iterator[MeshModel]:
        return iter(self._models.values())

    def __len__(self) -> int:
        return len(self._models)

    def __contains__(self, name: object) -> bool:
        return name in self._models

    def __getitem__(self, name: str) -> MeshModel:
        """Return a model by name.

        Raises:
            DatasetError: there is none.
        """
        try:
            return self._models[name]
        except KeyError:
            raise DatasetError(f"{self.folder}: got no model {name!r} in {len(self)} models") from None

    @property
    def labels(self) -> tuple[str, ...]:
        """All labels, sorted."""
        return tuple(sorted({model.label for model in self}))

    def with_label(self, label: str) -> tuple[MeshModel, ...]:
        """Return the models with a label, by name; none if there are none."""
        return tuple(sorted((model for model in self if model.label == label), key=lambda model: model.name))

    def parts(self, name: str) -> tuple[Part, ...]:
        """Return the parts of a model, base at z = 0 and middle at x = y = 0; the same objects every time.

        Raises:
            DatasetError: no such model, or its file is missing or damaged.
        """
        if name not in self._parts:
            self._parts[name] = load_glb(self[name].path)
        return self._parts[name]


def _read(manifest: Path) -> list[MeshModel]:
    try:
        rows = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DatasetError(f"{manifest}: not readable as JSON ({error})") from error
    if not isinstance(rows, list):
        raise DatasetError(f"{manifest}: got {type(rows).__name__}, wanted a list of models")
    return [_model(manifest, index, row) for index, row in enumerate(rows)]


def _model(manifest: Path, index: int, row: Any) -> MeshModel:
    where = f"{manifest}: model {index}"
    if not isinstance(row, dict):
        raise DatasetError(f"{where}: got {type(row).__name__}, wanted an object")
    if isinstance(row.get("name"), str):
        where += f" ({row['name']})"
    texts = {key: _text(where, row, key) for key in ("name", "file", "label", "kind")}
    if texts["kind"] not in get_args(ThingKind):
        raise DatasetError(f"{where}: kind: got {texts['kind']!r}, wanted one of {', '.join(get_args(ThingKind))}")
    faces = row.get("faces", 0)
    if not isinstance(faces, int) or isinstance(faces, bool) or faces < 0:
        raise DatasetError(f"{where}: faces: got {faces!r}, wanted a whole number")
    return MeshModel(
        name=texts["name"],
        path=manifest.parent / texts["file"],
        label=texts["label"],
        kind=row["kind"],
        size_m=_size(where, row.get("size")),
        faces=faces,
        licence=_text(where, row, "licence", needed=False),
        creator=_text(where, row, "creator", needed=False),
    )


def _text(where: str, row: dict[str, Any], key: str, needed: bool = True) -> str:
    value = row.get(key, None if needed else "")
    if not isinstance(value, str) or (needed and not value):
        raise DatasetError(f"{where}: {key}: got {value!r}, wanted words")
    return value


def _size(where: str, value: Any) -> tuple[float, float, float]:
    numbers = isinstance(value, list) and len(value) == 3 and all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    if not numbers or not np.isfinite(value).all() or min(value) <= 0:
        raise DatasetError(f"{where}: size: got {value!r}, wanted [x, y, z] in metres above 0")
    return float(value[0]), float(value[1]), float(value[2])
