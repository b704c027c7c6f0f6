"""Agents propose, the map disposes: an edit is applied only to the version it was made for, and only if the geometry allows it."""

import numpy as np

from seo_slam.errors import EditRefused, FrameError
from seo_slam.interfaces import Embedder, Smoother
from seo_slam.mapping.duplicates import one_within_other
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.perception.labels import clean_label
from seo_slam.records import Confirm, Doubt, Edit, MapEvent, Merge, Relabel, Remove


def apply_edit(edit: Edit, object_map: ObjectMap, smoother: Smoother, embedder: Embedder) -> MapEvent:
    """Apply one edit to map and graph; ``embedder`` gives a new word its vector, so that a query finds it.

    Returns:
        The event for the history.

    Raises:
        EditRefused: it is no edit, an id is unknown, its version has changed since the agent saw it, the label is no text or empty,
            or two landmarks to be merged lie farther apart than their extents allow. Nothing has changed then.
    """
    match edit:
        case Confirm(landmark_id, version, source):
            _require_version(object_map, landmark_id, version)
            return MapEvent("confirmed", landmark_id, object_map[landmark_id].label, source)
        case Doubt(landmark_id, version, source):
            _require_version(object_map, landmark_id, version)
            return MapEvent("doubted", landmark_id, object_map[landmark_id].label, source)
        case Relabel(landmark_id, version, label, source, category):
            _require_version(object_map, landmark_id, version)
            clean, plain = _clean(label, landmark_id), _clean(category, landmark_id) if category else ""
            before = object_map[landmark_id].label
            object_map.relabel(landmark_id, clean, embedder.embed_text([clean])[0], plain)
            return MapEvent("relabelled", landmark_id, f"{before} -> {clean}", source)
        case Remove(landmark_id, version, source):
            _require_version(object_map, landmark_id, version)
            label = object_map[landmark_id].label
            smoother.remove(landmark_id)
            object_map.forget(landmark_id)
            return MapEvent("removed", landmark_id, label, source)
        case Merge(keep_id, keep_version, drop_id, drop_version, source):
            if keep_id == drop_id:
                raise EditRefused(f"landmark {keep_id} cannot be merged with itself")
            _require_version(object_map, keep_id, keep_version)
            _require_version(object_map, drop_id, drop_version)
            require_close(keep_id, drop_id, object_map, smoother)
            return merge_landmarks(keep_id, drop_id, object_map, smoother, source)
        case _:
            raise EditRefused(f"got {edit!r:.80}, wanted Confirm, Relabel, Remove or Merge")


def merge_landmarks(keep_id: int, drop_id: int, object_map: ObjectMap, smoother: Smoother, source: str = "pipeline") -> MapEvent:
    """Make two landmarks one, in graph and map; the event belongs to the one that goes."""
    label = object_map[drop_id].label
    smoother.merge(keep_id, drop_id)
    object_map.merge(keep_id, drop_id)
    return MapEvent("merged", drop_id, label, source, other_id=keep_id)


def _clean(label: str, landmark_id: int) -> str:
    try:
        clean = clean_label(label)
    except FrameError as error:
        raise EditRefused(f"landmark {landmark_id}: {error}") from error
    if clean is None:
        raise EditRefused(f"landmark {landmark_id}: got an empty label")
    return clean


def _require_version(object_map: ObjectMap, landmark_id: int, version: int) -> None:
    if landmark_id not in object_map:
        raise EditRefused(f"landmark {landmark_id} is not in the map (any more)")
    now = object_map[landmark_id].version
    if now != version:
        raise EditRefused(f"landmark {landmark_id}: the edit is for version {version}, it is at {now} now")


def require_close(keep_id: int, drop_id: int, object_map: ObjectMap, smoother: Smoother) -> bool:
    """Return whether the centre of one landmark lies within the extent of the other.

    Raises:
        EditRefused: they lie farther apart than their extents allow.
    """
    ids, positions = smoother.positions()
    where = {int(i): p for i, p in zip(ids, positions, strict=True)}
    apart_m = where[keep_id] - where[drop_id]
    reach_m = 0.5 * float(object_map[keep_id].size_m().max() + object_map[drop_id].size_m().max())
    if float(np.linalg.norm(apart_m)) > reach_m:
        far = f"{float(np.linalg.norm(apart_m)):.2f} m apart, their extents reach {reach_m:.2f} m"
        raise EditRefused(f"landmarks {keep_id} and {drop_id} lie {far}")
    return one_within_other(object_map[keep_id], object_map[drop_id], apart_m)
