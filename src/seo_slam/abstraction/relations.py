"""How a thing stands to an anchor: on it, in it, next to it (DualMap IV-A; "in" and "next to" are ours).

Clouds are partial: what stands on a table hides a part of it, and the lower part of a thing may be hidden. So an anchor's footprint is
closed, and a thing's bottom may be further above a plane than below it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from seo_slam.abstraction.abstract_map import RelationKind
from seo_slam.abstraction.footprints import Region, footprint
from seo_slam.abstraction.support import Plane, planes, support_height
from seo_slam.geometry import FloatArray
from seo_slam.settings.abstraction import AbstractionSettings

_CELL_M = 0.025
_SECTORS = 12
_STRAY, _STRAY_OF_ANCHOR = 5.0, 1.0
"""Percent of the points at either end of an extent that are taken for stray ones: masks of small things reach over their edges; the legs
of a table are few points."""
_FEW = 50
_FOOT_M, _FOOT_SHARE = 0.12, 0.4
_BY_HEIGHT = 0.5
"""What a bottom at the very limit costs against a share of the footprint."""
_ROUNDING_M = 1e-6


@dataclass(frozen=True, eq=False)
class Body:
    """A cloud as relations see it.

    Attributes:
        p_world: (N, 3).
        low_world, high_world: (3,) corners of its box, a few stray points left out.
    """

    p_world: FloatArray
    low_world: FloatArray
    high_world: FloatArray

    @classmethod
    def of(cls, p_world: FloatArray, anchor: bool) -> Self:
        """Measure a cloud (N, 3), N >= 1, of an anchor or of something else."""
        stray = (_STRAY_OF_ANCHOR if anchor else _STRAY) if len(p_world) >= _FEW else 0.0
        low, high = np.percentile(p_world, [stray, 100.0 - stray], axis=0)
        return cls(p_world, low, high)

    @cached_property
    def bounds_world(self) -> tuple[FloatArray, FloatArray]:
        """Low and high corner (2,) of all its points seen from above, stray ones too."""
        return self.p_world[:, :2].min(axis=0), self.p_world[:, :2].max(axis=0)

    @property
    def longest_m(self) -> float:
        """Its longest side."""
        return float((self.high_world - self.low_world).max())


@dataclass(frozen=True, eq=False)
class Carrier:
    """An anchor as relations see it.

    Attributes:
        body: its cloud.
        region: what it covers seen from above.
        planes: its level surfaces above the floor; the last is its top, where nothing level may have been seen.
        support_z_m: height of the main one.
    """

    body: Body
    region: Region
    planes: tuple[Plane, ...]
    support_z_m: float

    @classmethod
    def of(cls, body: Body, settings: AbstractionSettings) -> Self:
        """Find the surfaces of a body."""
        low_m, top_m = float(body.low_world[2]), float(body.high_world[2])
        # What is level at the foot of a high thing is floor that was taken for it, or stands so low that "in" tells more.
        foot_m = low_m + min(_FOOT_M, _FOOT_SHARE * (top_m - low_m))
        found = tuple(plane for plane in planes(body.p_world, settings) if plane.height_m > foot_m)
        return cls(body, Region.of(footprint(body.p_world, _CELL_M), _CELL_M), (*found, Plane(top_m, 0.0)), support_height(found, top_m))


def on(body: Body, carrier: Carrier, settings: AbstractionSettings) -> float | None:
    """Return how well a thing stands on an anchor, greater is better; None if it does not.

    It does if most of its own points lie over the anchor's footprint, and its bottom is near one of the anchor's planes.
    """
    over = float(carrier.region.contains(body.p_world[:, :2]).mean())
    heights_m = float(body.low_world[2]) - np.array([plane.height_m for plane in carrier.planes])
    near = heights_m[(heights_m >= -settings.on_below_m) & (heights_m <= settings.on_above_m)]
    if over < settings.on_overlap or not len(near):
        return None
    limit_m = max(settings.on_below_m, settings.on_above_m, 1e-9)
    return over - _BY_HEIGHT * float(np.abs(near).min()) / limit_m


def inside(body: Body, carrier: Carrier, settings: AbstractionSettings) -> float | None:
    """Return the share of a thing that is in an anchor, a shelf or a drawer; None if it is not.

    It is if most of its points lie in the anchor's box and over its footprint, and there is anchor in most directions around it: under a
    table is not in it.
    """
    slack_m = 0.5 * settings.on_below_m
    z = body.p_world[:, 2]
    tall = (z >= carrier.body.low_world[2] - slack_m) & (z <= carrier.body.high_world[2] + slack_m)
    share = float((tall & carrier.region.contains(body.p_world[:, :2])).mean())
    return share if share >= settings.in_share and _enclosed(body, carrier) >= settings.in_enclosed else None


def next_to(body: Body, carrier: Carrier, settings: AbstractionSettings) -> float | None:
    """Return minus the gap between the footprints of a thing and an anchor, metres; None if too wide, or at other heights."""
    slack_m = settings.next_to_height_m
    level = body.low_world[2] <= carrier.body.high_world[2] + slack_m and body.high_world[2] >= carrier.body.low_world[2] - slack_m
    near = (body.p_world >= body.low_world).all(axis=1) & (body.p_world <= body.high_world).all(axis=1)
    gap_m = carrier.region.gap_m(body.p_world[near, :2]) if level else float("inf")
    return -gap_m if gap_m <= settings.next_to_m else None


_TESTS = {"on": on, "in": inside, "next to": next_to}


def best_relation(body: Body, carriers: Sequence[Carrier], settings: AbstractionSettings) -> tuple[int, RelationKind] | None:
    """Return the index of the anchor that a thing belongs to, and how; None if to none.

    The kinds are tried in the order of the settings; within a kind the best anchor wins, the first on a tie. So a thing belongs to one
    anchor: two tables that could both carry it stand together, and a robot that goes to either sees both.
    """
    near = _near(body, carriers, settings)
    for kind in settings.relations:
        scores = [(_TESTS[kind](body, carriers[i], settings), i) for i in near]
        known = [(-round(score, 9), i) for score, i in scores if score is not None]
        if known:
            return min(known)[1], kind
    return None


def is_carried(body: Body, carriers: Sequence[Carrier], settings: AbstractionSettings) -> bool:
    """Whether a thing is on or in one of some anchors."""
    return any(test(body, carriers[i], settings) is not None for i in _near(body, carriers, settings) for test in (on, inside))


def _near(body: Body, carriers: Sequence[Carrier], settings: AbstractionSettings) -> list[int]:
    """Indices of the anchors that a thing can be related to at all: their boxes are at most ``next_to_m`` apart, seen from above."""
    if not carriers:
        return []
    low, high = body.bounds_world
    boxes = np.array([carrier.region.bounds_world for carrier in carriers])
    apart_m = np.maximum(boxes[:, 0] - high, low - boxes[:, 1]).max(axis=1)
    return [int(i) for i in np.flatnonzero(apart_m <= settings.next_to_m + _ROUNDING_M)]


def _enclosed(body: Body, carrier: Carrier) -> float:
    """Share of the directions around a thing, at its height, in which the anchor has points."""
    p = carrier.body.p_world
    level = p[(p[:, 2] >= body.low_world[2]) & (p[:, 2] <= body.high_world[2]), :2]
    away = level - 0.5 * (body.low_world + body.high_world)[:2]
    bearings = np.arctan2(away[:, 1], away[:, 0])
    sectors = np.floor((bearings + np.pi) / (2 * np.pi) * _SECTORS).astype(np.int64) % _SECTORS
    return len(np.unique(sectors)) / _SECTORS
