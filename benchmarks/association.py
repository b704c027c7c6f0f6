"""Data association against a plain double loop and against the dense problem, in one run. Prints one JSON object.

python benchmarks/association.py [--seed 0] [--worlds 4] [--rounds 20]

Ours is what the pipeline calls, ``TwoStageAssociator.associate``. The loop is the same gate and cost pair by pair, the way the equations
are written, then scipy on the whole K x (N + K) matrix; the careful loop computes nothing twice. The dense side does it in arrays, every
landmark with every observation. All ask the same estimate for the joint covariance, which is the smoother's to compute. Their matrices
must be equal, and so must the least total costs: the gap.
"""

import argparse
import json
import math
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded: all sides on one thread

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from seo_slam.association.candidates import candidate_rows
from seo_slam.association.costs import mahalanobis, predicted_measurements
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.association.two_stage import CLUTTER_PER_M3, FORBIDDEN, TwoStageAssociator
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.config import AssociationSettings
from seo_slam.geometry import FloatArray, exp, inverse, skew, transform_points
from seo_slam.perception.cut_boxes import completed
from seo_slam.run_files import versions
from seo_slam.types import Estimate, IntArray, Landmarks, Observations

SETTINGS = AssociationSettings()
THRESHOLD = float(chi2.ppf(SETTINGS.gate_probability, df=3))
WORDS = [
    "cup",
    "mug",
    "bowl",
    "bottle",
    "book",
    "notebook",
    "laptop",
    "keyboard",
    "mouse",
    "monitor",
    "tv",
    "chair",
    "stool",
    "table",
    "lamp",
    "plant",
    "vase",
    "clock",
    "phone",
    "remote",
    "plate",
    "fork",
    "knife",
    "shoe",
    "bag",
    "box",
    "toy",
    "ball",
    "cushion",
    "towel",
    "printer",
    "speaker",
    "radio",
    "kettle",
    "toaster",
    "pan",
    "jar",
    "can",
    "banana",
    "apple",
]
USUAL_PER_M2 = 1.0
"""Things a square metre of floor: the simulated rooms have 0.3 to 0.7."""
CROWDED_PER_M2 = 12.0
"""The same of a cluttered desk, over all the building."""
GROUP = 6
"""Things stand together, on a table or a shelf."""
AT_ONCE = 250
"""Landmarks a joint covariance is asked for at once by the dense side; of all it would take gigabytes."""


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """A map of N landmarks, K observations from the middle of it, and the estimate of that camera."""

    observations: Observations
    landmarks: Landmarks
    estimate: Estimate
    within_search: int


