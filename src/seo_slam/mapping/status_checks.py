"""DualMap's checks of each object by itself, in place of merging in 3D: stability and splitting (III-B3)."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from seo_slam.association.overlap import overlap_shares
from seo_slam.config import LifeSettings
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder, Smoother
from seo_slam.mapping.edits import merge_landmarks
from seo_slam.mapping.object_map import ObjectMap
from seo_slam.mapping.sight import DepthView
from seo_slam.mapping.thing import Thing
from seo_slam.mapping.watch import Watch, found_share
from seo_slam.perception.cloud import Cloud
from seo_slam.records import MapEvent
from seo_slam.settings.concrete import StatusSettings
from seo_slam.types import IntArray

SOURCE = "status check"

LEAST_GAP_M = 1e-6
"""Without any gap a flat box would have no volume to take a share of."""


class StatusChecks:
    """Decides about a landmark from the distribution of the words in its observation list, and from where it was missed (existence)."""

    def __init__(
        self,
        settings: StatusSettings,
        object_map: ObjectMap,
        embedder: Embedder,
        watch: Watch | None = None,
        life: LifeSettings | None = None,
    ) -> None:
        """Check the things of ``object_map``, which must keep clouds.

        Args:
            settings: of the checks.
            object_map: its things.
            embedder: knows what background looks like.
            watch: keeps existence, which is then checked as well; None: the paper.
            life: what existence must be.
        """
        self._settings = settings
        self._watch = watch
        self._life = life or LifeSettings()
        self._embedder = embedder
        self._map = object_map
        self._keyframe = -1
        self._last_seen: dict[int, int] = {}
        self._passed: dict[int, int] = {}  # with how many observations what is silent has passed

    def step(self, view: DepthView, hits: IntArray, smoother: Smoother) -> list[MapEvent]:
        """Check what was seen in a keyframe, and what has not been seen for long.

        Args:
            view: the keyframe; without existence only its stamp is looked at.
            hits: ids of the landmarks observed in it.
            smoother: landmarks that are split or leave the map do so there, too.

        Returns:
            What became stable, was lost, split, merged or removed.
        """
        self._keyframe += 1
        seen = [i for i in dict.fromkeys(hits.tolist()) if i in self._map]
        for landmark_id in (*seen, *(i for i in self._map.things if i not in self._last_seen)):
            self._last_seen[landmark_id] = self._keyframe
        events: list[MapEvent] = []
        if self._watch is not None:
            for thing, p_world in self._watch.step(view, hits, smoother):
                events += self._missed(thing, p_world, view.timestamp_s, smoother)
        if self._settings.split:
            events += [event for landmark_id in seen for event in self._split(self._map[landmark_id], smoother)]
        events += [event for landmark_id in seen for event in self._becomes_stable(self._map[landmark_id])]
        if self._settings.fold:
            events += self._fold_doubles([i for i in seen if i in self._map], smoother)
        events += self._check_silent(view.timestamp_s, smoother)
        if self._settings.merge and self._keyframe % self._settings.merge_every == 0:
            events += self._merge_overlapping(smoother)
        return events

    def passes(self, thing: Thing) -> bool:
        """Whether a thing was observed often enough, and mostly as one and the same (the paper's stability check)."""
        record, settings = thing.record, self._settings
        if record is None or len(record) < settings.observations:
            return False
        return record.majority(settings.alike_cosine) >= settings.majority - 1e-9

    def _becomes_stable(self, thing: Thing) -> list[MapEvent]:
        if thing.state == "stable" or thing.is_background or not self.passes(thing) or self._is_judged_background(thing):
            return []
        if self._watch is None:
            thing.existence = 1.0
        elif thing.existence < self._life.stable_existence or found_share(thing) < self._life.stable_share:
            return []
        was_lost, thing.state = thing.state == "lost", "stable"
        thing.version += 1
        return [MapEvent("found" if was_lost else "stable", thing.id, thing.label)]

    def _missed(self, thing: Thing, p_world: FloatArray, now_s: float, smoother: Smoother) -> list[MapEvent]:
        """Lose, then remove what is not seen where it should be (ours; the paper counts no misses)."""
        life = self._life
        if thing.state == "stable" and thing.existence < life.lost_existence:
            thing.state = "lost"
            thing.version += 1
            return [MapEvent("lost", thing.id, thing.label)]
        if thing.is_background or thing.existence >= life.removed_existence or thing.sightings.tail < life.removed_misses:
            return []
        if 0 <= now_s - thing.last_seen_s < life.removed_seconds:  # below 0: the clock began anew
            return []
        if self._watch is not None:
            self._watch.bury(thing, p_world)
        return [self._remove(thing, smoother)]

    def _is_judged_background(self, thing: Thing) -> bool:
        """Whether it is no thing; that is judged once, and again when it got a name and lost it."""
        thing.is_background = thing.is_background or (not thing.label and self._is_background(thing))
        return thing.is_background

    def _is_background(self, thing: Thing) -> bool:
        """Whether something without a word is no thing: a flat piece of a surface, or what looks more like wall than like anything said.

        Segmenters cut walls and floors into pieces wherever furniture stands before them, and the pictures of such pieces show the
        furniture. By now the errors of single views have averaged out, of the points as well as of the looks. What is no thing stays
        in the map while it is seen, never stable: were it removed, the next view of it would make another one.
        """
        p_world, flat_m = self._map.cloud(thing).p_world, self._settings.flat_m
        blur_m = 0.0 if thing.record is None else thing.record.blur_m()
        if flat_m > 0 and len(p_world) and thickness_m(p_world) <= max(flat_m, blur_m):
            return True
        said = sorted({word for other in self._map.things.values() for word in other.weights})
        if not said or not self._settings.background:
            return False
        near = self._embedder.embed_text(list(self._settings.background)) @ thing.embedding()
        return bool(near.max() > (self._embedder.embed_text(said) @ thing.embedding()).max())

    def _remove(self, thing: Thing, smoother: Smoother) -> MapEvent:
        smoother.remove(thing.id)
        self._map.forget(thing.id)
        self._last_seen.pop(thing.id, None)
        self._passed.pop(thing.id, None)
        return MapEvent("removed", thing.id, thing.label, SOURCE)

    def _check_silent(self, now_s: float, smoother: Smoother) -> list[MapEvent]:
        """Remove what is not seen any more and does not pass, or is no thing; what passes is not asked again until it is seen."""
        events = []
        for landmark_id, last in list(self._last_seen.items()):
            if landmark_id not in self._map:
                del self._last_seen[landmark_id]
                self._passed.pop(landmark_id, None)
                continue
            thing = self._map[landmark_id]
            newest = last if thing.record is None else max(last, thing.record.last_keyframe)  # also of what was merged into it
            long_ago = self._keyframe - newest > self._settings.silent_keyframes
            waits = 0 <= now_s - thing.last_seen_s < self._settings.silent_seconds  # below 0: the clock began anew
            if long_ago and not waits and not self._stays(thing):
                events.append(self._remove(thing, smoother))
        return events

    def _stays(self, thing: Thing) -> bool:
        """Whether something silent passes, and is a thing; what only an observation can change is remembered."""
        if self._passed.get(thing.id) == thing.observations or _was_trusted(thing):
            return True
        if not self.passes(thing) or (thing.state != "stable" and self._is_judged_background(thing)):
            return False
        self._passed[thing.id] = thing.observations
        return True

    def _split(self, thing: Thing, smoother: Smoother) -> list[MapEvent]:
        """Part a thing that was seen under two words at once in many of the newest keyframes."""
        record = thing.record
        if record is None:
            return []
        together = record.seen_at_once(self._settings.window_keyframes)
        often = [pair for pair, times in together.items() if times > self._settings.split_keyframes]
        if not often:
            return []
        pair = max(often, key=lambda two: (together[two], two))
        counts = record.counts()
        stays, goes = sorted(pair, key=lambda word: (-counts[word], word))
        words = {goes, *(word for word in counts if word not in pair and self._goes_with(thing, word, goes, stays))}
        moved = record.of_words(words)
        if not len(moved) or len(moved) == len(record.of_words(set(counts))):  # a continued map's part has no measurement of its own
            return []
        new_id = int(self._map.new_ids(1)[0])
        smoother.split(thing.id, new_id, moved)
        new = self._map.split(thing.id, new_id, words)
        self._last_seen[new_id] = self._keyframe
        new.last_seen_s = thing.last_seen_s
        return [MapEvent("split", new_id, f"{thing.label} | {new.label}", SOURCE, other_id=thing.id)]

    def _goes_with(self, thing: Thing, word: str, goes: str, stays: str) -> bool:
        """Whether a word (or none) goes with one side of a split: it was joined to that one alone, or its points overlap more with it."""
        joined = [thing.record is not None and thing.record.are_joined(word, side) for side in (goes, stays)]
        if joined[0] != joined[1]:
            return joined[0]
        clouds = self._map.clouds_of_words(thing)
        shares = overlap_shares([clouds[word].p_world], [clouds[goes], clouds[stays]], self._settings.merge_distance_m)[0]
        return bool(shares[0] > shares[1])

    def _fold_doubles(self, seen: Sequence[int], smoother: Smoother) -> list[MapEvent]:
        """Make one of two landmarks that are two sides of a thing (ours; the paper leaves them two).

        Seen from another side, a thing shows other points: the overlap is small, and it comes twice. Two sides look alike, touch, and are
        never detected at once, whereas two things side by side sooner or later are. Boxes are compared, never points.
        """
        clouds = {thing.id: self._map.cloud(thing) for thing in self._map.things.values() if not thing.is_background}
        things = [self._map[landmark_id] for landmark_id, cloud in clouds.items() if len(cloud)]
        if len(things) < 2:
            return []
        bounds = np.array([clouds[thing.id].inner_bounds for thing in things])
        looks = np.array([thing.embedding() for thing in things])
        seen_now, gone = set(seen), set[int]()
        events = []
        for row in [n for n, thing in enumerate(things) if thing.id in seen_now]:
            inside = shared_share(bounds[row], bounds, self._settings.fold_gap_m)
            alike = looks @ looks[row] >= self._settings.fold_cosine
            for other in np.flatnonzero((inside >= self._settings.fold_share) & alike):
                keep, drop = sorted((things[row], things[other]), key=lambda thing: (-thing.observations, thing.id))
                if keep is drop or {keep.id, drop.id} & gone or not self._are_one(keep, drop):
                    continue
                gone.add(drop.id)
                events.append(merge_landmarks(keep.id, drop.id, self._map, smoother, SOURCE))
        return events

    def _are_one(self, keep: Thing, drop: Thing) -> bool:
        """Whether both are known well enough to say so, were never seen apart, and mostly go by one word."""
        enough = drop.observations >= self._map.settings.stable_observations
        apart = self._map.times_apart(keep.id, drop.id) >= self._map.settings.separate_frames
        words = {thing.label for thing in (keep, drop)} - {""}
        return enough and not apart and len(words) == 1

    def _merge_overlapping(self, smoother: Smoother) -> list[MapEvent]:
        """Fold landmarks whose clouds overlap: connected components of pairs, each into its most observed one."""
        things = [thing for thing in self._map.things.values() if thing.record is not None and not thing.is_background]
        clouds = [self._map.cloud(thing) for thing in things]
        events = []
        for group in _groups(self._pairs(clouds), len(things)):
            first, *others = sorted((things[n] for n in group), key=lambda thing: (-thing.observations, thing.id))
            events += [merge_landmarks(first.id, other.id, self._map, smoother, SOURCE) for other in others]
        return events

    def _pairs(self, clouds: Sequence[Cloud]) -> list[tuple[int, int]]:
        if not clouds:
            return []
        points: list[FloatArray] = [cloud.p_world for cloud in clouds]
        share = overlap_shares(points, clouds, self._settings.merge_distance_m)
        either = np.triu(np.maximum(share, share.T), k=1) > self._settings.merge_overlap
        return [(int(a), int(b)) for a, b in zip(*np.nonzero(either), strict=True)]


def _was_trusted(thing: Thing) -> bool:
    """Whether a continued map holds it for stable, by whatever rules: to see it no more is no reason to doubt it."""
    return thing.state == "stable" and thing.record is not None and thing.record.is_restored


def thickness_m(p_world: FloatArray) -> float:
    """Extent of points (M, 3) across the plane that fits them best, as of points spread evenly."""
    if len(p_world) < 3:
        return 0.0
    return float(np.sqrt(12.0 * max(float(np.linalg.eigvalsh(np.cov(p_world.T))[0]), 0.0)))


def shared_share(box: FloatArray, others: FloatArray, gap_m: float) -> FloatArray:
    """Return (N,) the share of the smaller of two boxes that lies in the other one, both grown by ``gap_m``: of (2, 3) with (N, 2, 3).

    They are grown by ``LEAST_GAP_M`` at least, so that a flat box has a share of its area, and a point is in a box or not.
    """
    gap_m = max(gap_m, LEAST_GAP_M)
    low = np.maximum(box[0], others[:, 0]) - gap_m
    high = np.minimum(box[1], others[:, 1]) + gap_m
    common = np.prod(np.maximum(high - low, 0.0), axis=1)
    volume = np.prod(others[:, 1] - others[:, 0] + 2.0 * gap_m, axis=1)
    return np.asarray(common / np.minimum(volume, float(np.prod(box[1] - box[0] + 2.0 * gap_m))), dtype=np.float64)


def _groups(pairs: Sequence[tuple[int, int]], count: int) -> list[list[int]]:
    """Connected components of more than one member."""
    rows = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows[:, 0], rows[:, 1])), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    groups = [np.flatnonzero(part == label).tolist() for label in np.unique(part[rows])]
    return [group for group in groups if len(group) > 1]
