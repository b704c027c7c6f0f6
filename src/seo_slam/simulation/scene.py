"""A scene: a world, and what is taken away, moved or added while it is recorded."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.world import Thing, World

Event = Literal["removed", "moved", "added"]


@dataclass(frozen=True, slots=True, eq=False)
class SceneChange:
    """One thing that changes between two frames.

    Attributes:
        timestamp_s: frames from this stamp on show the world after it.
        event: what happens.
        thing: as it is afterwards; as it was, if it is removed.
    """

    timestamp_s: float
    event: Event
    thing: Thing


class Scene:
    """A world that changes at stated times. What is true is known at every time."""

    def __init__(self, start: World, changes: Sequence[SceneChange] = ()) -> None:
        """Play the changes through once.

        Args:
            start: what there is before the first change.
            changes: in any order; those of one stamp happen at once.

        Raises:
            ConfigError: a thing is removed or moved that is not there, or added though it is.
        """
        self.start = start
        self.changes = tuple(sorted(changes, key=lambda change: change.timestamp_s))
        self._stamps_s: list[float] = [-np.inf]
        self._worlds: list[World] = [start]
        self._before: list[FloatArray | None] = []  # where each changed thing's middle was
        for change in self.changes:
            self._apply(change)

    @property
    def end(self) -> World:
        """What there is after the last change."""
        return self._worlds[-1]

    @property
    def worlds(self) -> tuple[World, ...]:
        """All states, in order."""
        return tuple(self._worlds)

    def world_at(self, timestamp_s: float) -> World:
        """Return what there is at a time: the same object until something changes."""
        return self._worlds[int(np.searchsorted(self._stamps_s, timestamp_s, side="right")) - 1]

    def last_change_s(self, thing_id: int) -> float:
        """Return since when a thing is where it is at the end; minus infinity if it never changed."""
        return max((change.timestamp_s for change in self.changes if change.thing.id == thing_id), default=-np.inf)

    def timeline(self) -> list[dict[str, Any]]:
        """Return the changes in the form of ``truth.json``.

        ``center`` is where the thing is then, or was if it is removed; ``aabb_min`` and ``aabb_max`` bound it there, world frame, metres.
        """
        rows = []
        for change, before in zip(self.changes, self._before, strict=True):
            thing = change.thing
            low, high = thing.bounds_world
            row: dict[str, Any] = {
                "timestamp_s": change.timestamp_s,
                "event": change.event,
                "id": thing.id,
                "label": thing.label,
                "accepted_labels": [thing.label, *thing.accepted_labels],
                "center": rounded(thing.p_world),
                "aabb_min": rounded(low),
                "aabb_max": rounded(high),
            }
            if before is not None and change.event == "moved":
                row["previous_center"] = rounded(before)
            rows.append(row)
        return rows

    def _apply(self, change: SceneChange) -> None:
        world = self._worlds[-1]
        known = {thing.id for thing in world.things}
        thing = change.thing
        if (thing.id in known) == (change.event == "added"):
            there = "is there already" if change.event == "added" else "is not there"
            raise ConfigError(f"scene: {change.event} at {change.timestamp_s} s: thing {thing.id} ({thing.label}) {there}")
        self._before.append(None if change.event == "added" else world.thing(thing.id).p_world)
        after = world.without(thing.id) if change.event == "removed" else world.with_thing(thing)
        if change.timestamp_s == self._stamps_s[-1]:
            self._worlds[-1] = after
        else:
            self._stamps_s.append(change.timestamp_s)
            self._worlds.append(after)


def rounded(values: FloatArray) -> list[float]:
    """Return numbers for a file, to the micrometre."""
    return [round(float(v), 6) for v in values]
