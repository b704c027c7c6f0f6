"""A landmark's list of observations: under which word, in which keyframe, with which points and feature (O of DualMap III-B)."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import islice, product
from typing import Self

import numpy as np

from seo_slam.geometry import FloatArray, inverse, transform_points
from seo_slam.mapping.keyframed_cloud import KeyframedCloud
from seo_slam.perception.cloud import Cloud, box_surface
from seo_slam.perception.voxels import cell_order, voxel_cells
from seo_slam.settings.observing import CloudSettings
from seo_slam.types import IntArray, Landmark

NULL = ""
"""The word of observations that have none: segments of no class."""

RESTORED = -1
"""Keyframe of an observation that was made before this run: the smoother holds no measurement of it."""

NOISE_SIGMAS = 3.0
"""``CloudSettings.noise_at_1m_m`` is so many standard deviations of the sensor's noise."""

_NO_POINTS = Cloud(np.zeros((0, 3)))


class ObservationRecord:
    """Observations of one landmark; points and features are kept summed up a word, so that it can be split by words.

    Attributes:
        words: the word of each observation, oldest first (after a merge: those of the one that stays first).
        keyframes: the number of the keyframe of each; ``RESTORED`` of those that a continued map knew of.
        last_keyframe: the newest of them.
        is_restored: it began in a map that is continued, or was joined with one that did.
    """

    def __init__(self, settings: CloudSettings) -> None:
        """Start with no observation; the settings say how dense clouds are."""
        self._settings = settings
        self.words: list[str] = []
        self.keyframes: list[int] = []
        self.last_keyframe = RESTORED
        self._counts: Counter[str] = Counter()  # of ``words``, which are many after hours
        self._joined: set[tuple[str, str]] = set()
        self._newest: _NewestWords | None = None  # of both lists; None: to be read off them
        self._clouds: dict[str, KeyframedCloud] = {}
        self._features: dict[str, FloatArray] = {}
        self.is_restored = False
        self._parts: list[Cloud] = []
        self._whole = _NO_POINTS

    @classmethod
    def restored(cls, landmark: Landmark, settings: CloudSettings, T_world_camera: FloatArray) -> Self:
        """Take over a landmark of a map that is continued; its points are tied to the first keyframe, at ``T_world_camera``.

        Each of its words gets its share of the observations and the look of the whole; the first one gets the points. What has none (a
        run that was killed leaves no clouds) is taken for its box.
        """
        record = cls(settings)
        record.is_restored = True
        counts = _counts_of(landmark.labels, landmark.observations) or {NULL: landmark.observations}
        record.words = [word for word, times in counts.items() for _ in range(times)]
        record.keyframes = [RESTORED] * len(record.words)
        for word, times in counts.items():  # which of its words looked how, and stood where, is not known any more
            record._counts[word] = times
            record._features[word], record._clouds[word] = landmark.embedding * times, record._empty()
        p_camera = transform_points(inverse(T_world_camera), _points_of(landmark, settings.voxel_m))
        record._clouds[next(iter(counts))].add(0, p_camera, T_world_camera[None])
        return record

    def __len__(self) -> int:
        return len(self.words)

    def add(self, word: str | None, keyframe: int, feature: FloatArray, p_camera: FloatArray, poses: FloatArray) -> None:
        """Append an observation.

        Args:
            word: what it was seen as; None for a segment of no class.
            keyframe: row of ``poses`` that it was seen from.
            feature: (D,) unit vector.
            p_camera: (M, 3) its points.
            poses: (T, 4, 4) all keyframes' ``T_world_camera``.
        """
        key = word or NULL
        self.words.append(key)
        self.keyframes.append(keyframe)
        self._counts[key] += 1
        if self._newest is not None and not self._newest.add(key, keyframe):
            self._newest = None
        self.last_keyframe = max(self.last_keyframe, keyframe)
        self._features[key] = self._features[key] + feature if key in self._features else feature.copy()
        self._clouds.setdefault(key, self._empty()).add(keyframe, p_camera, poses)

    def _empty(self) -> KeyframedCloud:
        return KeyframedCloud(self._settings.voxel_m, self._settings.noise_at_1m_m)

    def counts(self) -> Counter[str]:
        """How many observations each word has."""
        return self._counts.copy()

    def majority(self, alike_cosine: float = 1.0) -> float:
        """Share of the observations that go by the most frequent word, by one that is like it, or by one that a merge joined to it.

        Observations without a class are a class of their own, or abstain where enough others have one: ``CloudSettings.named_share``.

        Args:
            alike_cosine: features from which two words are taken for two names of one thing; 1: only the same word counts.
        """
        counts = self.counts()
        if self.is_nameless or not counts:
            return counts[NULL] / max(len(self.words), 1)
        if self._named_share() >= self._settings.named_share:
            counts.pop(NULL, None)
        top = max(counts, key=lambda word: (word != NULL, counts[word], word))
        alike = {word for word in counts.keys() - {top, NULL} if self.are_joined(word, top) or self._is_alike(word, top, alike_cosine)}
        return sum(counts[word] for word in alike | {top}) / sum(counts.values())

    @property
    def is_nameless(self) -> bool:
        """Whether it was mostly seen as nothing that has a word; a stray word or two is no name then."""
        most = max((times for word, times in self._counts.items() if word != NULL), default=0)
        return self._counts[NULL] > most and self._named_share() < self._settings.named_share

    def _named_share(self) -> float:
        return (len(self.words) - self._counts[NULL]) / max(len(self.words), 1)

    def _is_alike(self, word: str, other: str, alike_cosine: float) -> bool:
        """Whether what was seen under two words looks the same."""
        if alike_cosine >= 1.0:
            return False
        a, b = self._features[word], self._features[other]
        return float(a @ b / max(float(np.linalg.norm(a) * np.linalg.norm(b)), 1e-12)) >= alike_cosine

    def feature(self) -> FloatArray:
        """(D,) unit mean of all observations' features: averaging with the number of earlier observations as weight (III-B2)."""
        total = np.sum(list(self._features.values()), axis=0)
        norm = float(np.linalg.norm(total))
        return np.asarray(total / norm if norm > 0 else total, dtype=np.float64)

    def cloud(self, poses: FloatArray) -> Cloud:
        """The points of all observations, world frame; the same object until they change."""
        parts = [cloud.world(poses) for cloud in self._clouds.values() if len(cloud)]
        if len(parts) <= 1:
            return parts[0] if parts else _NO_POINTS
        if len(parts) != len(self._parts) or any(new is not old for new, old in zip(parts, self._parts, strict=True)):
            self._parts, self._whole = parts, Cloud(_one_a_voxel(parts, self._settings.voxel_m))
        return self._whole

    def blur_m(self) -> float:
        """How thick depth noise alone makes a surface seen from where this was: the extent of points spread evenly with its deviation.

        0 where that is not known: points of a continued map are tied to its first keyframe, wherever they were seen from.
        """
        first = 1 if self.is_restored else 0
        depths_m = np.concatenate([np.zeros(0), *(cloud.p_keyframe[cloud.keyframe >= first, 2] for cloud in self._clouds.values())])
        sigma_at_1m_m = self._settings.noise_at_1m_m / NOISE_SIGMAS
        return float(np.sqrt(12.0) * sigma_at_1m_m * np.median(depths_m) ** 2) if len(depths_m) else 0.0

    def seen_at_once(self, window: int) -> dict[tuple[str, str], int]:
        """In how many of the newest ``window`` keyframes two words (neither of them null, nor joined) were observed together."""
        if self._newest is None or self._newest.window < window:
            self._newest = _NewestWords(window, self.words, self.keyframes)
        pairs: Counter[tuple[str, str]] = Counter()
        for seen in self._newest.of_each(window):
            rising = sorted(seen - {NULL})
            pairs.update((a, b) for n, a in enumerate(rising) for b in rising[n + 1 :])
        return {pair: times for pair, times in pairs.items() if pair not in self._joined}

    def are_joined(self, a: str, b: str) -> bool:
        """Whether a merge said that what goes by one of the words is what goes by the other: it is not to be undone again and again."""
        return (min(a, b), max(a, b)) in self._joined

    def of_words(self, words: Collection[str]) -> IntArray:
        """(M,) which of the smoother's measurements of it are of these words, counted from 0."""
        measured = [word for word, keyframe in zip(self.words, self.keyframes, strict=True) if keyframe != RESTORED]
        return np.array([n for n, word in enumerate(measured) if word in words], dtype=np.int64)

    def cloud_of(self, word: str, poses: FloatArray) -> Cloud:
        """The points of the observations of one word."""
        return self._clouds[word].world(poses)

    def taken(self, words: Collection[str]) -> Self:
        """Move the observations of these words into a record of their own and return it."""
        out = type(self)(self._settings)
        pairs = list(zip(self.words, self.keyframes, strict=True))
        out.words, out.keyframes = [w for w, _ in pairs if w in words], [k for w, k in pairs if w in words]
        self.words, self.keyframes = [w for w, _ in pairs if w not in words], [k for w, k in pairs if w not in words]
        out._joined, out.is_restored = self._joined.copy(), self.is_restored
        self._recount()
        out._recount()
        for word in words:
            if word in self._clouds:
                out._clouds[word], out._features[word] = self._clouds.pop(word), self._features.pop(word)
        self._parts = []
        return out

    def absorb(self, other: Self, poses: FloatArray) -> None:
        """Append the observations of another record; its words and those that are here are joined from now on."""
        across = product(self._counts.keys() - {NULL}, other._counts.keys() - {NULL})
        self._joined |= other._joined | {(min(pair), max(pair)) for pair in across if pair[0] != pair[1]}
        self.is_restored |= other.is_restored
        self.words += other.words
        self.keyframes += other.keyframes
        self._recount()
        for word, cloud in other._clouds.items():
            own = self._clouds.get(word)
            self._clouds[word] = cloud if own is None else own.merged(cloud, poses)
            self._features[word] = self._features.get(word, 0.0) + other._features[word]
        self._parts = []

    def _recount(self) -> None:
        """Go through the lists, after other than an ``add`` changed them."""
        self._counts = Counter(self.words)
        self.last_keyframe = max(self.keyframes, default=RESTORED)
        self._newest = None


