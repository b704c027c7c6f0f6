"""DualMap's data association: looks plus overlap of clouds (DualMap III-B2, Eq 3 and 4)."""

from collections.abc import Sequence

import numpy as np

from seo_slam.association.two_stage import doubles
from seo_slam.geometry import FloatArray, transform_points
from seo_slam.interfaces import AssignmentSolver, Associator
from seo_slam.perception.cloud import Cloud, bounds_of
from seo_slam.settings.concrete import OverlapSettings
from seo_slam.types import NEW, REJECTED, Association, BoolArray, Estimate, IntArray, Landmarks, Observations

_ROUNDING = 1.0 + 1e-9
"""Boxes are grown by a little more than the distance, so that no point is lost to rounding; the distances decide."""

_MOST_SIMILAR = 2.0
"""Cosine 1 and overlap 1."""


def overlap_shares(observed: Sequence[FloatArray], landmarks: Sequence[Cloud], distance_m: float | FloatArray) -> FloatArray:
    """Return (K, N): the share of an observation's points whose nearest point of a landmark is closer than the distance. Exact.

    Pairs whose boxes do not come that near are 0 without a look; of the others, only points in the landmark's grown box are looked up, in
    the landmark's tree, which a ``Cloud`` keeps. Equal to the definition to the last digit.

    Args:
        observed: K clouds (M, 3), world frame, metres; an empty one has no share.
        landmarks: N clouds.
        distance_m: metres, or (K,) one an observation; a point exactly that far does not count.
    """
    K, N = len(observed), len(landmarks)
    shares = np.zeros((K, N))
    limit_m = np.broadcast_to(np.asarray(distance_m, dtype=np.float64), (K,))
    sizes = np.array([len(points) for points in observed], dtype=np.int64)
    known = np.array([n for n, cloud in enumerate(landmarks) if len(cloud)], dtype=np.int64)
    seen = np.flatnonzero(sizes)
    if not len(seen) or not len(known):
        return shares
    own = [observed[k] for k in seen.tolist()]
    low, high = np.array([bounds_of(points) for points in own]).transpose(1, 0, 2)
    bounds = np.array([landmarks[n].bounds for n in known])
    grown = limit_m[seen, None] * _ROUNDING
    touch = np.ones((len(seen), len(known)), dtype=np.bool_)
    for axis in range(3):
        touch &= (low - grown)[:, None, axis] <= bounds[:, 1, axis]
        touch &= (high + grown)[:, None, axis] >= bounds[:, 0, axis]
    for column in np.flatnonzero(touch.any(axis=0)):
        rows = np.flatnonzero(touch[:, column])
        n = int(known[column])
        counts = _counts_near([own[row] for row in rows], landmarks[n], limit_m[seen[rows]])
        shares[seen[rows], n] = counts / sizes[seen[rows]]
    return shares


def _counts_near(observed: Sequence[FloatArray], cloud: Cloud, limit_m: FloatArray) -> IntArray:
    """(R,) how many points of each are closer to the cloud than its limit: one question to the tree for all of them."""
    low, high = cloud.bounds
    chosen = [points[_inside(points, low - grown, high + grown)] for points, grown in zip(observed, limit_m * _ROUNDING, strict=True)]
    owners = np.repeat(np.arange(len(observed)), [len(points) for points in chosen])
    most_m = float(limit_m.max()) * _ROUNDING
    nearest_m, _ = cloud.tree.query(np.concatenate(chosen), distance_upper_bound=most_m, workers=1)
    return np.bincount(owners[nearest_m < limit_m[owners]], minlength=len(observed))


def _inside(points: FloatArray, low: FloatArray, high: FloatArray) -> BoolArray:
    inside = np.ones(len(points), dtype=np.bool_)
    for axis in range(3):
        column = points[:, axis]
        inside &= (column >= low[axis]) & (column <= high[axis])
    return inside


