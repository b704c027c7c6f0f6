"""The abstract map of a concrete one (DualMap IV-A)."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor, Layout, Room, Volatile
from seo_slam.abstraction.anchors import Mobility, features_of, words_for
from seo_slam.abstraction.footprints import footprint, without_stray
from seo_slam.abstraction.horizon import place_on
from seo_slam.abstraction.relations import Body, Carrier, best_relation, is_carried
from seo_slam.errors import MapError
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.perception.cloud import box_surface
from seo_slam.settings.abstraction import AbstractionSettings
from seo_slam.types import Landmark

_BOX_STEP_M = 0.05


def abstract(
    landmarks: Sequence[Landmark],
    embedder: Embedder,
    settings: AbstractionSettings,
    layout: Layout | None = None,
    rooms: tuple[Room, ...] = (),
    tentative: Sequence[Landmark] = (),
) -> AbstractMap:
    """Return the abstract map of landmarks: those that rarely move, each with the features of what belongs to it.

    A volatile thing that belongs to no anchor, or of which neither a word nor a feature is known, is left out. A landmark without a cloud
    is taken for its box.

    Args:
        landmarks: the trusted (stable) ones, in any order, world frame with z up.
        embedder: made, or can make, the embeddings of the landmarks.
        settings: what is an anchor, and what belongs to it.
        layout: of the floor, kept with the map.
        rooms: of the layout.
        tentative: landmarks that are not trusted, not yet or (lost) no more; those that are no anchors, have a word and were observed
            often enough are kept as hints.

    Raises:
        MapError: an id is given twice, or a place is not finite.
    """
    unsure = [row for row in tentative if row.label and row.observations >= settings.hint_observations]
    rows = sorted((*landmarks, *unsure), key=lambda landmark: landmark.id)
    ids, hint_ids = [row.id for row in rows], {row.id for row in unsure}
    if len(set(ids)) != len(ids):
        raise MapError(f"abstract map: a landmark id is given twice: {ids}")
    features = features_of(rows, embedder)
    clouds = [_cloud(row) for row in rows]
    static = _static(rows, clouds, hint_ids, Mobility(embedder, settings), settings)
    bodies = [_body(cloud, still, settings) for cloud, still in zip(clouds, static, strict=True)]
    anchors = [i for i, row in enumerate(rows) if static[i] and row.id not in hint_ids]
    carriers = [Carrier.of(bodies[i], settings) for i in anchors]
    volatiles: list[list[Volatile]] = [[] for _ in anchors]
    hints: list[list[Volatile]] = [[] for _ in anchors]
    for i, row in enumerate(rows):
        related = None if static[i] or not features[i].any() else best_relation(bodies[i], carriers, settings)
        if related is not None:
            carrier = carriers[related[0]]
            place = place_on(0.5 * (bodies[i].low_world + bodies[i].high_world), carrier.body.p_world)
            belongs_to = hints if row.id in hint_ids else volatiles
            belongs_to[related[0]].append(Volatile(row.label, features[i], related[1], row.id, place))
    made = [_anchor(rows[i], features[i], carrier, settings) for i, carrier in zip(anchors, carriers, strict=True)]
    carried = zip(made, volatiles, hints, strict=True)
    whole = (replace(anchor, volatiles=tuple(sure), hints=tuple(not_sure)) for anchor, sure, not_sure in carried)
    return AbstractMap(tuple(whole), layout, tuple(rooms), embedder.name)


def _static(
    rows: Sequence[Landmark], clouds: Sequence[FloatArray], hint_ids: Collection[int], mobility: Mobility, settings: AbstractionSettings
) -> list[bool]:
    """Which landmarks rarely move: by their words and features, but for small ones in no list that are on or in another."""
    large = [_is_large(cloud, settings) for cloud in clouds]
    static = [mobility.of_landmark(words_for(row), row.embedding, big) for row, big in zip(rows, large, strict=True)]
    bodies = {i: _body(cloud, True, settings) for i, cloud in enumerate(clouds) if static[i]}
    doubtful = [i for i, body in bodies.items() if body.longest_m < settings.small_side_m and not mobility.is_listed(rows[i])]
    if not doubtful:
        return static
    sure = [Carrier.of(body, settings) for i, body in bodies.items() if i not in doubtful and rows[i].id not in hint_ids]
    carried = {i for i in doubtful if is_carried(bodies[i], sure, settings)}
    return [still and i not in carried for i, still in enumerate(static)]


def _anchor(row: Landmark, feature: FloatArray, carrier: Carrier, settings: AbstractionSettings) -> Anchor:
    body = carrier.body
    return Anchor(
        id=row.id,
        label=row.label,
        feature=feature,
        footprint_world=footprint(body.p_world, settings.footprint_voxel_m),
        points=len(body.p_world),
        z_range_m=(float(body.low_world[2]), float(body.high_world[2])),
        support_z_m=carrier.support_z_m,
    )


def _body(cloud: FloatArray, still: bool, settings: AbstractionSettings) -> Body:
    return Body.of(without_stray(cloud, settings.footprint_voxel_m) if still else cloud, still)


def _is_large(p_world: FloatArray, settings: AbstractionSettings) -> bool:
    body = Body.of(p_world, anchor=False)
    sides_m = body.high_world - body.low_world
    enough = sides_m[:2].max() >= settings.large_side_m and sides_m[2] >= settings.large_height_m
    return bool(enough and sides_m.max() <= settings.large_most_m)


def _cloud(row: Landmark) -> FloatArray:
    """The cloud (N, 3) of a landmark, world frame; points on its box where it has none."""
    p_world = np.asarray(row.cloud_world, dtype=np.float64).reshape(-1, 3)
    position_m, size_m = np.asarray(row.position_m, dtype=np.float64), np.asarray(row.size_m, dtype=np.float64)
    if not len(p_world) and np.isfinite(size_m).all():
        p_world = position_m + box_surface(size_m, _BOX_STEP_M)
    if not len(p_world) or not np.isfinite(p_world).all():
        raise MapError(f"abstract map: landmark {row.id} is at no finite place")
    return p_world
