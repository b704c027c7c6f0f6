"""Plans a room: models, tables, places, a walk from which everything is seen, and what changes halfway."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.casting import Caster, PrimitiveCaster
from seo_slam.simulation.draws import generator
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.placement import Surfaces, linked
from seo_slam.simulation.rendering import require_embree
from seo_slam.simulation.room_layout import APART_M, COPIES_M, Layout
from seo_slam.simulation.room_models import RoomModel, choose_models, choose_tables
from seo_slam.simulation.room_path import WALK_S, RoomWalk
from seo_slam.simulation.room_structure import RoomStructure, build_structure
from seo_slam.simulation.room_views import GOOD_SHARE, RoomViews
from seo_slam.simulation.scene import Event
from seo_slam.simulation.sightlines import Sightlines
from seo_slam.simulation.world import Thing, World

REMOVED, MOVED = 2, 3
"""How many things are taken away, and moved, halfway."""

_LAYOUTS = 12  # tries for a whole room
_SAME_TABLES, _LARGER = 2, 1.25  # so many layouts with tables of one area, then with a larger
_REPAIRS = 16  # rounds of new places for what is not seen, in one of them
_CHANGES = 12  # tries for the scene change
_VIEWS = 20  # in each half of the walk
_FILLED = 0.5  # share of the table tops that things may take
_FARTHER_M = (0.5, 0.5, 0.5, 0.3)  # how far a thing is moved at least, by try
_LARGEST_MOVED_M = 0.5
_TABLES = {"SM": 1, "MD": 2, "LG": 3}


@dataclass(frozen=True, eq=False)
class RoomPlan:
    """A planned room.

    Attributes:
        start: what there is at first.
        changes: what happens halfway, all at once.
        walk: the camera's path.
    """

    start: World
    changes: tuple[tuple[Event, Thing], ...]
    walk: RoomWalk


def plan_room(room: str, seed: int = 0, library: MeshLibrary | None = None, changes: bool = True) -> RoomPlan:
    """Plan a room; a function of its arguments alone. Without changes it is the same room, in which nothing changes.

    Raises:
        ConfigError: no such room, a label without a mesh, or a thing that found no place from which it is seen.
        DatasetError: a mesh does not load.
        MissingBackendError: meshes, and the extra ``sim`` is not installed.
    """
    models = choose_models(room, seed, library)
    needed_m2 = _needed_m2(models)
    trouble = ""
    for attempt in range(_LAYOUTS):
        if attempt % _SAME_TABLES == 0:  # in vain so far: larger tables
            tables = choose_tables(_TABLES[room[:2]], needed_m2 * _LARGER ** (attempt // _SAME_TABLES), seed, room, library)
        structure = build_structure(tables, seed, room, attempt)
        walk = RoomWalk(structure.row, seed, f"{room} {attempt}")
        layout = Layout(structure, Surfaces(structure.world, _caster(structure.world, library)), Sightlines(_views(walk)), models)
        views = RoomViews(_views(walk), library is not None)
        try:
            start = _furnished(layout, views, (seed, room, attempt))
            changed = _change(layout, start, views, (seed, room, attempt))
        except ConfigError as error:
            trouble = str(error)
            continue
        return RoomPlan(start, changed if changes else (), walk)
    raise ConfigError(f"room {room}, seed {seed}: {trouble}; gave up after {_LAYOUTS} layouts")


def _needed_m2(models: Sequence[RoomModel]) -> float:
    """The area of table tops that things need with room around them."""
    sizes = [(model.bounds[1] - model.bounds[0])[:2] + 2 * APART_M for model in models if not model.on_floor and model.kind == "volatile"]
    return float(sum(np.prod(size) for size in sizes)) / _FILLED


def _caster(world: World, library: MeshLibrary | None) -> Caster:
    """The exact caster unless there are meshes, also where Embree is installed: a layout shall not depend on that."""
    if library is None:
        return PrimitiveCaster(world)
    require_embree("a room of meshes")
    from seo_slam.simulation.embree import EmbreeCaster

    return EmbreeCaster(world)


def _furnished(layout: Layout, views: RoomViews, key: tuple[int | str, ...]) -> World:
    """Place everything, then place again what is not seen well in both halves of the walk."""
    layout.place_all(generator(*key, "places"))
    for repair in range(_REPAIRS):
        world = _with(layout.structure, layout.things.values())
        shares = views.well_seen(world, 0), views.well_seen(world, 1)
        hidden = [thing.label for thing in world.things if min(share[thing.id] for share in shares) < GOOD_SHARE]
        if not hidden:
            return world
        for label in dict.fromkeys(hidden):
            layout.place_again(label, generator(*key, "place again", label, repair))
    raise ConfigError(f"no place from which the {hidden[0]} is seen well")


def _change(layout: Layout, start: World, views: RoomViews, key: tuple[int | str, ...]) -> tuple[tuple[Event, Thing], ...]:
    """Choose what is taken away and what is moved, so that all that is left is seen well afterwards."""
    trouble = "no three things that can be moved"
    for attempt in range(_CHANGES):
        draws = generator(*key, "change", attempt)
        chosen = _chosen(start, draws)
        untouched = [thing for thing in start.things if thing not in chosen]
        if not _copies_stay_together(untouched):
            continue
        moved = _moved(layout, start, chosen[REMOVED:], draws)
        if moved is None:
            continue
        end = _with(layout.structure, (*untouched, *moved))
        shares = views.well_seen(end, 1)
        hidden = [thing.label for thing in end.things if shares[thing.id] < GOOD_SHARE]
        if not hidden:
            return (*(("removed", thing) for thing in chosen[:REMOVED]), *(("moved", thing) for thing in moved))
        trouble = f"after the change, no place from which the {hidden[0]} is seen well"
    raise ConfigError(trouble)


def _chosen(world: World, draws: np.random.Generator) -> list[Thing]:
    """Draw small things; the large and those on the floor stay."""

    def small(thing: Thing) -> bool:
        low, high = thing.bounds_world
        return bool(thing.kind == "volatile" and low[2] > 0.3 and (high - low).max() < _LARGEST_MOVED_M)

    movable = [thing for thing in world.things if small(thing)]
    order = draws.permutation(len(movable))[: REMOVED + MOVED]
    return [movable[int(k)] for k in order]


def _copies_stay_together(untouched: Sequence[Thing]) -> bool:
    labels = {thing.label for thing in untouched}
    return all(linked([thing for thing in untouched if thing.label == label], COPIES_M) for label in labels)


def _moved(layout: Layout, start: World, things: Sequence[Thing], draws: np.random.Generator) -> list[Thing] | None:
    """New places, clear of each other and of everything as it stood at first: nothing passes through anything."""
    moved: list[Thing] = []
    for thing in things:
        for least_m in _FARTHER_M:
            others = [*(other for other in start.things if other is not thing), *moved]
            elsewhere = layout.elsewhere(thing, others, draws, least_m)
            if elsewhere is not None:
                moved.append(elsewhere)
                break
        else:
            return None
    return moved


def _views(walk: RoomWalk) -> tuple[FloatArray, FloatArray]:
    """Poses (N, 4, 4) in the first and in the second half of a walk."""
    share = (np.arange(_VIEWS) + 0.5) / _VIEWS
    return walk.poses(0.5 * WALK_S * share), walk.poses(0.5 * WALK_S * (1.0 + share))


def _with(structure: RoomStructure, things: Iterable[Thing]) -> World:
    return replace(structure.world, things=tuple(sorted(things, key=lambda thing: thing.id)))
