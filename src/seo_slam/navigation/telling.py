"""How a search ended, in words: what was asked for and as what it was met, where, and what was looked at."""

from collections.abc import Sequence

from seo_slam.abstraction.abstract_map import AbstractMap
from seo_slam.abstraction.room_finding import room_of
from seo_slam.geometry import FloatArray
from seo_slam.navigation.local_match import Match, center_of
from seo_slam.navigation.outcomes import Attempt, anchor_name
from seo_slam.navigation.query import Query, candidates


def taken_for(query: Query, match: Match) -> str:
    """Say that a match is what was asked for; with both words where the map has another one for it."""
    if match.label.casefold() == query.words.casefold():
        return f"the {match.label} is what was asked for"
    return f"the {match.label} is taken for the {query.words} that was asked for"


def stopped_before(query: Query, match: Match, abstract_map: AbstractMap) -> str:
    """Say before what the robot stopped, and which room that is in if another one was named."""
    told = f"stopped before the {match.label} ({match.score:.2f})"
    if match.label.casefold() != query.words.casefold():
        told += f", taken for the {query.words} that was asked for"
    room = _room_name(abstract_map, center_of(match.landmark)[None, :2])
    if query.room is not None and room and room.casefold() != query.room.casefold():
        told += f"; it is in the {room}, not in the {query.room}"
    return told


def looked_in_vain(query: Query, attempts: Sequence[Attempt], best: Match | None, why: str) -> str:
    """Say that nothing was found, at which places, and what came nearest.

    Args:
        query: what was asked for.
        attempts: all; those that were come to are the places.
        best: of all that was seen.
        why: the search ended.
    """
    names = [_place_name(attempt) for attempt in attempts if attempt.reached]
    where = f" ({', '.join(names)})" if names else ""
    seen = "nothing was seen" if best is None else f"the best seen is a {best.label} ({best.score:.2f})"
    return f"no {query.words} was found at {len(names)} place{'' if len(names) == 1 else 's'}{where}, and {why}; {seen}"


def in_another_room(query: Query, feature: FloatArray, required: float, abstract_map: AbstractMap) -> str:
    """Say where else the map has what was asked for in a certain room; "" if it has it in no other room, or none was named.

    Args:
        query: what was asked for.
        feature: (D,) of the query.
        required: score from which a thing is like it.
        abstract_map: as updated.
    """
    if query.room is None or abstract_map.layout is None:
        return ""
    for candidate in candidates(abstract_map, feature):
        if candidate.score < required:
            break
        anchor = next(anchor for anchor in abstract_map.anchors if anchor.id == candidate.anchor_id)
        room = _room_name(abstract_map, anchor.footprint_world)
        if room and room.casefold() != query.room.casefold():
            at = f" at the {anchor_name(anchor.label, anchor.id)}" if candidate.volatile else ""
            return f"the map has a {candidate.because or 'thing like it'}{at} in the {room}, though"
    return ""


def _place_name(attempt: Attempt) -> str:
    """The anchor that was come to; what is on none goes by its own word."""
    return attempt.anchor_name or f"{attempt.candidate.because or 'thing without a name'} on no furniture"


def _room_name(abstract_map: AbstractMap, xy_world: FloatArray) -> str:
    if abstract_map.layout is None:
        return ""
    id = room_of(abstract_map.layout, xy_world)
    return next((room.name for room in abstract_map.rooms if room.id == id), "")