def cosines(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return (K, N) the cosine of each row of (K, D) with each of (N, D); 0 where one is all zeros."""
    return _unit(a) @ _unit(b).T


def _unit(rows: FloatArray) -> FloatArray:
    norm = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(norm > 0.0, norm, 1.0), dtype=np.float64)


class OverlapAssociator(Associator):
    """Matches by similarity, cosine plus overlap share (Eq 3), above a threshold (Eq 4); needs clouds of landmarks and observations.

    ``greedy`` is the paper's: each observation takes the landmark most like it, so that several may take one. ``one_to_one`` takes the
    matching with the most similarity above the threshold in total; what is left over is a new landmark, or nothing where its box lies in
    that of an observation which took a landmark that it could have taken as well.
    """

    def __init__(self, overlap: OverlapSettings | None = None, solver: AssignmentSolver | None = None) -> None:
        """Take the settings, and for ``one_to_one`` an assignment solver (default: scipy's)."""
        self._settings = overlap or OverlapSettings()
        self._solver = solver or _default_solver()

    def associate(self, observations: Observations, landmarks: Landmarks, estimate: Estimate) -> Association:
        """See ``interfaces.Associator``. The cost of a match is 2 - similarity; observations without a cloud are ``REJECTED``."""
        similarity = self.similarity(observations, landmarks, estimate)
        K, N = similarity.shape
        greedy = self._settings.assignment == "greedy"
        placed = np.array([len(cloud) > 0 for cloud in observations.clouds], dtype=np.bool_)
        allowed = (similarity > self._settings.threshold) & placed[:, None]
        columns = _most_similar(similarity, allowed) if greedy else self._assign(similarity, allowed)
        ids, costs = np.full(K, NEW, dtype=np.int64), np.full(K, np.nan)
        matched = np.flatnonzero(columns < N)
        ids[matched] = landmarks.ids[columns[matched]]
        costs[matched] = _MOST_SIMILAR - similarity[matched, columns[matched]]
        if not greedy:
            ids[doubles(observations, allowed, columns)] = REJECTED
        ids[~placed] = REJECTED
        return Association(landmark_ids=ids, costs=costs, shared=greedy)

    def similarity(self, observations: Observations, landmarks: Landmarks, estimate: Estimate) -> FloatArray:
        """Return (K, N) of Eq 3, from -1 to 2, by the predicted pose of the camera."""
        looks = cosines(observations.embeddings, landmarks.embeddings)
        if not landmarks.clouds:
            return looks
        observed = [transform_points(estimate.T_world_camera, cloud) for cloud in observations.clouds]
        return looks + overlap_shares(observed, landmarks.clouds, self._distances_m(observations.clouds))

    def _distances_m(self, clouds: Sequence[FloatArray]) -> FloatArray:
        """(K,) how near a point must be, by the median depth of each cloud (M, 3) in the camera frame."""
        range_m = np.array([np.median(cloud[:, 2]) if len(cloud) else 0.0 for cloud in clouds])
        return np.maximum(self._settings.distance_m, self._settings.noise_at_1m_m * range_m**2)

    def _assign(self, similarity: FloatArray, allowed: BoolArray) -> IntArray:
        """(K,) the column of each observation in the assignment of least cost, N or more for none: one private column each for that."""
        K, N = similarity.shape
        wanted = np.flatnonzero(allowed.any(axis=0))
        cost = np.full((K, len(wanted) + K), _FORBIDDEN)
        cost[:, : len(wanted)] = np.where(allowed[:, wanted], _MOST_SIMILAR - similarity[:, wanted], _FORBIDDEN)
        cost[np.arange(K), len(wanted) + np.arange(K)] = _MOST_SIMILAR - self._settings.threshold
        return np.concatenate([wanted, N + np.arange(K)])[self._solver.solve(cost)]


_FORBIDDEN = 1e6
"""Cost of a pair that must not be: far above any other."""


def _most_similar(similarity: FloatArray, allowed: BoolArray) -> IntArray:
    """(K,) the column most similar among those allowed, the first of equal ones; N where none is."""
    K, N = similarity.shape
    if not N:
        return np.zeros(K, dtype=np.int64)
    best = np.where(allowed, similarity, -np.inf).argmax(axis=1)
    return np.asarray(np.where(allowed[np.arange(K), best], best, N), dtype=np.int64)


def _default_solver() -> AssignmentSolver:
    from seo_slam.registry import create

    solver: AssignmentSolver = create("assignment_solver", "scipy")
    return solver
