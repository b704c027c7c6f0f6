"""An errand: a trial for words of one's own."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from seo_slam.abstraction.abstract_map import Room
from seo_slam.driving.trials import Trial, TrialKind, bearing, drawn_start, starts
from seo_slam.navigation.query import parsed
from seo_slam.simulation.draws import generator
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.relocation import Relocation, relocated
from seo_slam.simulation.resting import anchors_of
from seo_slam.simulation.scene import SceneChange
from seo_slam.simulation.world import Thing, World

_MOVED = 2
"""So many things are moved where the words name nothing that can be."""


def errand(home: SimulatedHome, text: str, moved: Relocation | None = None, seed: int = 0, rooms: Sequence[Room] = ()) -> Trial:
    """Return a trial for a text; nothing is meant by it if nothing in the home has that word.

    Args:
        home: where.
        text: such as "the cup".
        moved: None: all is as it was mapped. Else the thing that is asked for is elsewhere, if it is one that people carry about and
            stands on furniture; if not, two other things are.
        seed: of the start and of what is moved to where.
        rooms: of the map; their names are no part of a thing's name.

    Raises:
        ConfigError: the thing finds no other place.
    """
    words = parsed(text, rooms).words
    named = bearing(home.world, words) if words else []
    changes = _changes(home, named, moved, seed) if moved else []
    kind: TrialKind = moved or "static"
    poses = tuple((change.thing.id, tuple(change.thing.T_world_thing.ravel().tolist())) for change in changes)
    trial = Trial(kind, seed, text, tuple(sorted(thing.id for thing in named)), (0.0, 0.0), 0.0, poses)
    world = trial.world(home.world)
    draws = generator(seed, "errand", home.name, text)
    x, y = drawn_start(starts(home), [world.thing(i) for i in trial.target_ids], draws)
    return replace(trial, start_xy=(float(x), float(y)), start_yaw_rad=float(draws.uniform(-np.pi, np.pi)))


def moves_in_words(home: World, trial: Trial) -> list[str]:
    """Return what was moved, for people: "cup: from the shelf 20 to the table 9"."""
    before, after = anchors_of(home), anchors_of(trial.world(home))
    lines = []
    for thing_id, _ in trial.moved:
        old, new = (None if i is None else f"{home.thing(i).label} {i}" for i in (before[thing_id], after[thing_id]))
        where = f"elsewhere on the {new}" if old == new else f"from the {old} to the {new}"
        lines.append(f"{home.thing(thing_id).label}: {where}")
    return lines


def _changes(home: SimulatedHome, named: Sequence[Thing], moved: Relocation, seed: int) -> list[SceneChange]:
    world = home.world
    standing = {thing_id for thing_id, anchor in anchors_of(world).items() if anchor is not None}
    wanted = {thing.id for thing in named} & standing
    if not wanted:
        return relocated(world, moved, min(_MOVED, len(standing)), seed, 0.0, home.free, {thing.id for thing in named})
    return relocated(world, moved, len(wanted), seed, 0.0, home.free, standing - wanted)
