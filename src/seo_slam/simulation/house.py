"""A furnished house whose places are given in a file: the AWS RoboMaker small house, as a recording."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from seo_slam.errors import ConfigError, DatasetError, FrameError
from seo_slam.geometry import FloatArray, require_transform
from seo_slam.simulation.detector_knobs import DetectorKnobs
from seo_slam.simulation.draws import generator
from seo_slam.simulation.free_space import FreeSpace, free_space
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.home_models import FURNITURE_WORDS, small_models
from seo_slam.simulation.mesh_library import MANIFEST, MeshLibrary
from seo_slam.simulation.meshes import load_glb
from seo_slam.simulation.rendering import RendererName, require_embree
from seo_slam.simulation.resting import put_on_furniture
from seo_slam.simulation.scene import SceneChange
from seo_slam.simulation.sensors import SensorKnobs, require_level
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.world import STRUCTURE_ID, Light, Part, Thing, ThingKind, World

SCENE_FILE = "scene.json"
"""A JSON list of {"name", "file", "R": 3x3, "t": metres}: ``p_world = R @ p + t`` for points p of a GLB turned to z up."""

THINGS = (14, 20)
_YCB = "ycb_"

# Beginning of a name -> label, kind, other right words. What is not here is part of the building, under its own name.
_KINDS: dict[str, tuple[str, ThingKind, tuple[str, ...]]] = {
    "BalconyTable": ("coffee table", "anchor", ("side table", "table")),
    "Bed": ("bed", "anchor", ()),
    "Board": ("wall shelf", "anchor", ("shelf",)),
    "Chair": ("chair", "anchor", ()),
    "CoffeeTable": ("coffee table", "anchor", ("table",)),
    "CookingBench": ("stove", "anchor", ("cooktop",)),
    "Dumbbell": ("dumbbell rack", "anchor", ("dumbbells",)),
    "FitnessEquipment": ("exercise bench", "anchor", ("fitness equipment",)),
    "KitchenCabinet": ("kitchen cabinet", "anchor", ("counter", "kitchen counter", "cabinet")),
    "KitchenTable": ("table", "anchor", ("dining table", "kitchen table")),
    "NightStand": ("nightstand", "anchor", ()),
    "ReadingDesk": ("desk", "anchor", ("reading desk",)),
    "Refrigerator": ("refrigerator", "anchor", ()),
    "ShoeRack": ("shoe rack", "anchor", ("shelf",)),
    "Sofa": ("sofa", "anchor", ()),
    "TVCabinet": ("tv stand", "anchor", ()),
    "Wardrobe": ("wardrobe", "anchor", ()),
    "AirconditionerB": ("air conditioner", "fixed", ()),
    "SeasoningBox": ("spice rack", "fixed", ("seasoning box",)),
    "TV_": ("television", "fixed", ("tv", "screen")),
    "Tableware": ("tableware", "volatile", ("dishes",)),
    "Trash": ("bin", "volatile", ("trash can", "waste bin")),
    "Vase": ("vase", "volatile", ()),
}
_FLOORS = ("Floor", "Carpet")


@dataclass(frozen=True, slots=True)
class _Placed:
    """One row of the scene file."""

    name: str
    path: Path
    T_world_model: FloatArray


def furnished_house(meshes: str | Path) -> World:
    """Return the house as its file has it.

    Args:
        meshes: a folder with ``scene.json`` and its models, or one right above it.

    Raises:
        DatasetError: no such file there, one that is malformed, or a model that does not load.
        MissingBackendError: the extra ``sim`` is not installed.
    """
    require_embree("the house")
    scene = _scene_file(Path(meshes))
    loaded: dict[Path, tuple[Part, ...]] = {}
    things: list[Thing] = []
    structure: list[Thing] = []
    for placed in _rows(scene):
        if placed.path not in loaded:
            loaded[placed.path] = load_glb(placed.path)
        known = next((kind for start, kind in _KINDS.items() if placed.name.startswith(start)), None)
        if known is None:
            label = "floor" if placed.name.startswith(_FLOORS) else _words(placed.name)
            structure.append(_thing(STRUCTURE_ID, label, "fixed", (), placed, loaded[placed.path]))
        else:
            label, kind, words = known
            accepted = tuple(dict.fromkeys((*words, *FURNITURE_WORDS.get(label, ()))))
            things.append(_thing(len(things) + 1, label, kind, accepted, placed, loaded[placed.path]))
    direction = np.array([-0.35, -0.5, 1.0])
    return World(tuple(things), tuple(structure), Light(direction / np.linalg.norm(direction), ambient=0.6), np.array([0.0, 0.0, 0.8]))


def plan_house(meshes: str | Path, seed: int = 0) -> tuple[World, FreeSpace]:
    """Return the house with 14 to 20 small things at rest on its furniture, and its free floor.

    The things are YCB objects of the mesh library, or primitives where the folder has no manifest.

    Raises:
        ConfigError: a thing found no place; the message names it.
        DatasetError: see ``furnished_house``.
        MissingBackendError: the extra ``sim`` is not installed.
    """
    house = furnished_house(meshes)
    free = free_space(house)
    library = small_library(meshes)
    low, high = THINGS
    draws = generator(seed, "house")
    count = int(draws.integers(low, high + 1))
    return put_on_furniture(house, free, small_models(count, (seed, "house"), library, _YCB), draws), free


def small_library(meshes: str | Path) -> MeshLibrary | None:
    """Return the library of a mesh folder; None if it has no manifest."""
    folder = Path(meshes)
    return MeshLibrary(folder) if any([*folder.glob(MANIFEST), *folder.glob(f"*/{MANIFEST}")]) else None


def _scene_file(folder: Path) -> Path:
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder of meshes")
    found = sorted([*folder.glob(SCENE_FILE), *folder.glob(f"*/{SCENE_FILE}")])
    if not found:
        raise DatasetError(f"{folder}: got no {SCENE_FILE} in it or in a folder right under it; wanted the furnished house")
    return found[0]


def _rows(scene: Path) -> list[_Placed]:
    try:
        rows = json.loads(scene.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DatasetError(f"{scene}: not readable as JSON ({error})") from error
    if not isinstance(rows, list) or not rows:
        raise DatasetError(f"{scene}: got {type(rows).__name__}, wanted a list of placed models")
    return [_row(scene, index, row) for index, row in enumerate(rows)]


def _row(scene: Path, index: int, row: Any) -> _Placed:
    where = f"{scene}: row {index}"
    if not isinstance(row, dict) or not all(isinstance(row.get(key), str) and row[key] for key in ("name", "file")):
        raise DatasetError(f"{where}: got {row!r}, wanted an object with name, file, R and t")
    T = np.eye(4)
    try:
        T[:3, :3], T[:3, 3] = np.array(row["R"], dtype=np.float64), np.array(row["t"], dtype=np.float64)
        T[:3, :3] = _nearest_rotation(T[:3, :3])
        require_transform(T, f"{where} ({row['name']})")
    except (KeyError, TypeError, ValueError, FrameError, np.linalg.LinAlgError) as error:
        raise DatasetError(f"{where} ({row['name']}): R, t: {error}") from error
    return _Placed(row["name"], scene.parent / row["file"], T)


def _nearest_rotation(R: FloatArray) -> FloatArray:
    """The rotation nearest to a matrix that was written with few digits; the matrix itself if it is none."""
    u, s, vt = np.linalg.svd(R)
    return np.asarray(u @ vt) if np.abs(s - 1.0).max() < 1e-2 else R


def _thing(thing_id: int, label: str, kind: ThingKind, words: tuple[str, ...], placed: _Placed, parts: tuple[Part, ...]) -> Thing:
    """A thing in its place, its own frame with the base at z = 0 and the middle at x = y = 0."""
    low, high = Thing(thing_id, label, parts, np.eye(4)).bounds_thing
    shift = np.eye(4)
    shift[:3, 3] = (low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0, low[2]
    back = np.eye(4)
    back[:3, 3] = -shift[:3, 3]
    stood = tuple(replace(part, T_thing_part=back @ part.T_thing_part) for part in parts)
    return Thing(thing_id, label, stood, placed.T_world_model @ shift, words, kind, placed.path.stem)


def _words(name: str) -> str:
    """The words in a name: ``FoldingDoor_01_001`` is a folding door."""
    stem = name.split("_")[0]
    return "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in stem).strip()


class SimulatedHouse(SimulatedHome):
    """A tour of the furnished house with 14 to 20 small things on its furniture."""

    def __init__(
        self,
        seed: int = 0,
        level: float = 0.5,
        meshes: str | Path | None = None,
        frames: int | None = None,
        width: int = 320,
        height: int = 240,
        *,
        changes: bool | Sequence[SceneChange] = True,
        sensor_knobs: SensorKnobs | None = None,
        detector_knobs: DetectorKnobs | None = None,
        renderer: RendererName = "auto",
        cache: str | Path | None = None,
    ) -> None:
        """Read the house, put things on its furniture and plan the tour; nothing is drawn yet.

        Args:
            seed: of the small things, the tour and the noise; house and furniture are always the same.
            level: how imperfect depth, odometry and detector are: 0 perfect, 1 a poor day.
            meshes: the folder with ``scene.json``, or the one above it; it is needed.
            frames: how many, evenly over the tour; None: six a second.
            width: of the images, pixels.
            height: of the images, pixels.
            changes: see ``SimulatedApartment``.
            sensor_knobs: instead of those of the level.
            detector_knobs: instead of those of the level.
            renderer: "embree" or "auto".
            cache: a folder that keeps drawn frames.

        Raises:
            ConfigError: no folder, fewer than two frames, an image below 32 pixels, a level below 0, or a thing that found no place.
            DatasetError: no ``scene.json`` there, one that is malformed, or a model that does not load.
            MissingBackendError: the extra ``sim`` is not installed.
        """
        if meshes is None:
            raise ConfigError("house: got no mesh folder; wanted one with the models and scene.json of the house")
        require_level(level)
        simulated_camera(width, height)
        world, free = plan_house(meshes, seed)
        super().__init__(
            f"house seed {seed}",
            world,
            free,
            changes=changes,
            frames=frames,
            width=width,
            height=height,
            seed=seed,
            level=level,
            sensor_knobs=sensor_knobs,
            detector_knobs=detector_knobs,
            renderer=renderer,
            cache=cache,
            meshes=small_library(meshes),
        )
