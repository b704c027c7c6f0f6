"""Which model each thing of a room has: a mesh of its label, or a stand-in made of primitive shapes."""

from dataclasses import dataclass, replace

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation import stand_in_furniture
from seo_slam.simulation.draws import generator
from seo_slam.simulation.inventories import SYNONYMS, inventory
from seo_slam.simulation.mesh_library import MeshLibrary, MeshModel
from seo_slam.simulation.stand_ins import STAND_IN_WORDS, STAND_INS
from seo_slam.simulation.world import Part, Thing, ThingKind

# Labels of a manifest that may stand for a label of the table.
_MANIFEST_LABELS: dict[str, tuple[str, ...]] = {"Cheez-It box": ("cheez-it box",), "cup": ("cup", "mug")}

# Part of a model's name -> words that are right for that very model.
_MODEL_WORDS: dict[str, tuple[str, ...]] = {
    "bag_backpack": ("backpack",),
    "bag_briefcase": ("briefcase",),
    "bag_handbag": ("handbag",),
    "bin_dustbin": ("dustbin",),
    "bin_recycling": ("recycling bin",),
    "bottle_beer": ("beer bottle",),
    "bottle_wine": ("wine bottle",),
    "chair_office": ("office chair",),
    "chair_swivel": ("office chair",),
    "cup_paper": ("paper cup",),
    "cup_plastic": ("plastic cup",),
    "flower_orchid": ("orchid", "plant"),
    "flower_tulips": ("tulips",),
    "helmet_moto": ("motorcycle helmet",),
    "monitor_imac": ("computer",),
    "monitor_tv": ("television",),
    "mug": ("mug",),
    "racquet_table_tennis": ("paddle",),
    "racquet_tennis": ("tennis racket",),
    "shoes_bootie": ("boot",),
    "shoes_mocassin": ("moccasin",),
    "shoes_slippers": ("slippers",),
    "shoes_sneakers": ("sneaker", "sneakers"),
    "soccer": ("soccer ball",),
}

_FACES_THE_CAMERA: dict[str, float] = {
    "monitor": 0.35,
    "electric outlet": 0.0,
    "chair": 0.9,
    "fan": 0.7,
    "snowman": 0.9,
    "Cheez-It box": 0.9,
}
_ON_THE_FLOOR = ("chair", "bin")
_TABLE_LABELS = ("table", "desk")
_TABLE_HEIGHT_M = (0.68, 0.8)
_TABLE_WIDTH_M = (1.15, 2.4)


