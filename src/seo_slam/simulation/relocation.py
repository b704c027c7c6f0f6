"""Things that are moved in a home: elsewhere on the same piece of furniture, or onto another."""

from collections.abc import Collection
from typing import Literal

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.simulation.draws import generator
from seo_slam.simulation.free_space import FreeSpace, free_space
from seo_slam.simulation.resting import Carriers, anchor_of, anchors_of
from seo_slam.simulation.scene import SceneChange
from seo_slam.simulation.world import Thing, World

__all__ = ["Relocation", "anchor_of", "relocated"]

Relocation = Literal["in_anchor", "cross_anchor"]

IN_ANCHOR_M = (0.2, 0.12, 0.06)
"""A thing that stays on its piece of furniture moves at least so far; the next value where there is no room for that."""
CROSS_ANCHOR_M = 0.2


def relocated(
    world: World,
    kind: Relocation,
    count: int,
    seed: int = 0,
    timestamp_s: float = 0.0,
    free: FreeSpace | None = None,
    keep: Collection[int] = (),
) -> list[SceneChange]:
    """Return moves of things that stand on furniture; each comes to rest clear of all others, where one can stand within 1 m and see it.

    With ``timestamp_s`` 0 they make the world of another recording: it is changed before its first frame.

    Args:
        world: the home as it is.
        kind: "in_anchor": elsewhere on the same piece of furniture; "cross_anchor": onto another.
        count: how many things.
        seed: of the draws.
        timestamp_s: of all the moves.
        free: the free floor of this world, if it is known already.
        keep: ids of things that stay where they are.

    Raises:
        ConfigError: an unknown kind, a count below 0, more things than there are on furniture, or fewer that find another place.
    """
    if kind not in ("in_anchor", "cross_anchor"):
        raise ConfigError(f"relocation: got {kind!r}, wanted in_anchor or cross_anchor")
    if count < 0:
        raise ConfigError(f"relocation: got {count} things, wanted 0 or more")
    if count == 0:
        return []
    carriers = Carriers(world, free or free_space(world))
    standing = {thing.id: anchor_id for thing in carried_things(world) if (anchor_id := carriers.below(thing)) is not None}
    ids = sorted(set(standing) - set(keep))
    if count > len(ids):
        raise ConfigError(f"relocation: got {count} things to move, wanted at most the {len(ids)} that stand on furniture")
    draws = generator(seed, "relocation", kind)
    now = {thing.id: thing for thing in carried_things(world)}
    stuck: list[str] = []
    changes: list[SceneChange] = []
    for k in draws.permutation(len(ids)):
        if len(changes) == count:
            break
        thing = now[ids[int(k)]]
        moved = _elsewhere(thing, kind, standing[thing.id], carriers, list(now.values()), draws)
        if moved is None:
            stuck.append(thing.label)
            continue
        now[thing.id] = moved
        changes.append(SceneChange(timestamp_s, "moved", moved))
    if len(changes) < count:
        raise ConfigError(f"relocation {kind}: no other place for the {', '.join(stuck)}: {len(changes)} of {count} moved")
    return changes


def removed(world: World, count: int, seed: int = 0, timestamp_s: float = 0.0, keep: Collection[int] = ()) -> list[SceneChange]:
    """Return the taking away of some things that people carry about and that stand on furniture; not of those to keep.

    Raises:
        ConfigError: more than there are.
    """
    anchors = anchors_of(world)
    known = [thing for thing in carried_things(world) if thing.id not in keep and anchors[thing.id] is not None]
    if not 0 <= count <= len(known):
        raise ConfigError(f"removal: got {count} things, wanted 0 to {len(known)}")
    order = generator(seed, "removal").permutation(len(known))[:count]
    return [SceneChange(timestamp_s, "removed", known[int(k)]) for k in order]


def carried_things(world: World) -> list[Thing]:
    """Return what people carry about, by id."""
    return sorted((thing for thing in world.things if thing.kind == "volatile"), key=lambda thing: thing.id)


def _elsewhere(
    thing: Thing, kind: Relocation, anchor_id: int, carriers: Carriers, now: list[Thing], draws: np.random.Generator
) -> Thing | None:
    others = [other for other in now if other.id != thing.id]
    same = kind == "in_anchor"
    anchors = [anchor for anchor in carriers.anchors if (anchor.id == anchor_id) == same]
    for least_m in IN_ANCHOR_M if same else (CROSS_ANCHOR_M,):
        moved = carriers.rest(thing, thing.id, anchors, others, draws, thing.p_world, least_m)
        if moved is not None:
            return moved
    return None
