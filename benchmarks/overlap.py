"""Overlap of observations with the map, against the published way, in one run. Prints one JSON object.

python benchmarks/overlap.py [--seed 0] [--rounds 5]

A room of 300 boxes on a grid, 2,000 points of the surface of each, about one every 2.5 cm, and 20 of them seen again. The published way
makes a flat index (brute force) of every pair whose boxes touch; with faiss, as published, if ``pip install faiss-cpu`` was done, else
with numpy in double precision. Ours is what the pipeline calls, ``overlap_shares``, with the trees that the map keeps, and with all trees
built anew. The matrices must equal brute force in double precision; faiss counts in single precision.
"""

import argparse
import importlib.util
import json
import os
import statistics
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded: all sides on one thread
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from seo_slam.association.overlap import overlap_shares
from seo_slam.geometry import FloatArray
from seo_slam.perception.cloud import Cloud
from seo_slam.run_files import versions
from seo_slam.types import BoolArray

OBSERVATIONS, OBJECTS, POINTS = 20, 300, 2000
DISTANCE_M = 0.025
COLUMNS, SPACING_M = 20, 0.56
SIDE_M, NOISE_M = (0.35, 0.6), 0.004
OTHER_PAIRS = 100
"""Pairs that do not touch which are compared by brute force as well."""


def make_room(seed: int) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return the clouds of the objects and of the observations, world frame."""
    rng = np.random.default_rng(seed)
    sides_m = rng.uniform(*SIDE_M, (OBJECTS, 3))
    place = np.stack([np.arange(OBJECTS) % COLUMNS, np.arange(OBJECTS) // COLUMNS, np.zeros(OBJECTS)], axis=1)
    corner = SPACING_M * place + np.concatenate([rng.uniform(0, 0.1, (OBJECTS, 2)), np.zeros((OBJECTS, 1))], axis=1)
    objects = [corner[n] + _surface(sides_m[n], rng) for n in range(OBJECTS)]
    seen = rng.choice(OBJECTS, OBSERVATIONS, replace=False)
    return objects, [corner[n] + _surface(sides_m[n], rng) + rng.normal(0, NOISE_M, (POINTS, 3)) for n in seen]


def _surface(side_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Points spread evenly over the six faces of a box."""
    areas = np.array([side_m[1] * side_m[2], side_m[0] * side_m[2], side_m[0] * side_m[1]])
    axis = rng.choice(3, POINTS, p=areas / areas.sum())
    points = rng.uniform(0, 1, (POINTS, 3))
    points[np.arange(POINTS), axis] = rng.integers(0, 2, POINTS)
    return points * side_m


def touching(observed: list[FloatArray], objects: list[FloatArray], margin_m: float) -> BoolArray:
    """Return (K, N): boxes that overlap if one is grown by the margin."""
    low, high = (np.array([reduce(points) for points in observed]) for reduce in (_low, _high))
    low_n, high_n = (np.array([reduce(points) for points in objects]) for reduce in (_low, _high))
    return np.asarray(((low[:, None] - margin_m <= high_n) & (high[:, None] + margin_m >= low_n)).all(axis=2))


def _low(points: FloatArray) -> FloatArray:
    return np.asarray(points.min(axis=0))


def _high(points: FloatArray) -> FloatArray:
    return np.asarray(points.max(axis=0))


def exact_share(a: FloatArray, b: FloatArray) -> float:
    """Share of a's points closer than the distance to any of b's: every distance, in double precision."""
    squared = sum((a[:, None, axis] - b[None, :, axis]) ** 2 for axis in range(3))
    return float((np.sqrt(np.asarray(squared).min(axis=1)) < DISTANCE_M).mean())


def flat_index_share() -> tuple[str, Callable[[FloatArray, FloatArray], float]]:
    """Return what the published way runs on here, and the share of one pair by it."""
    if importlib.util.find_spec("faiss") is None:
        return "numpy, float64", exact_share
    import faiss

    faiss.omp_set_num_threads(1)

    def share(a: FloatArray, b: FloatArray) -> float:
        index = faiss.IndexFlatL2(3)
        index.add(np.ascontiguousarray(b, dtype=np.float32))
        squared, _ = index.search(np.ascontiguousarray(a, dtype=np.float32), 1)
        return float((squared[:, 0] < DISTANCE_M**2).mean())

    return f"faiss {faiss.__version__} IndexFlatL2, float32", share


def by_pairs(observed: list[FloatArray], objects: list[FloatArray], share: Callable[[FloatArray, FloatArray], float]) -> FloatArray:
    """Return (K, N) shares, pair by pair of those whose boxes touch."""
    out = np.zeros((len(observed), len(objects)))
    for k, n in zip(*np.nonzero(touching(observed, objects, DISTANCE_M)), strict=True):
        out[k, n] = share(observed[k], objects[n])
    return out


def measure(seed: int, rounds: int) -> dict[str, object]:
    """Time all sides in turn and compare their matrices."""
    objects, observed = make_room(seed)
    kept = [Cloud(points) for points in objects]
    name, share = flat_index_share()
    sides: dict[str, Callable[[], FloatArray]] = {
        "published": lambda: by_pairs(observed, objects, share),
        "trees_kept": lambda: overlap_shares(observed, kept, DISTANCE_M),
        "trees_anew": lambda: overlap_shares(observed, [Cloud(points) for points in objects], DISTANCE_M),
    }
    times_ms: dict[str, list[float]] = {side: [] for side in sides}
    matrices = {side: run() for side, run in sides.items()}  # also warms up
    for _ in range(rounds):
        for side, run in sides.items():
            start = time.thread_time()
            run()
            times_ms[side].append(1e3 * (time.thread_time() - start))
    exact = by_pairs(observed, objects, exact_share)
    apart = np.argwhere(~touching(observed, objects, DISTANCE_M))
    others = [exact_share(observed[k], objects[n]) for k, n in np.random.default_rng(seed).permutation(apart)[:OTHER_PAIRS]]
    median_ms = {side: statistics.median(values) for side, values in times_ms.items()}
    return {
        "what": "share of 20 observations' points near each of 300 objects, 2,000 points each; milliseconds of processor time, one thread",
        "seed": seed,
        "published_by": name,
        "touching_pairs": int(touching(observed, objects, DISTANCE_M).sum()),
        "published_ms": round(median_ms["published"], 1),
        "ours_trees_kept_ms": round(median_ms["trees_kept"], 1),
        "ours_trees_anew_ms": round(median_ms["trees_anew"], 1),
        "ratio_trees_kept": round(median_ms["published"] / median_ms["trees_kept"], 1),
        "ratio_trees_anew": round(median_ms["published"] / median_ms["trees_anew"], 1),
        "max_difference_ours": max(float(np.abs(matrices[side] - exact).max()) for side in ("trees_kept", "trees_anew")),
        "max_difference_published": float(np.abs(matrices["published"] - exact).max()),
        "largest_share_of_pairs_apart": max(others),
        "mean_share_of_own": round(float(exact.max(axis=1).mean()), 3),
        "versions": versions(),
    }


def main() -> None:
    """Measure, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the room")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    print(json.dumps(measure(given.seed, given.rounds), indent=1))


if __name__ == "__main__":
    main()