def make_world(K: int, N: int, things_per_m2: float, seed: int) -> World:
    """Draw groups of things over a square building, errors of the map and the camera, and what the camera then measures.

    Of the observations four in five are of the nearest landmarks before the camera, the others of something else nearby, one in eight
    is cut by the image border, one in ten boxes is a second one of the same thing.
    """
    rng = np.random.default_rng([seed, K, N, round(100 * things_per_m2)])
    side_m = math.sqrt(N / things_per_m2)
    groups = rng.uniform(0, side_m, (-(-N // GROUP), 2)).repeat(GROUP, axis=0)[:N]
    p_world = np.column_stack([groups + rng.uniform(-0.5, 0.5, (N, 2)), rng.uniform(0.7, 1.1, N)])
    level = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    T = np.eye(4)
    T[:3, 3] = side_m / 2, side_m / 2, 1.4
    T = T @ level
    estimate, J, drift, own = _uncertainty(T, p_world, rng)
    words = rng.integers(0, len(WORDS), (N, 2))
    labels = tuple({WORDS[a]: 0.7, WORDS[b]: 0.3} if a != b else {WORDS[a]: 1.0} for a, b in words)
    vectors = HashedEmbedder().embed_text(WORDS)
    landmarks = Landmarks(
        ids=np.arange(N, dtype=np.int64),
        p_world=p_world,
        cov_world=J @ drift @ J.transpose(0, 2, 1) + own,
        size_m=rng.uniform(0.05, 0.4, (N, 3)),
        labels=labels,
        embeddings=vectors[words[:, 0]],
        observations=np.full(N, 5),
        first_seen_s=np.zeros(N),
        last_seen_s=np.ones(N),
        states=("stable",) * N,
        versions=np.zeros(N, dtype=np.int64),
        across_m=rng.uniform(0.05, 0.4, (N, 2)) * (rng.random((N, 1)) < 0.7),
    )
    drifted = rng.multivariate_normal(np.zeros(6), drift)
    T_true = T @ exp(drifted + rng.multivariate_normal(np.zeros(6), _POSE_OWN))
    p_true = p_world + J @ drifted + np.einsum("nij,nj->ni", np.linalg.cholesky(own), rng.normal(size=(N, 3)))
    observations = _observe(K, transform_points(inverse(T_true), p_true), labels, vectors, rng)
    within = int((np.linalg.norm(p_world - T[:3, 3], axis=1) < SETTINGS.search_distance_m).sum())
    return World(observations, landmarks, estimate, within)


_IDENTITY = np.eye(6)
_POSE_OWN = np.diag([0.004] * 3 + [0.01] * 3) ** 2


def _uncertainty(T: FloatArray, p_world: FloatArray, rng: np.random.Generator) -> tuple[Estimate, FloatArray, FloatArray, FloatArray]:
    """An estimate whose joint covariance is a drift shared by the camera and the map, and what each errs on its own.

    Also the (N, 3, 6) Jacobians by which the drift (6, 6) moves the landmarks, and their own covariances (N, 3, 3).
    """
    drift = np.diag([0.01] * 3 + [0.05] * 3) ** 2
    root = rng.normal(0, 0.012, (len(p_world), 3, 3))
    own = root @ root.transpose(0, 2, 1) + 0.005**2 * np.eye(3)
    p_camera = transform_points(inverse(T), p_world)
    J = np.array([np.hstack([-T[:3, :3] @ skew(p), T[:3, :3]]) for p in p_camera]).reshape(-1, 3, 6)
    pose = drift + _POSE_OWN
    J /= 1.0 + np.linalg.norm(p_camera, axis=1)[:, None, None] / 4.0  # far things share less of this camera's drift

    def joint_covariance(landmark_ids: IntArray) -> FloatArray:
        m = len(landmark_ids)
        if not m:
            return pose.copy()
        carried = np.concatenate([_IDENTITY, J[landmark_ids].reshape(3 * m, 6)])
        joint = carried @ drift @ carried.T
        joint[:6, :6] += _POSE_OWN
        joint[6:, 6:].reshape(m, 3, m, 3)[np.arange(m), :, np.arange(m), :] += own[landmark_ids]
        return joint

    return Estimate(T, joint_covariance), J, drift, own


def _observe(
    K: int, p_camera: FloatArray, labels: tuple[dict[str, float], ...], vectors: FloatArray, rng: np.random.Generator
) -> Observations:
    """Measure K things of those at p_camera (N, 3)."""
    range_m = np.where(p_camera[:, 2] > 0.4, np.linalg.norm(p_camera, axis=1), np.inf)
    seen = np.argsort(range_m)[: round(0.8 * K)]
    seen = seen[np.isfinite(range_m[seen])]
    others = p_camera[rng.choice(seen, K - len(seen))] + rng.uniform(-0.5, 0.5, (K - len(seen), 3)) * [1, 1, 0.5]
    words = [str(rng.choice(list(labels[n]))) if rng.random() < 0.8 else str(rng.choice(WORDS)) for n in seen]
    words += [str(word) for word in rng.choice(WORDS, len(others))]
    true = np.vstack([p_camera[seen], others])
    sigma = np.column_stack([np.full((K, 2), 0.015), 0.02 + 0.0019 * true[:, 2] ** 2])
    middle = 260.0 * true[:, :2] / np.maximum(true[:, 2:], 0.4) + [320, 240]
    half = 260.0 * rng.uniform(0.03, 0.2, (K, 2)) / np.maximum(true[:, 2:], 0.4)
    p_seen = true + sigma * rng.normal(size=(K, 3))
    twice = K // 10
    p_seen[K - twice :], middle[K - twice :], half[K - twice :] = p_seen[:twice] + 0.01, middle[:twice], 0.95 * half[:twice]
    return Observations(
        p_camera=p_seen,
        cov_camera=np.einsum("ki,ij->kij", sigma**2, np.eye(3)),
        size_m=rng.uniform(0.05, 0.3, (K, 2)),
        labels=tuple(words),
        scores=np.full(K, 0.8),
        embeddings=vectors[[WORDS.index(word) for word in words]],
        boxes_px=np.hstack([middle - half, middle + half]),
        truncated=(rng.random((K, 1)) < 0.125) & (np.arange(4) == rng.integers(0, 4, (K, 1))),
        clouds=(np.zeros((0, 3)),) * K,
        rows=np.arange(K, dtype=np.int64),
    )


def loop_matrix(world: World, likelihood: LabelLikelihood) -> FloatArray:
    """The K x (N + K) cost matrix by a plain double loop: range, prediction (Eq 2), gate (Eq 4, 7) and label, pair after pair.

    Only the joint covariance is asked for once, of all landmarks within the search distance, and sliced for each pair.
    """
    seen, known, T = world.observations, world.landmarks, world.estimate.T_world_camera
    K, N = len(seen), len(known)
    R, t = T[:3, :3], T[:3, 3]
    place, joint = _joint_within_search(world)
    cost = np.full((K, N + K), FORBIDDEN)
    for k in range(K):
        cost[k, N + k] = 0.0
        p_seen, gamma = _whole(world, k)
        for n in range(N):
            if np.linalg.norm(known.p_world[n] - t) >= SETTINGS.search_distance_m:
                continue
            p, covariance = _predicted(R, t, known.p_world[n], joint, place[n])
            log_odds = _log_odds(world, likelihood, k, n, p, covariance, p_seen[n], gamma[n])
            if log_odds > 0:
                cost[k, n] = -2.0 * log_odds
    return cost


def careful_loop_matrix(world: World, likelihood: LabelLikelihood) -> FloatArray:
    """The same by a loop that predicts each landmark once, and looks at those within the search distance only."""
    seen, known, T = world.observations, world.landmarks, world.estimate.T_world_camera
    K, N = len(seen), len(known)
    R, t = T[:3, :3], T[:3, 3]
    place, joint = _joint_within_search(world)
    predicted = [(n, *_predicted(R, t, known.p_world[n], joint, at)) for n, at in place.items()]
    cost = np.full((K, N + K), FORBIDDEN)
    for k in range(K):
        cost[k, N + k] = 0.0
        p_seen, gamma = _whole(world, k)
        for n, p, covariance in predicted:
            log_odds = _log_odds(world, likelihood, k, n, p, covariance, p_seen[n], gamma[n])
            if log_odds > 0:
                cost[k, n] = -2.0 * log_odds
    return cost


def _joint_within_search(world: World) -> tuple[dict[int, int], FloatArray]:
    """Landmarks within the search distance and their places in the joint covariance, which is the smoother's work."""
    far = np.linalg.norm(world.landmarks.p_world - world.estimate.T_world_camera[:3, 3], axis=1) >= SETTINGS.search_distance_m
    near = np.flatnonzero(~far)
    return {int(n): place for place, n in enumerate(near)}, world.estimate.joint_covariance(world.landmarks.ids[near])


def _predicted(R: FloatArray, t: FloatArray, p_world: FloatArray, joint: FloatArray, place: int) -> tuple[FloatArray, FloatArray]:
    """Eq 2 and ``H Sigma H^T`` of Eq 4 for one landmark."""
    p = R.T @ (p_world - t)
    H = np.hstack([skew(p), -np.eye(3), R.T])
    rows = [*range(6), *range(6 + 3 * place, 9 + 3 * place)]
    return p, H @ joint[np.ix_(rows, rows)] @ H.T


def _whole(world: World, k: int) -> tuple[FloatArray, FloatArray]:
    """The measurement of an observation for every landmark: (N, 3) and (N, 3, 3), completed if the image cuts its box."""
    seen, N = world.observations, len(world.landmarks)
    if not seen.truncated[k].any():
        return np.broadcast_to(seen.p_camera[k], (N, 3)), np.broadcast_to(seen.cov_camera[k], (N, 3, 3))
    return completed(seen.p_camera[k], seen.cov_camera[k], seen.size_m[k], seen.truncated[k], world.landmarks.across_m)


def _log_odds(
    world: World,
    likelihood: LabelLikelihood,
    k: int,
    n: int,
    p: FloatArray,
    covariance: FloatArray,
    p_seen: FloatArray,
    gamma: FloatArray,
) -> float:
    """What a pair gains over a new landmark; minus infinity if the first gate refuses it."""
    C = covariance + gamma
    innovation = p_seen - p
    squared = float(innovation @ np.linalg.solve(C, innovation))
    if squared >= THRESHOLD:
        return -math.inf
    log_det = float(np.linalg.slogdet(2.0 * np.pi * C)[1])
    log_ratio = likelihood.log_ratio(world.observations.labels[k], world.landmarks.labels[n])
    return log_ratio - 0.5 * (squared + log_det) - math.log(CLUTTER_PER_M3)


def dense_matrix(world: World, likelihood: LabelLikelihood) -> FloatArray:
    """The same matrix in arrays: every landmark of the map is predicted and compared, and only then those too far away are struck out."""
    seen, known, estimate = world.observations, world.landmarks, world.estimate
    K, N = len(seen), len(known)
    cost = np.full((K, N + K), FORBIDDEN)
    cost[np.arange(K), N + np.arange(K)] = 0.0
    near = np.linalg.norm(known.p_world - estimate.T_world_camera[:3, 3], axis=1) < SETTINGS.search_distance_m
    for start in range(0, N, AT_ONCE):
        part = known[np.arange(start, min(start + AT_ONCE, N))]
        squared, log_det = mahalanobis(seen, part, *predicted_measurements(estimate, part))
        for k, n in zip(*np.nonzero((squared < THRESHOLD) & near[start : start + AT_ONCE]), strict=True):
            log_ratio = likelihood.log_ratio(seen.labels[k], part.labels[n])
            log_odds = log_ratio - 0.5 * (squared[k, n] + log_det[k, n]) - math.log(CLUTTER_PER_M3)
            if log_odds > 0:
                cost[k, start + n] = -2.0 * log_odds
    return cost


def solved(cost: FloatArray) -> float:
    """The least total cost, by scipy on the whole matrix."""
    return float(cost[linear_sum_assignment(cost)].sum())


@dataclass(frozen=True, slots=True)
class Size:
    """K observations, N landmarks, and how densely these stand."""

    K: int
    N: int
    things_per_m2: float


def compare(size: Size, seed: int, ours: TwoStageAssociator, likelihood: LabelLikelihood) -> tuple[World, FloatArray, dict[str, float]]:
    """Check that all sides agree on one world; return it, its dense matrix, and what is in it.

    Raises:
        AssertionError: the loops and the dense side have different cost matrices.
    """
    world = make_world(size.K, size.N, size.things_per_m2, seed)
    loop, dense = loop_matrix(world, likelihood), dense_matrix(world, likelihood)
    np.testing.assert_allclose(loop, dense, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(careful_loop_matrix(world, likelihood), dense, rtol=1e-9, atol=1e-9)
    found = ours.associate(world.observations, world.landmarks, world.estimate)
    near = candidate_rows(world.observations, world.landmarks, world.estimate, SETTINGS.search_distance_m, THRESHOLD)
    content = {
        "within_search_distance": world.within_search,
        "candidates": len(near),
        "allowed_pairs": int((dense[:, : size.N] < FORBIDDEN).sum()),
        "matched": int((found.landmark_ids >= 0).sum()),
        "gap": abs(float(np.nansum(found.costs)) - solved(dense)),
    }
    return world, dense, content


def measure(sizes: list[Size], seeds: range, rounds: int, slow_rounds: int) -> list[dict[str, float]]:
    """Measure every size on the worlds of all seeds, taking turns.

    Times are medians over the rounds, then means over the worlds; ratios are of these.
    """
    likelihood = LabelLikelihood(HashedEmbedder())
    ours = TwoStageAssociator(SETTINGS, likelihood=likelihood)
    rows: list[dict[str, float]] = []
    for seed in seeds:
        made = [(*compare(size, seed, ours, likelihood), _timings()) for size in sizes]
        for turn in range(rounds):
            for world, dense, _, times in made:
                _time_round(world, dense, ours, likelihood, times, slow=turn < slow_rounds)
        for size, (_, _, content, times) in zip(sizes, made, strict=True):
            rows.append({**asdict(size), **content, **{f"{side}_ms": 1e3 * statistics.median(values) for side, values in times.items()}})
    return [_over_worlds([row for row in rows if all(row[key] == value for key, value in asdict(size).items())]) for size in sizes]


def _timings() -> dict[str, list[float]]:
    return {"ours": [], "loop": [], "careful_loop": [], "dense": [], "dense_solve": []}


def _time_round(
    world: World, dense: FloatArray, ours: TwoStageAssociator, likelihood: LabelLikelihood, times: dict[str, list[float]], slow: bool
) -> None:
    """Measure every side once, of ours the best of three: the first one finds the caches full of the others' arrays."""
    times["ours"].append(min(seconds(lambda: ours.associate(world.observations, world.landmarks, world.estimate)) for _ in range(3)))
    times["dense_solve"].append(seconds(lambda: solved(dense)))
    if slow:
        times["loop"].append(seconds(lambda: solved(loop_matrix(world, likelihood))))
        times["careful_loop"].append(seconds(lambda: solved(careful_loop_matrix(world, likelihood))))
        times["dense"].append(seconds(lambda: solved(dense_matrix(world, likelihood))))


def _over_worlds(rows: list[dict[str, float]]) -> dict[str, float]:
    """Of one size: means of times and counts, the largest gap, and ratios."""
    out = {key: round(statistics.fmean(row[key] for row in rows), 4) for key in rows[0]}
    out["K"], out["N"] = int(rows[0]["K"]), int(rows[0]["N"])
    out["gap"] = max(row["gap"] for row in rows)
    for side in ("loop", "careful_loop", "dense", "dense_solve"):
        out[f"{side}_over_ours"] = round(out[f"{side}_ms"] / out["ours_ms"], 2)
    return out


def seconds(call: Callable[[], object]) -> float:
    """Processor time of one call: other processes do not count."""
    start = time.thread_time()
    call()
    return time.thread_time() - start


def main() -> None:
    """Measure, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the first world")
    parser.add_argument("--worlds", type=int, default=4, help="of each size")
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--slow-rounds", type=int, default=2, help="rounds in which the loops and the dense side are measured, too")
    given = parser.parse_args()
    usual = [Size(K, N, USUAL_PER_M2) for K in (20, 50) for N in (300, 1000, 3000, 10000)]
    crowded = [Size(K, N, CROWDED_PER_M2) for K in (20, 50) for N in (300, 1000)]
    rows = measure([*usual, *crowded], range(given.seed, given.seed + given.worlds), given.rounds, given.slow_rounds)
    by = {(row["K"], row["N"]): row for row in rows if row["things_per_m2"] == USUAL_PER_M2}
    print(
        json.dumps(
            {
                "what": "gate, costs and assignment of K observations and N landmarks; milliseconds of processor time, one thread",
                "seed": given.seed,
                "worlds": given.worlds,
                "rows": rows,
                "claims": {
                    "loop_over_ours_K20_N300": by[20, 300]["loop_over_ours"],
                    "N10000_over_N300": max(round(by[K, 10000]["ours_ms"] / by[K, 300]["ours_ms"], 2) for K in (20, 50)),
                    "max_gap": max(row["gap"] for row in rows),
                },
                "versions": versions(),
            },
            indent=1,
        )
    )


if __name__ == "__main__":
    main()
