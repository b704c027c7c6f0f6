"""All things of a map, by id, and how observations change what is known of them.

Positions and their covariances live in the smoother; the object map asks for them when it shows itself.
"""

from collections import Counter
from collections.abc import Collection

import numpy as np

from seo_slam.config import MapSettings
from seo_slam.errors import MapError, UnknownLandmarkError
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.interfaces import Smoother
from seo_slam.mapping.existence import Sightings
from seo_slam.mapping.observation_record import ObservationRecord
from seo_slam.mapping.thing import SURFACE_POINTS, SURFACE_VIEWS, Thing
from seo_slam.perception.boxes import containment
from seo_slam.perception.cloud import Cloud
from seo_slam.records import MapEvent
from seo_slam.settings.observing import CloudSettings
from seo_slam.types import IntArray, Landmark, Landmarks, Observations, heaviest

SIZES_KEPT = 50
"""Extents remembered of each thing; their median is its size."""

SEPARATE_CONTAINMENT = 0.3
"""Boxes that share less than this part of the smaller one are separate."""

LEAST_WEIGHT = 1e-3
"""A word weighs at least this, whatever its score: some detectors give none."""

HITS_RESTORED = 20
"""A stable landmark of a continued map is believed as if it had been found so often, or as often as it was."""


class ObjectMap:
    """All things, by id. Ids are never reused."""

    def __init__(self, settings: MapSettings, embedding_size: int, next_id: int = 0, clouds: CloudSettings | None = None) -> None:
        """Start empty; ``next_id`` is the first id to give. With ``clouds`` that are enabled, every observation's points are kept."""
        self.settings = settings
        self.clouds = clouds or CloudSettings()
        self._poses = np.zeros((0, 4, 4))
        self.embedding_size = embedding_size
        self.next_id = next_id
        self.things: dict[int, Thing] = {}
        self.seen_apart: Counter[tuple[int, int]] = Counter()

    def __contains__(self, landmark_id: int) -> bool:
        return landmark_id in self.things

    def __getitem__(self, landmark_id: int) -> Thing:
        if landmark_id not in self.things:
            raise UnknownLandmarkError(f"no landmark {landmark_id} in the map")
        return self.things[landmark_id]

    def restore(self, landmark: Landmark, T_world_camera: FloatArray | None = None) -> None:
        """Take over a landmark of a map that is continued; its words count as many observations as it had.

        Its points, where clouds are kept, are tied to the first camera at ``T_world_camera``.
        """
        T_first = np.eye(4) if T_world_camera is None else T_world_camera
        self._poses = T_first[None]
        self.things[landmark.id] = Thing(
            id=landmark.id,
            first_seen_s=landmark.first_seen_s,
            last_seen_s=landmark.last_seen_s,
            embedding_sum=landmark.embedding * landmark.observations,
            weights={word: share * landmark.observations for word, share in landmark.labels.items()},
            whole_sizes=[landmark.size_m.copy()],
            observations=landmark.observations,
            existence=landmark.existence,
            sightings=Sightings(hits=min(landmark.observations, HITS_RESTORED)) if landmark.state == "stable" else Sightings(),
            state=landmark.state,
            version=landmark.version,
            fixed_label=landmark.label if landmark.label and landmark.label != heaviest(landmark.labels) else None,
            fixed_category=landmark.category,
            record=ObservationRecord.restored(landmark, self.clouds, T_first) if self.clouds.enabled else None,
            surface_views=_surface_views(landmark.cloud_world, landmark.position_m),
        )
        self.next_id = max(self.next_id, landmark.id + 1)

    def new_ids(self, count: int) -> IntArray:
        """Give ``count`` fresh ids."""
        ids = np.arange(self.next_id, self.next_id + count, dtype=np.int64)
        self.next_id += count
        return ids

    def integrate(
        self,
        observations: Observations,
        landmark_ids: IntArray,
        T_world_camera: FloatArray,
        timestamp_s: float,
        p_world: FloatArray,
        poses: FloatArray | None = None,
        placed: bool = True,
    ) -> list[MapEvent]:
        """Fold one keyframe into the map.

        Args:
            observations: K rows.
            landmark_ids: (K,) the thing of each, all >= 0; new ids make new things.
            T_world_camera: (4, 4) of the keyframe.
            timestamp_s: of the keyframe.
            p_world: (K, 3) positions of the things.
            poses: (T, 4, 4) of all keyframes as they are estimated now, this one last; needed where clouds are kept.
            placed: False where the camera's pose is a guess (the odometry was lost): words and looks count, points and extents do not.
        """
        self._poses = np.asarray(T_world_camera)[None] if poses is None else poses
        events = []
        for row, landmark_id in enumerate(int(i) for i in landmark_ids):
            if landmark_id not in self.things:
                self.things[landmark_id] = Thing(landmark_id, timestamp_s, timestamp_s, np.zeros(self.embedding_size))
                events.append(MapEvent("created", landmark_id, observations.labels[row] or ""))
            thing = self.things[landmark_id]
            events += self._integrate_one(thing, observations, row, timestamp_s, placed)
            if placed:
                self._remember_shape(thing, observations, row, T_world_camera, p_world[row])
        self._count_apart(landmark_ids, observations.boxes_px)
        return events

    def _integrate_one(
        self,
        thing: Thing,
        observations: Observations,
        row: int,
        timestamp_s: float,
        placed: bool,
    ) -> list[MapEvent]:
        before = thing.label
        if self.clouds.enabled:
            thing.record = thing.record or ObservationRecord(self.clouds)
            keyframe, cloud = len(self._poses) - 1, observations.clouds[row] if placed else np.zeros((0, 3))
            thing.record.add(observations.labels[row], keyframe, observations.embeddings[row], cloud, self._poses)
        label, score = observations.labels[row], max(float(observations.scores[row]), LEAST_WEIGHT)
        if label:
            thing.weights[label] = thing.weights.get(label, 0.0) + score
            thing.embedding_sum = thing.embedding_sum + score * observations.embeddings[row]
        thing.observations += 1
        thing.last_seen_s = timestamp_s
        thing.changed()
        thing.is_background &= not thing.label
        events = []
        if before and thing.label != before:
            thing.version += 1
            events.append(MapEvent("relabelled", thing.id, f"{before} -> {thing.label}"))
        return events

    def is_confirmed(self, thing: Thing) -> bool:
        """Whether it was seen often and long enough to be stable."""
        known_s = thing.last_seen_s - thing.first_seen_s
        old_enough = known_s < 0 or known_s >= self.settings.stable_seconds - 1e-6  # below 0: the clock began anew with a continued map
        return old_enough and thing.observations >= self.settings.stable_observations

    def _remember_shape(self, thing: Thing, observations: Observations, row: int, T_world_camera: FloatArray, p_world: FloatArray) -> None:
        cloud = transform_points(T_world_camera, observations.clouds[row])
        if not len(cloud):
            return
        low, high = _inner_extent(cloud)
        cut = bool(observations.truncated[row].any())
        _keep_newest(thing.cut_sizes if cut else thing.whole_sizes, np.asarray(high - low, dtype=np.float64))
        if not cut:
            _keep_newest(thing.whole_across, observations.size_m[row])
        thing.surface_views = [*thing.surface_views[1 - SURFACE_VIEWS :], *_surface_views(cloud, p_world)]
        thing.changed()

    def _count_apart(self, landmark_ids: IntArray, boxes_px: FloatArray) -> None:
        """Count pairs that were detected at once in boxes of their own: proof that they are two."""
        inside = containment(boxes_px, boxes_px)
        for a, b in zip(*np.nonzero(np.triu(inside < SEPARATE_CONTAINMENT, k=1)), strict=True):
            low, high = sorted((int(landmark_ids[a]), int(landmark_ids[b])))
            if low != high:  # a landmark that several observations may share
                self.seen_apart[low, high] += 1

    def times_apart(self, a: int, b: int) -> int:
        """In how many keyframes two landmarks were detected at once, in separate boxes."""
        return self.seen_apart[min(a, b), max(a, b)]

    def sizes_m(self, landmark_ids: IntArray) -> FloatArray:
        """Return (K, 3) extents along the world's axes; 0 for things not in the map yet."""
        known = [self.things[int(i)].size_m() if int(i) in self.things else np.zeros(3) for i in landmark_ids]
        return np.array(known, dtype=np.float64).reshape(len(known), 3)

    def across_m(self, landmark_ids: IntArray) -> FloatArray:
        """Return (K, 2) the usual width and height across the line of sight of things; 0 for ones never seen whole, or new."""
        known = [self.things[int(i)].across_m() if int(i) in self.things else np.zeros(2) for i in landmark_ids]
        return np.array(known, dtype=np.float64).reshape(len(known), 2)

    def merge(self, keep_id: int, drop_id: int) -> None:
        """Fold what is known of ``drop_id`` into ``keep_id`` and forget the former."""
        keep, drop = self[keep_id], self[drop_id]
        for word, weight in drop.weights.items():
            keep.weights[word] = keep.weights.get(word, 0.0) + weight
        keep.embedding_sum = keep.embedding_sum + drop.embedding_sum
        keep.whole_sizes += drop.whole_sizes
        keep.cut_sizes += drop.cut_sizes
        keep.whole_across += drop.whole_across
        keep.observations += drop.observations
        keep.sightings = keep.sightings.merged(drop.sightings)
        keep.existence = max(keep.existence, drop.existence)
        if keep.record is not None and drop.record is not None:
            keep.record.absorb(drop.record, self._poses)
        keep.surface_views = (keep.surface_views + drop.surface_views)[-SURFACE_VIEWS:]
        keep.first_seen_s = min(keep.first_seen_s, drop.first_seen_s)
        keep.last_seen_s = max(keep.last_seen_s, drop.last_seen_s)
        if "stable" in (keep.state, drop.state):
            keep.state = "stable"
        keep.is_background &= drop.is_background
        if keep.fixed_label is None:
            keep.fixed_label, keep.fixed_embedding, keep.fixed_category = drop.fixed_label, drop.fixed_embedding, drop.fixed_category
        keep.version += 1
        keep.changed()
        for pair, times in list(self.seen_apart.items()):  # what is not the one is not the other
            if drop_id in pair and keep_id not in pair:
                low, high = sorted((keep_id, sum(pair) - drop_id))
                self.seen_apart[low, high] += times
        self.forget(drop_id)

    def split(self, landmark_id: int, new_id: int, words: Collection[str]) -> Thing:
        """Let a new thing take the observations of some words from one that was seen under several at once.

        Raises:
            UnknownLandmarkError: no such landmark.
            MapError: no clouds are kept, or it has no observation of these words, or no others.
        """
        thing = self[landmark_id]
        mine = set(thing.record.words) if thing.record is not None else set()
        if thing.record is None or not mine & set(words) or not mine - set(words):
            raise MapError(f"landmark {landmark_id}: seen as {sorted(mine)}, cannot be split by the words {sorted(words)}")
        new = Thing(new_id, thing.first_seen_s, thing.last_seen_s, np.zeros(self.embedding_size), record=thing.record.taken(words))
        new.weights = {word: weight for word, weight in thing.weights.items() if word in words}
        thing.weights = {word: weight for word, weight in thing.weights.items() if word not in words}
        thing.observations, new.observations = len(thing.record), len(new.record or ())
        new.existence, new.cov_world = thing.existence, thing.cov_world
        whole = thing.sightings
        for one in (thing, new):  # what was kept is of both together
            one.sightings = whole.of_a_part(one.observations)
            p_world = self.cloud(one).p_world
            middle = 0.5 * (p_world.min(axis=0) + p_world.max(axis=0)) if len(p_world) else np.zeros(3)
            one.surface_views, one.looks = _surface_views(p_world, middle), []
        for one in (thing, new):
            one.version += 1
            one.changed()
            one.is_background &= not one.label
        self.things[new_id] = new
        return new

    def rename(self, new_id: int, old: Thing) -> None:
        """Let the thing ``new_id`` go on as ``old``, which left the map: what was known of it still holds, but its place."""
        thing = self[new_id]
        apart = {sum(pair) - new_id: times for pair, times in self.seen_apart.items() if new_id in pair}
        self.forget(new_id)
        for word, weight in old.weights.items():
            thing.weights[word] = thing.weights.get(word, 0.0) + weight
        thing.embedding_sum = thing.embedding_sum + old.embedding_sum
        thing.observations += old.observations
        thing.first_seen_s = old.first_seen_s
        if thing.fixed_label is None:
            thing.fixed_label, thing.fixed_embedding, thing.fixed_category = old.fixed_label, old.fixed_embedding, old.fixed_category
        thing.id, thing.version = old.id, old.version + 1
        thing.changed()
        self.things[old.id] = thing
        for other, times in apart.items():
            self.seen_apart[min(other, old.id), max(other, old.id)] = times

    def forget(self, landmark_id: int) -> None:
        """Drop a thing; its id stays used."""
        del self.things[self[landmark_id].id]
        for pair in [pair for pair in self.seen_apart if landmark_id in pair]:
            del self.seen_apart[pair]

    def clouds_of_words(self, thing: Thing) -> dict[str, Cloud]:
        """Word -> the points that were seen under it, world frame; "" for those of no class."""
        record = thing.record
        return {} if record is None else {word: record.cloud_of(word, self._poses) for word in record.counts()}

    def relabel(self, landmark_id: int, label: str, embedding: FloatArray, category: str = "") -> None:
        """Set the label of a thing, its unit embedding (D,) and the plain word for it, whatever the detector says."""
        thing = self[landmark_id]
        thing.fixed_label, thing.fixed_embedding, thing.fixed_category = label, embedding, category
        thing.is_background &= not label
        thing.version += 1
        thing.changed()

    def rows(self, smoother: Smoother) -> list[Landmark]:
        """Show all landmarks, by rising id, with positions and covariances from the smoother."""
        ids, positions = smoother.positions()
        return self.rows_with(ids, positions, smoother.covariances(ids))

    def rows_with(self, ids: IntArray, p_world: FloatArray, cov_world: FloatArray) -> list[Landmark]:
        """Show landmarks (N,) at positions (N, 3) with covariances (N, 3, 3) that the caller already has."""
        return [self._row(int(i), p_world[n], cov_world[n]) for n, i in enumerate(ids)]

    def landmarks(self, smoother: Smoother) -> Landmarks:
        """Show all landmarks as a struct of arrays, for association.

        Their covariances are those last asked for: an associator takes the joint one, with the pose, from the estimate.
        """
        ids, positions = smoother.positions()
        things = [self[int(i)] for i in ids]
        return Landmarks(
            ids=ids,
            p_world=positions,
            cov_world=np.array([thing.cov_world for thing in things]).reshape(len(ids), 3, 3),
            size_m=np.array([thing.size_m() for thing in things]).reshape(len(ids), 3),
            labels=tuple(thing.distribution() for thing in things),
            embeddings=np.array([thing.embedding() for thing in things]).reshape(len(ids), self.embedding_size),
            observations=np.array([thing.observations for thing in things], dtype=np.int64),
            first_seen_s=np.array([thing.first_seen_s for thing in things], dtype=np.float64),
            last_seen_s=np.array([thing.last_seen_s for thing in things], dtype=np.float64),
            states=tuple(thing.state for thing in things),
            versions=np.array([thing.version for thing in things], dtype=np.int64),
            across_m=np.array([thing.across_m() for thing in things]).reshape(len(ids), 2),
            names=tuple(thing.label for thing in things),
            categories=tuple(thing.fixed_category for thing in things),
            clouds=tuple(self.cloud(thing) for thing in things) if self.clouds.enabled else (),
        )

    def cloud(self, thing: Thing) -> Cloud:
        """The points of a thing, world frame, as the poses of the last keyframe have it; none where no clouds are kept."""
        return thing.record.cloud(self._poses) if thing.record is not None else Cloud(np.zeros((0, 3)))

    def _row(self, landmark_id: int, p_world: FloatArray, cov_world: FloatArray) -> Landmark:
        thing = self[landmark_id]
        thing.cov_world = cov_world
        cloud = self.cloud(thing)
        size_m = thing.size_m()
        if len(cloud):  # the middle of all that was seen, not the mean of the middles of what each view showed
            low, high = cloud.inner_bounds
            p_world, size_m = 0.5 * (low + high), high - low
        return Landmark(
            id=landmark_id,
            label=thing.label,
            labels=thing.distribution(),
            position_m=p_world,
            covariance_m2=cov_world,
            size_m=size_m,
            embedding=thing.embedding(),
            observations=thing.observations,
            first_seen_s=thing.first_seen_s,
            last_seen_s=thing.last_seen_s,
            state=thing.state,
            version=thing.version,
            existence=thing.existence,
            category=thing.fixed_category,
            cloud_world=cloud.p_world,
        )


def _surface_views(p_world: FloatArray, middle: FloatArray) -> list[FloatArray]:
    """A sample of points (M, 3) relative to a middle (3,), as one view of a surface; none of no points."""
    if not len(p_world):
        return []
    return [p_world[np.linspace(0, len(p_world) - 1, SURFACE_POINTS).astype(np.int64)] - middle]


def _keep_newest(kept: list[FloatArray], new: FloatArray) -> None:
    kept.append(new)
    del kept[:-SIZES_KEPT]


def _inner_extent(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The lowest and highest coordinate (3,) each once 3 % of the points (M, 3) at either end are left out."""
    ordered = np.sort(points, axis=0)
    cut = int(0.03 * len(points))
    return ordered[cut], ordered[len(points) - 1 - cut]
