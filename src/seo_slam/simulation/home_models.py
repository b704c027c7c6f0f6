"""What furniture and things in a home look like: meshes of a library, or primitives of like size; and the words that are right for them."""

from dataclasses import dataclass

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.draws import generator
from seo_slam.simulation.furniture import FURNITURE
from seo_slam.simulation.inventories import SYNONYMS
from seo_slam.simulation.mesh_library import MeshLibrary, MeshModel
from seo_slam.simulation.stand_ins import STAND_IN_WORDS, STAND_INS
from seo_slam.simulation.world import Part, Thing, ThingKind

FURNITURE_WORDS: dict[str, tuple[str, ...]] = {
    "bookcase": ("bookshelf",),
    "coffee table": ("low table",),
    "counter": ("kitchen counter",),
    "dresser": ("chest of drawers",),
    "nightstand": ("bedside table",),
    "refrigerator": ("fridge",),
    "shelf": ("shelves", "shelving unit"),
    "sofa": ("couch",),
    "table": ("dining table",),
    "tv stand": ("tv cabinet",),
    "wardrobe": ("closet",),
}
"""Words that are right for a piece of furniture beside its label."""

_LARGEST_M = (0.36, 0.36, 0.45)  # of a thing that is put on furniture
_NOT_CARRIED = ("bin", "chair", "electric outlet", "racquet")
_COPIES = 2  # so many of the things are a second one of a label


@dataclass(frozen=True, eq=False)
class Model:
    """What a thing looks like, before it has a place. Base at z = 0, middle at x = y = 0, front to -y."""

    label: str
    name: str
    parts: tuple[Part, ...]
    accepted_labels: tuple[str, ...]
    kind: ThingKind

    def thing(self, thing_id: int, T_world_thing: FloatArray) -> Thing:
        """Return it as a thing at a place."""
        return Thing(thing_id, self.label, self.parts, T_world_thing, self.accepted_labels, self.kind, self.name)


def furniture_model(label: str, key: tuple[int | str, ...], library: MeshLibrary | None) -> Model:
    """Return a piece of furniture.

    Raises:
        ConfigError: the library has none of that label.
        DatasetError: a mesh does not load.
    """
    words = FURNITURE_WORDS.get(label, ())
    if library is None:
        return Model(label, f"stand-in {label}", FURNITURE[label](key), words, "anchor")
    known = library.with_label(label)
    if not known:
        raise ConfigError(f"apartment: got no mesh with the label {label!r} in {library.folder}, wanted at least one")
    mesh = known[int(generator(*key, "mesh").integers(len(known)))]
    return Model(label, mesh.name, library.parts(mesh.name), words, "anchor")


def small_models(count: int, key: tuple[int | str, ...], library: MeshLibrary | None, prefix: str = "") -> tuple[Model, ...]:
    """Return things that people carry about: nearly all of different labels, with two copies.

    Args:
        count: how many.
        key: of the draws.
        library: meshes; None for primitives.
        prefix: only meshes whose name begins so.

    Raises:
        ConfigError: too few labels in the library.
        DatasetError: a mesh does not load.
    """
    draws = generator(*key, "things")
    meshes: dict[str, list[MeshModel]] = {}
    if library is not None:
        for mesh in library:
            if mesh.kind == "volatile" and mesh.name.startswith(prefix) and _is_small(mesh):
                meshes.setdefault(mesh.label, []).append(mesh)
    labels = sorted(meshes) if library is not None else sorted(set(STAND_INS) - set(_NOT_CARRIED))
    if len(labels) + _COPIES < count:
        where = "the stand-ins" if library is None else str(library.folder)
        raise ConfigError(f"things: got {len(labels)} labels of small things in {where}, wanted at least {count - _COPIES}")
    chosen = [labels[int(k)] for k in draws.permutation(len(labels))[: count - _COPIES]]
    chosen += [chosen[int(k)] for k in draws.permutation(len(chosen))[:_COPIES]]
    out = []
    for copy, label in enumerate(chosen):
        words = tuple(dict.fromkeys((*SYNONYMS.get(label, ()), *(() if library else STAND_IN_WORDS.get(label, ())))))
        if library is None:
            out.append(Model(label, f"stand-in {label}", STAND_INS[label]((*key, label, copy)), words, "volatile"))
        else:
            mesh = meshes[label][int(draws.integers(len(meshes[label])))]
            out.append(Model(label, mesh.name, library.parts(mesh.name), words, "volatile"))
    return tuple(out)


def _is_small(mesh: MeshModel) -> bool:
    return mesh.label not in _NOT_CARRIED and bool((np.array(mesh.size_m) <= _LARGEST_M).all())
