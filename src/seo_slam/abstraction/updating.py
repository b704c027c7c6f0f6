"""An abstract map as a new view changes it (DualMap IV-D)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Volatile
from seo_slam.abstraction.footprints import Region, box_share, footprint
from seo_slam.errors import MapError
from seo_slam.geometry import FloatArray
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.types import BoolArray

_NO_PAIR = -10.0
_TALL_M = 0.02
"""A thing counts as at least so high, so that a flat one has a height range."""


def updated(old: AbstractMap, new: AbstractMap, settings: AbstractionSettings) -> AbstractMap:
    """Return a map as a newer view of a part of it changes it.

    A new anchor is an old one if their footprints overlap by more than ``update_overlap`` (the greater of the two shares), their
    height ranges do too, and they are alike: by features, by label, or, since a detector may call a thing otherwise, by supporting
    plane where each covers the other. A chair under a table is none of these. No two take the same old one, but for pieces of it.

    An old anchor that was seen again gets the points and the feature of both (Eq 7) and keeps its id. If the new view covers more than
    ``replace_overlap`` of it, not from too far, what is on it is what was seen now: what is gone is forgotten. Else what was seen
    joins what was known: who saw a corner knows nothing of the rest.
    An anchor that was never seen before gets a new id.

    Args:
        old: the map so far; its layout and rooms are kept, if it has any.
        new: the abstract map of what was seen since; its ids mean nothing here.
        settings: thresholds.

    Raises:
        MapError: the two hold features of different models.
    """
    if old.embedder != new.embedder and old.anchors and new.anchors:
        raise MapError(f"abstract map: got features of {new.embedder!r} for a map of {old.embedder!r}, wanted one model")
    groups, rest = _matched(old.anchors, new.anchors, settings)
    anchors = [_seen_again(anchor, groups[i], settings) if i in groups else anchor for i, anchor in enumerate(old.anchors)]
    next_id = max((anchor.id for anchor in old.anchors), default=-1) + 1
    anchors += [replace(anchor, id=next_id + k) for k, anchor in enumerate(rest)]
    embedder = old.embedder if old.anchors else new.embedder or old.embedder
    layout, rooms = (new.layout, new.rooms) if old.layout is None else (old.layout, old.rooms)
    return AbstractMap(tuple(anchors), layout, rooms, embedder, old.features if old.anchors else new.features or old.features)


def _matched(old: Sequence[Anchor], new: Sequence[Anchor], settings: AbstractionSettings) -> tuple[dict[int, list[Anchor]], list[Anchor]]:
    """Return index of an old anchor -> new ones that are it, the best first, and the new ones that are none."""
    if not old or not new:
        return {}, list(new)
    scores, pieces = _scores(old, new, settings)
    rows, columns = linear_sum_assignment(scores, maximize=True)
    pairs = {int(c): int(r) for r, c in zip(rows, columns, strict=True) if scores[r, c] > _NO_PAIR}
    for j in range(len(new)):
        if j not in pairs and pieces[:, j].any():  # two pieces of one sofa are no second sofa
            pairs[j] = int(np.argmax(np.where(pieces[:, j], scores[:, j], _NO_PAIR)))
    groups: dict[int, list[Anchor]] = {}
    for j, i in sorted(pairs.items(), key=lambda pair: (-scores[pair[1], pair[0]], pair[0])):
        groups.setdefault(i, []).append(new[j])
    return groups, [anchor for j, anchor in enumerate(new) if j not in pairs]


def _scores(old: Sequence[Anchor], new: Sequence[Anchor], settings: AbstractionSettings) -> tuple[FloatArray, BoolArray]:
    """(O, N) overlap plus cosine of the pairs that may be one thing, else ``_NO_PAIR``; and whether the new one is a piece of the old."""
    scores = np.full((len(old), len(new)), _NO_PAIR)
    pieces = np.zeros(scores.shape, dtype=np.bool_)
    old_regions, new_regions = ([Region.of(a.footprint_world, settings.footprint_voxel_m) for a in anchors] for anchors in (old, new))
    for i, one in enumerate(old):
        for j, other in enumerate(new):
            shares = _shares((one, old_regions[i]), (other, new_regions[j]), settings)
            if max(shares) <= settings.update_overlap or _height_overlap(one, other) <= settings.update_overlap:
                continue
            alike = _cosine(one.feature, other.feature) >= settings.same_anchor_cosine or (bool(one.label) and one.label == other.label)
            same_plane = abs(one.support_z_m - other.support_z_m) <= settings.same_height_m
            if alike or (same_plane and min(shares) > settings.update_overlap):
                scores[i, j] = max(shares) + _cosine(one.feature, other.feature)
                pieces[i, j] = alike and shares[1] > settings.update_overlap
    return scores, pieces


def _shares(one: tuple[Anchor, Region], other: tuple[Anchor, Region], settings: AbstractionSettings) -> tuple[float, float]:
    """Share of the first that lies in the second, and of the second that lies in the first."""
    a, b = one[0].footprint_world, other[0].footprint_world
    if not len(a) or not len(b):
        return 0.0, 0.0
    if settings.overlap == "boxes":
        return box_share(a, b, settings.footprint_voxel_m), box_share(b, a, settings.footprint_voxel_m)
    if (a.min(axis=0) > b.max(axis=0)).any() or (b.min(axis=0) > a.max(axis=0)).any():
        return 0.0, 0.0
    return one[1].share_in(other[1]), other[1].share_in(one[1])


def _height_overlap(one: Anchor, other: Anchor) -> float:
    """Share of the smaller height range that lies in the other."""
    (a, b), (c, d) = ((low - _TALL_M / 2, high + _TALL_M / 2) for low, high in (one.z_range_m, other.z_range_m))
    return max(0.0, min(b, d) - max(a, c)) / min(b - a, d - c)


def _seen_again(old: Anchor, seen: Sequence[Anchor], settings: AbstractionSettings) -> Anchor:
    """An anchor after it was seen again, in one piece or several."""
    new = seen[0]
    for piece in seen[1:]:
        volatiles, hints = (*new.volatiles, *piece.volatiles), (*new.hints, *piece.hints)
        new = replace(_joined(new, piece, settings), volatiles=volatiles, hints=hints)
    before, now = ((a, Region.of(a.footprint_world, settings.footprint_voxel_m)) for a in (old, new))
    covered = _shares(before, now, settings)[0]
    whole = covered > settings.replace_overlap and new.points >= settings.replace_points * old.points
    joined = _joined(old, new, settings)
    volatiles = new.volatiles if whole else _united(old.volatiles, new.volatiles, settings.same_volatile_cosine)
    heavier = new if whole or new.points > old.points else old
    hints = new.hints if whole else _united(old.hints, new.hints, settings.same_volatile_cosine)
    return replace(joined, support_z_m=heavier.support_z_m, volatiles=volatiles, hints=hints)


def _joined(old: Anchor, new: Anchor, settings: AbstractionSettings) -> Anchor:
    """Both clouds and, weighted by their sizes, both features (Eq 7), under the first one's id."""
    if not len(old.footprint_world) or not len(new.footprint_world):
        return old if len(old.footprint_world) else replace(new, id=old.id)
    feature = old.points * old.feature + new.points * new.feature
    length = float(np.linalg.norm(feature))
    label = (new if new.label and (new.points > old.points or not old.label) else old).label
    return replace(
        old,
        label=label,
        feature=feature / length if length > 0 else old.feature,
        footprint_world=footprint(np.concatenate([old.footprint_world, new.footprint_world]), settings.footprint_voxel_m),
        points=_points_of_both(old, new, settings),
        z_range_m=(min(old.z_range_m[0], new.z_range_m[0]), max(old.z_range_m[1], new.z_range_m[1])),
    )


