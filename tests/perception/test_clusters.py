"""The largest cluster is DBSCAN's, pair by pair."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.perception.clusters import gathered, in_largest_cluster


def dbscan_by_loop(p_m, weights, neighbour_m, least_weight):
    """The members of the heaviest cluster of one owner, after the definition."""
    distance_m = np.linalg.norm(p_m[:, None] - p_m[None], axis=2)
    near = distance_m <= neighbour_m
    inner = near @ weights >= least_weight
    cluster, names = np.full(len(p_m), -1), 0
    for seed in np.flatnonzero(inner):
        if cluster[seed] >= 0:
            continue
        stack = [seed]
        while stack:
            row = stack.pop()
            if cluster[row] < 0:
                cluster[row] = names
                stack += np.flatnonzero(near[row] & inner & (cluster < 0)).tolist()
        names += 1
    for row in np.flatnonzero(~inner):
        reached = np.flatnonzero(near[row] & inner)
        if len(reached):
            cluster[row] = cluster[reached[np.argmin(distance_m[row, reached])]]
    if not names:
        return np.zeros(len(p_m), dtype=bool)
    return cluster == np.argmax([weights[cluster == name].sum() for name in range(names)])


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 120), st.floats(0.15, 2.0), st.integers(1, 12), st.integers(1, 4))
def test_cells_are_clustered_as_by_dbscan(seed, count, side_m, least_weight, owners_count):
    rng = np.random.default_rng(seed)
    p_m = rng.uniform(-side_m / 2, side_m / 2, (count, 3)) * [1, 1, 0.3]
    owners, weights = rng.integers(0, owners_count, count), rng.integers(1, 4, count).astype(float)
    kept = in_largest_cluster(p_m, owners, weights, 0.1, least_weight)
    cells = gathered(p_m, owners, weights, 0.1)
    for owner in range(owners_count):
        own = cells.owners == owner
        wanted = dbscan_by_loop(cells.means[own], cells.weights[own], 0.1, least_weight)
        mine = np.zeros(len(own), dtype=bool)
        mine[cells.cell_of[kept & (owners == owner)]] = True
        assert mine[own].tolist() == wanted.tolist()


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 200), st.floats(0.1, 1.5))
def test_all_pairs_of_neighbours_are_found(seed, count, side_m):
    rng = np.random.default_rng(seed)
    p_m, owners = rng.uniform(0, side_m, (count, 3)), rng.integers(0, 3, count)
    cells = gathered(p_m, owners, np.ones(count), 0.1)
    distance_m = np.linalg.norm(cells.means[:, None] - cells.means[None], axis=2)
    near = (distance_m <= 0.1) & (cells.owners[:, None] == cells.owners[None])
    wanted = set(zip(*np.nonzero(np.triu(near, k=1)), strict=True))
    assert {(min(a, b), max(a, b)) for a, b in zip(*cells.neighbours, strict=True)} == wanted
    assert len(cells.neighbours[0]) == len(wanted)  # once each


def test_what_lies_apart_is_dropped_and_the_heavier_side_kept():
    rng = np.random.default_rng(0)
    thing, wall = rng.uniform(0, 0.1, (60, 3)), rng.uniform(0, 0.1, (40, 3)) + np.array([0, 0, 0.6])
    p_m = np.concatenate([thing, wall])
    kept = in_largest_cluster(p_m, np.zeros(100, dtype=np.int64), np.ones(100), 0.1, 10)
    assert kept.tolist() == [True] * 60 + [False] * 40
    weights = np.where(np.arange(100) < 60, 1.0, 3.0)
    assert in_largest_cluster(p_m, np.zeros(100, dtype=np.int64), weights, 0.1, 10).tolist() == [False] * 60 + [True] * 40


def test_a_bridge_of_inner_points_joins_two_halves_and_one_of_single_points_does_not():
    blob = np.random.default_rng(1).uniform(-0.02, 0.02, (30, 3))
    bridge = np.linspace([0.06, 0, 0], [0.94, 0, 0], 23)
    p_m = np.concatenate([blob, blob + np.array([1, 0, 0]), bridge])
    owners = np.zeros(len(p_m), dtype=np.int64)
    assert in_largest_cluster(p_m, owners, np.ones(len(p_m)), 0.1, 3).all()
    parted = in_largest_cluster(p_m, owners, np.ones(len(p_m)), 0.1, 8)
    assert parted[:30].all() != parted[30:60].all()


@pytest.mark.parametrize("count", [0, 1])
def test_few_points_are_noise(count):
    kept = in_largest_cluster(np.zeros((count, 3)), np.zeros(count, dtype=np.int64), np.ones(count), 0.1, 2)
    assert kept.tolist() == [False] * count
