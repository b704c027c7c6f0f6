"""Where a thing is, said the way people say it; every number is computed from the map."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.ask.retrieval import Retrieved
from seo_slam.map import Map
from seo_slam.types import Landmark

LONGEST_LABEL = 80
_NEXT_TO_M = 0.5
_FARTHEST_M = 2.0
_ON_TOLERANCE_M = 0.08
_SURELY_THERE = 0.8
_LONG_UNSEEN_S = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where a thing is in relation to another one.

    Attributes:
        relation: "on", "next to" or "from".
        other: the other thing, a stable and named one.
        distance_m: between the two centres.
    """

    relation: str
    other: Landmark
    distance_m: float

    def words(self, landmark: Landmark, with_id: bool = True) -> str:
        """For example "next to the blue chair (landmark 2), 0.30 m away"."""
        article = "another" if self.other.label == landmark.label else "the"
        name = f"{article} {name_of(self.other)}" + (f" (landmark {self.other.id})" if with_id else "")
        if self.relation == "on":
            return f"on {name}"
        return f"next to {name}, {self.distance_m:.2f} m away" if self.relation == "next to" else f"{self.distance_m:.2f} m from {name}"


def place_of(landmark: Landmark, map_: Map) -> Place | None:
    """Return what a thing stands on, where up is known, else the nearest thing within 2 m; None if there is neither.

    Only named things that are surely there count.
    """
    others = [row for row in map_.landmarks if row.id != landmark.id and row.label and row.existence >= _SURELY_THERE]
    if not others:
        return None
    distances_m = np.linalg.norm(np.array([row.position_m for row in others]) - landmark.position_m, axis=1)
    order = np.argsort(distances_m, kind="stable")
    if map_.gravity == "poses":
        for i in order:
            if _stands_on(landmark, others[i]):
                return Place("on", others[i], float(distances_m[i]))
    nearest, distance_m = others[order[0]], float(distances_m[order[0]])
    if distance_m > _FARTHEST_M:
        return None
    return Place("next to" if distance_m <= _NEXT_TO_M else "from", nearest, distance_m)


def _stands_on(thing: Landmark, support: Landmark) -> bool:
    bottom_m = thing.position_m[2] - thing.size_m[2] / 2
    top_m = support.position_m[2] + support.size_m[2] / 2
    above = np.abs(thing.position_m[:2] - support.position_m[:2]) <= support.size_m[:2] / 2
    broader = np.prod(support.size_m[:2]) > 1.5 * np.prod(thing.size_m[:2])
    return bool(abs(bottom_m - top_m) <= _ON_TOLERANCE_M and above.all() and broader)


def described(landmark: Landmark, map_: Map) -> str:
    """For example "red mug (landmark 4) at x 0.32, y -0.48, z 0.10 m, on the table (landmark 2); seen 12 times"."""
    x, y, z = (f"{value + 0.0:.2f}" for value in np.round(landmark.position_m, 2))
    place = place_of(landmark, map_)
    where = f"at x {x}, y {y}, z {z} m" + (f", {place.words(landmark)}" if place else "")
    times = "once" if landmark.observations == 1 else f"{landmark.observations} times"
    facts = [f"seen {times}"]
    unseen_s = unseen_for_s(landmark, map_)
    if unseen_s >= _LONG_UNSEEN_S:
        facts.append(f"not seen in the last {unseen_s / 60:.0f} min")
    if landmark.existence < _SURELY_THERE:
        facts.append(f"{landmark.existence:.0%} sure that it is still there")
    return f"{name_of(landmark)} (landmark {landmark.id}) {where}; {', '.join(facts)}"


def unseen_for_s(landmark: Landmark, map_: Map) -> float:
    """How long before the map's newest sighting the thing was seen last, seconds."""
    return max(max(row.last_seen_s for row in map_.landmarks) - landmark.last_seen_s, 0.0)


def ranked_list(question: str, found: Sequence[Retrieved], map_: Map) -> str:
    """The answer without a language model: what stands out, then the rest in brief."""
    asked = f'"{printable(question.strip())}"'
    if not found:
        unsure = sum(1 for row in map_.tentative if row.label)
        more = f" {unsure} named {'one is' if unsure == 1 else 'ones are'} not stable (yet)." if unsure else ""
        return f"The map holds no stable thing that has a name, so there is no answer to {asked}.{more}"
    good = [hit for hit in found if hit.stands_out]
    if good:
        what = "one thing stands out" if len(good) == 1 else f"{len(good)} things stand out"
        lines = [f"For {asked} {what}:", *_numbered(good, map_)]
        rest = [hit for hit in found if not hit.stands_out]
        return "\n".join([*lines, "Less likely: " + ", ".join(_brief(hit) for hit in rest)] if rest else lines)
    if found[0].spreads is None:
        return "\n".join(
            [f"The map holds too few different things to say what fits {asked}; nearest in meaning first:", *_numbered(found, map_)]
        )
    return "\n".join(
        [f"Nothing in the map stands out for {asked}; nearest in meaning, perhaps none of it fits:", *_numbered(found[:3], map_)]
    )


def _numbered(found: Sequence[Retrieved], map_: Map) -> list[str]:
    return [f"{i}. {described(hit.landmark, map_)}. Score {hit.score:.2f}" for i, hit in enumerate(found, 1)]


def _brief(hit: Retrieved) -> str:
    return f"{name_of(hit.landmark)} (landmark {hit.landmark.id}, {hit.score:.2f})"


def name_of(landmark: Landmark) -> str:
    """The label, fit to be printed; "thing" if there is none."""
    return printable(landmark.label)[:LONGEST_LABEL] or "thing"


def printable(text: str) -> str:
    """Text that can neither steer a terminal nor break a line: a label may come from a sign that a camera saw."""
    return "".join(c if c.isprintable() else "?" for c in text)