def _points_of_both(old: Anchor, new: Anchor, settings: AbstractionSettings) -> int:
    """How many points both clouds have after they were put together and thinned out: what lies in both counts once.

    Were they added up, a map would stiffen with every view.
    """
    regions = [Region.of(anchor.footprint_world, settings.footprint_voxel_m) for anchor in (old, new)]
    return max(old.points, new.points, old.points + round(new.points * (1.0 - regions[1].share_in(regions[0]))))


def _united(old: Iterable[Volatile], new: Iterable[Volatile], same_cosine: float) -> tuple[Volatile, ...]:
    """What was known, as it looks now where it was seen again, and after it what came; two cups stay two."""
    known, came = list(old), list(new)
    if not known or not came:
        return (*known, *came)
    cosines = np.array([[_cosine(a.feature, b.feature) for b in came] for a in known])
    rows, columns = linear_sum_assignment(np.where(cosines >= same_cosine, cosines, _NO_PAIR), maximize=True)
    again = {int(c): int(r) for r, c in zip(rows, columns, strict=True) if cosines[r, c] >= same_cosine}
    for column, row in again.items():
        known[row] = came[column]
    return (*known, *(volatile for j, volatile in enumerate(came) if j not in again))


def _cosine(a: FloatArray, b: FloatArray) -> float:
    return float(a @ b) if a.shape == b.shape else -1.0