class _NewestWords:
    """Which words were seen in each of the newest keyframes of an observation list, kept up so that the whole list need not be read."""

    def __init__(self, window: int, words: Sequence[str], keyframes: Sequence[int]) -> None:
        """Read the newest ``window`` keyframes off the lists; those of a continued map are none."""
        self.window = window
        newest = sorted(set(keyframes) - {RESTORED})[-window:]
        self._words: dict[int, set[str]] = {keyframe: set() for keyframe in newest}
        for word, keyframe in zip(words, keyframes, strict=True):
            if keyframe in self._words:
                self._words[keyframe].add(word)

    def add(self, word: str, keyframe: int) -> bool:
        """Take one more observation; False if it is older than one before, and the lists must be read anew."""
        if self._words and keyframe < next(reversed(self._words)):
            return False
        self._words.setdefault(keyframe, set()).add(word)
        if len(self._words) > self.window:
            del self._words[next(iter(self._words))]
        return True

    def of_each(self, window: int) -> list[set[str]]:
        """The words of each of the newest ``window`` keyframes, at most as many as are kept."""
        return list(islice(reversed(self._words.values()), window))


def _counts_of(shares: Mapping[str, float], observations: int) -> dict[str, int]:
    """Word -> how many of the observations are of it, only words with one; they add up (by largest remainders)."""
    share = np.array(list(shares.values()), dtype=np.float64)
    if not share.sum() > 0:
        return {}
    exact = share / share.sum() * observations
    times = np.floor(exact).astype(np.int64)
    rest = observations - int(times.sum())
    times[np.argsort(times - exact, kind="stable")[:rest]] += 1
    return {word: int(n) for word, n in zip(shares, times, strict=True) if n}


def _points_of(landmark: Landmark, step_m: float) -> FloatArray:
    """The cloud (N, 3) of a landmark, world frame; points on its box where it has none."""
    p_world = np.asarray(landmark.cloud_world, dtype=np.float64).reshape(-1, 3)
    box_m = np.concatenate([landmark.position_m, landmark.size_m])
    if len(p_world) or not np.isfinite(box_m).all():
        return p_world
    return landmark.position_m + box_surface(landmark.size_m, step_m)


def _one_a_voxel(parts: Sequence[Cloud], voxel_m: float) -> FloatArray:
    """All points, but of those in one cube only the first."""
    points = np.concatenate([part.p_world for part in parts])
    order, starts = cell_order(voxel_cells(points, voxel_m))
    return np.asarray(points[np.sort(order[starts])])
