"""A seeded apartment: rooms, furniture in them, and small things on the furniture."""

from dataclasses import dataclass, field

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.simulation.draws import generator
from seo_slam.simulation.floor_plan import FloorPlan, build_structure, draw_floor_plan
from seo_slam.simulation.free_space import ROBOT_RADIUS_M, FreeSpace, free_space
from seo_slam.simulation.furnishing import MakeModel, furnish
from seo_slam.simulation.home_models import Model, furniture_model, small_models
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.resting import put_on_furniture
from seo_slam.simulation.world import Light, World

SIZE_M = (10.0, 8.0)
ROOMS = (3, 5)
FURNITURE = (20, 25)
THINGS = (14, 20)

_COUNTS = (ROOMS, FURNITURE, THINGS)
_LAYOUTS = 40
_LAYOUTS_A_SUITE = 5
_NAMES = ("living room", "bedroom", "kitchen", "study", "second bedroom")
_NEEDED: dict[str, tuple[str, ...]] = {
    "living room": ("sofa", "tv stand", "coffee table", "bookcase"),
    "bedroom": ("bed", "nightstand", "wardrobe", "dresser"),
    "kitchen": ("counter", "counter", "refrigerator", "table"),
    "study": ("desk", "bookcase", "shelf"),
    "second bedroom": ("bed", "nightstand", "dresser"),
}
_OPTIONAL: dict[str, tuple[str, ...]] = {
    "living room": ("table", "shelf", "sofa", "chair", "bookcase", "nightstand", "desk"),
    "bedroom": ("nightstand", "desk", "shelf", "bookcase", "chair", "coffee table"),
    "kitchen": ("chair", "chair", "shelf", "counter", "dresser", "table"),
    "study": ("desk", "coffee table", "chair", "dresser", "sofa", "shelf"),
    "second bedroom": ("desk", "bookcase", "shelf", "nightstand", "chair"),
}


@dataclass(frozen=True, eq=False)
class Home:
    """A home at rest.

    Attributes:
        plan: its rooms and doors; None where nobody drew it.
        world: everything in it.
        free: the free floor, found by rays.
    """

    plan: FloorPlan | None
    world: World
    free: FreeSpace


@dataclass(frozen=True, slots=True)
class _Known:
    """Where models come from, and those that were made."""

    library: MeshLibrary | None
    models: dict[tuple[int | str, ...], Model] = field(default_factory=dict)


def plan_apartment(seed: int = 0, library: MeshLibrary | None = None) -> Home:
    """Return the apartment of a seed; a function of its arguments alone.

    The free floor is one part for a robot of ``ROBOT_RADIUS_M``, and every small thing can be seen from a place to stand within 1 m.

    Raises:
        ConfigError: a label without a mesh, or something that found no place in any layout; the message names it.
        DatasetError: a mesh does not load.
        MissingBackendError: meshes, and the extra ``sim`` is not installed.
    """
    trouble = ""
    known = _Known(library)
    rooms, pieces, things = (int(generator(seed, "apartment", k).integers(low, high + 1)) for k, (low, high) in enumerate(_COUNTS))
    small = small_models(things, (seed, "apartment"), library)
    for layout in range(_LAYOUTS):
        draws = generator(seed, "apartment layout", layout)
        plan = draw_floor_plan(seed, layout, _NAMES[:rooms], SIZE_M)
        suite = layout // _LAYOUTS_A_SUITE  # furniture too large for its room is exchanged in the end
        needed = _makers(plan, _NEEDED, (seed, "needed", suite), known)
        optional = _makers(plan, _OPTIONAL, (seed, "optional", suite), known)
        try:
            anchors = furnish(plan, pieces, needed, optional, draws)
            world = World(tuple(anchors), build_structure(plan, seed), _light(), _middle(plan))
            free = free_space(world)
            if free.connected_share(ROBOT_RADIUS_M) < 1.0:
                raise ConfigError("apartment: the free floor is in more than one part")
            return Home(plan, put_on_furniture(world, free, small, draws), free)
        except ConfigError as error:
            trouble = str(error)
    raise ConfigError(f"{trouble}; seed {seed}, gave up after {_LAYOUTS} layouts")


def _makers(plan: FloorPlan, words: dict[str, tuple[str, ...]], key: tuple[int | str, ...], known: _Known) -> dict[str, list[MakeModel]]:
    """Room name -> what makes each of its pieces; one that was made for an earlier layout is taken again."""

    def maker(label: str, own: tuple[int | str, ...]) -> MakeModel:
        def make() -> Model:
            if own not in known.models:
                known.models[own] = furniture_model(label, own, known.library)
            return known.models[own]

        return make

    return {room.name: [maker(label, (*key, room.name, k)) for k, label in enumerate(words[room.name])] for room in plan.rooms}


def _light() -> Light:
    direction = np.array([-0.35, -0.5, 1.0])
    return Light(direction / np.linalg.norm(direction), ambient=0.6)


def _middle(plan: FloorPlan) -> np.ndarray:
    corners = np.array([(*room.x, *room.y) for room in plan.rooms])
    return np.array([(corners[:, 0].min() + corners[:, 1].max()) / 2, (corners[:, 2].min() + corners[:, 3].max()) / 2, 0.8])
