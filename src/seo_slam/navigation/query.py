"""From what a person asks for to anchors that are worth going to (DualMap IV-B)."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Room
from seo_slam.abstraction.room_finding import room_of
from seo_slam.errors import ConfigError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.outcomes import Candidate

_ARTICLE = re.compile(r"^(?:(?:the|a|an|my|our|your)(?:\s+|$))+", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Query:
    """What is asked for.

    Attributes:
        text: as it was said.
        words: what is looked for; "" if nothing is.
        room: name of the room in which it must be; None for anywhere.
    """

    text: str
    words: str
    room: str | None = None


def parsed(text: str, rooms: Sequence[Room] = ()) -> Query:
    """Part a query such as "the mug in the kitchen" into what and where.

    Only names of rooms of the map count, at the end of the text after "in", "inside", "from" or "of"; any other place stays part of what
    is looked for. An article at the beginning is dropped: it tells nothing, and blurs the embedding.

    Raises:
        ConfigError: ``text`` is no string.
    """
    if not isinstance(text, str):
        raise ConfigError(f"query: got {type(text).__name__}, wanted text such as 'the mug in the kitchen'")
    plain = " ".join(text.split()).strip(" .?!,;")
    for name in sorted({room.name for room in rooms if room.name.strip()}, key=lambda name: (-len(name), name)):
        found = re.match(rf"^(.+?)\s+(?:in|inside|from|of)\s+(?:the\s+|my\s+|our\s+)?{re.escape(name)}$", plain, re.IGNORECASE)
        if found:
            return Query(text, _ARTICLE.sub("", found.group(1)).strip(), name)
    return Query(text, _ARTICLE.sub("", plain).strip())


def candidates(
    abstract_map: AbstractMap, feature: FloatArray, exclude: Collection[int] = (), room: str | None = None
) -> tuple[Candidate, ...]:
    """Return all anchors with their scores, best first; Eq 6 takes the first.

    The score of an anchor is the largest cosine of the query with its own feature and with those of what is on it (Eq 5).

    Args:
        abstract_map: where to look.
        feature: (D,) of the query, of any length.
        exclude: ids of anchors that are left out.
        room: only anchors in rooms of this name; None for all.

    Raises:
        ConfigError: the query's feature has another size than those of the map.
    """
    wanted = [anchor for anchor in abstract_map.anchors if anchor.id not in exclude and _is_in(abstract_map, anchor, room)]
    scored = [_candidate(anchor, np.asarray(feature, dtype=np.float64)) for anchor in wanted]
    return tuple(sorted(scored, key=lambda candidate: (-candidate.score, candidate.anchor_id)))


def with_hints(abstract_map: AbstractMap, feature: FloatArray, least_score: float) -> AbstractMap:
    """Return the map in which what is not trusted, and scores at least so much for a query's feature (D,), counts like what is."""

    def hinted(anchor: Anchor) -> Anchor:
        like = [cosine(hint.feature[None], feature)[0] >= least_score for hint in anchor.hints]
        sought = tuple(hint for hint, is_like in zip(anchor.hints, like, strict=True) if is_like)
        rest = tuple(hint for hint, is_like in zip(anchor.hints, like, strict=True) if not is_like)
        return replace(anchor, volatiles=(*anchor.volatiles, *sought), hints=rest)

    return replace(abstract_map, anchors=tuple(hinted(anchor) for anchor in abstract_map.anchors))


def cosine(rows: FloatArray, feature: FloatArray) -> FloatArray:
    """Return (N,) cosines of rows (N, D) with a vector (D,); 0 where one of them is zero.

    Raises:
        ConfigError: their sizes differ.
    """
    if rows.shape[1:] != feature.shape:
        raise ConfigError(f"query: got a feature {feature.shape} for a map of features {rows.shape[1:]}; use the embedder of the map")
    lengths = np.linalg.norm(rows, axis=1) * np.linalg.norm(feature)
    return np.asarray(np.divide(rows @ feature, lengths, out=np.zeros(len(rows)), where=lengths > 0))


def room_ids(rooms: Sequence[Room], name: str) -> frozenset[int]:
    """Return the ids of all rooms of a name."""
    return frozenset(room.id for room in rooms if room.name.casefold() == name.casefold())


def _is_in(abstract_map: AbstractMap, anchor: Anchor, room: str | None) -> bool:
    if room is None or abstract_map.layout is None:
        return True
    return room_of(abstract_map.layout, anchor.footprint_world) in room_ids(abstract_map.rooms, room)


def _candidate(anchor: Anchor, feature: FloatArray) -> Candidate:
    scores = cosine(np.stack([anchor.feature, *(volatile.feature for volatile in anchor.volatiles)]), feature)
    best = int(np.argmax(scores))
    thing = anchor.volatiles[best - 1] if best else None
    because = anchor.label if thing is None else thing.label
    return Candidate(anchor.id, float(scores[best]), because, thing is not None, thing)