@dataclass(frozen=True, eq=False)
class RoomModel:
    """What one thing looks like.

    Attributes:
        label: its name.
        name: of the mesh or the stand-in.
        parts: base at z = 0, middle at x = y = 0, front to -y.
        accepted_labels: other right words.
        kind: as ``Thing.kind``.
        turn_rad: how far it may turn either way from facing -y.
        on_floor: whether it stands on the floor rather than on a table.
    """

    label: str
    name: str
    parts: tuple[Part, ...]
    accepted_labels: tuple[str, ...] = ()
    kind: ThingKind = "volatile"
    turn_rad: float = float(np.pi)
    on_floor: bool = False

    def thing(self, thing_id: int, T_world_thing: FloatArray) -> Thing:
        """Return it as a thing at a place."""
        return Thing(thing_id, self.label, self.parts, T_world_thing, self.accepted_labels, self.kind, self.name)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (3,) of its box in its own frame."""
        return self.thing(1, np.eye(4)).bounds_thing


def choose_models(room: str, seed: int, library: MeshLibrary | None) -> tuple[RoomModel, ...]:
    """Return a model for each thing of a room, in the order of its inventory.

    Copies of one label are the same model half of the time, else different ones as far as there are some.

    Raises:
        ConfigError: no such room, or the library has no model of a label.
        DatasetError: a mesh does not load.
    """
    models = []
    for label, count in inventory(room).items():
        draws = generator(seed, room, "models", label)
        alike = bool(draws.random() < 0.5)
        if library is None:
            models += [_stand_in(label, (seed, room, label, 0 if alike else copy)) for copy in range(count)]
            continue
        known = [mesh for word in _MANIFEST_LABELS.get(label, (label,)) for mesh in library.with_label(word)]
        if not known:
            raise ConfigError(f"room {room}: got no mesh with the label {label!r} in {library.folder}, wanted at least one")
        order = draws.permutation(len(known))
        models += [_mesh(label, known[int(order[0 if alike else copy % len(order)])], library) for copy in range(count)]
    return tuple(models)


def choose_tables(count: int, area_m2: float, seed: int, room: str, library: MeshLibrary | None) -> tuple[RoomModel, ...]:
    """Return tables that together offer ``area_m2`` of table top, at least ``count`` of them.

    Raises:
        ConfigError: the library has no table.
        DatasetError: a mesh does not load.
    """
    draws = generator(seed, room, "tables")
    if library is None:
        tables: list[RoomModel] = []
        while len(tables) < count or _area_m2(tables) < area_m2:
            wide, deep, high = float(draws.uniform(1.4, 1.8)), float(draws.uniform(0.8, 0.95)), float(draws.uniform(0.7, 0.76))
            parts = stand_in_furniture.table((seed, room, "table", len(tables)), (wide, deep, high))
            tables.append(RoomModel("table", "table", parts, kind="anchor"))
        return tuple(tables)
    known = [mesh for label in _TABLE_LABELS for mesh in library.with_label(label) if _suits(mesh)]
    if not known:
        raise ConfigError(
            f"room {room}: got no table or desk {_TABLE_WIDTH_M[0]} to {_TABLE_WIDTH_M[1]} m wide in {library.folder}, wanted at least one"
        )
    for extra in range(20):
        for _ in range(20):
            picked = [known[int(k)] for k in draws.integers(len(known), size=count + extra)]
            if sum(mesh.size_m[0] * mesh.size_m[1] for mesh in picked) >= area_m2:
                return tuple(RoomModel(mesh.label, mesh.name, library.parts(mesh.name), kind="anchor") for mesh in picked)
    raise ConfigError(f"room {room}: the tables in {library.folder} are too small for {area_m2:.1f} m2 of things")


def _suits(mesh: MeshModel) -> bool:
    wide, deep, high = mesh.size_m
    return _TABLE_WIDTH_M[0] <= wide <= _TABLE_WIDTH_M[1] and deep >= 0.55 and _TABLE_HEIGHT_M[0] <= high <= _TABLE_HEIGHT_M[1]


def _area_m2(tables: list[RoomModel]) -> float:
    return float(sum(np.prod((table.bounds[1] - table.bounds[0])[:2]) for table in tables))


def _stand_in(label: str, key: tuple[int | str, ...]) -> RoomModel:
    return _model(label, f"stand-in {label}", STAND_INS[label](key), STAND_IN_WORDS.get(label, ()))


def _mesh(label: str, mesh: MeshModel, library: MeshLibrary) -> RoomModel:
    words = tuple(word for stem, words in _MODEL_WORDS.items() if stem in mesh.name for word in words)
    return _model(label, mesh.name, library.parts(mesh.name), words)


def _model(label: str, name: str, parts: tuple[Part, ...], words: tuple[str, ...]) -> RoomModel:
    kind: ThingKind = "fixed" if label == "electric outlet" else "volatile"
    turn_rad = _FACES_THE_CAMERA.get(label, float(np.pi))
    accepted = tuple(dict.fromkeys((*SYNONYMS.get(label, ()), *words)))
    return RoomModel(label, name, _stood(parts), accepted, kind, turn_rad, label in _ON_THE_FLOOR)


def _stood(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """Shift parts so that the base is at z = 0 and the middle at x = y = 0; the same parts if they are so already."""
    low, high = Thing(1, "", parts, np.eye(4)).bounds_thing
    shift = np.array([(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]])
    if np.abs(shift).max() < 1e-3:
        return parts
    T = np.eye(4)
    T[:3, 3] = -shift
    return tuple(replace(part, T_thing_part=T @ part.T_thing_part) for part in parts)
