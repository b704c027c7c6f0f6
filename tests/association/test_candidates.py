"""What is left out of a large map changes no answer: against the dense problem and a plain loop, and while the map changes."""

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from seo_slam.association.candidates import candidate_rows
from seo_slam.association.costs import mahalanobis, predicted_measurements
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.association.nearest import NearestAssociator
from seo_slam.association.two_stage import TwoStageAssociator
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.lap_assignment import LapAssignment
from seo_slam.config import AssociationSettings
from seo_slam.geometry import exp
from seo_slam.types import NEW, Estimate

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "association.py"
LIKELIHOOD = LabelLikelihood(HashedEmbedder())


@pytest.fixture(scope="module")
def benchmark() -> Iterator[ModuleType]:
    """The benchmark as a module: it is a script, not part of the package."""
    spec = importlib.util.spec_from_file_location("association_benchmark", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.mark.parametrize("things_per_m2", [1.0, 6.0, 30.0])
@pytest.mark.parametrize("seed", range(8))
def test_the_total_cost_is_the_dense_optimum(benchmark, things_per_m2, seed):
    world = benchmark.make_world(24, 300, things_per_m2, seed)
    dense = benchmark.dense_matrix(world, LIKELIHOOD)
    for solver in (None, LapAssignment()):
        found = TwoStageAssociator(solver=solver, likelihood=LIKELIHOOD).associate(world.observations, world.landmarks, world.estimate)
        assert np.nansum(found.costs) == pytest.approx(benchmark.solved(dense), rel=1e-12, abs=1e-12)
        matched = np.flatnonzero(found.landmark_ids >= 0)
        np.testing.assert_allclose(found.costs[matched], dense[matched, found.landmark_ids[matched]], rtol=1e-9)
        assert len(matched) > 10


def test_the_loops_and_the_dense_side_of_the_benchmark_have_one_matrix(benchmark):
    world = benchmark.make_world(12, 80, 2.0, 5)
    dense = benchmark.dense_matrix(world, LIKELIHOOD)
    for loop in (benchmark.loop_matrix, benchmark.careful_loop_matrix):
        np.testing.assert_allclose(loop(world, LIKELIHOOD), dense, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("gate", ["likelihood", "cosine", "none"])
@pytest.mark.parametrize("seed", range(4))
def test_a_gate_of_the_whole_map_is_that_of_its_candidates(benchmark, gate, seed):
    """Every pair that any landmark of the map is allowed is one of a candidate, at the same cost."""
    world = benchmark.make_world(20, 200, 8.0, seed)
    settings = AssociationSettings(semantic_gate=gate)
    associator = TwoStageAssociator(settings, likelihood=LIKELIHOOD)
    rows = candidate_rows(world.observations, world.landmarks, world.estimate, settings.search_distance_m, benchmark.THRESHOLD)
    assert 0 < len(rows) < 200
    whole = associator.gate(world.observations, world.landmarks, world.estimate)
    part = associator.gate(world.observations, world.landmarks[rows], world.estimate)
    np.testing.assert_array_equal(np.delete(whole.allowed, rows, axis=1), False)
    np.testing.assert_array_equal(whole.allowed[:, rows], part.allowed)
    np.testing.assert_allclose(whole.cost[:, rows][part.allowed], part.cost[part.allowed], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_associator_takes_the_pairs_of_the_whole_map_in_order(benchmark, seed):
    world = benchmark.make_world(20, 200, 8.0, seed)
    seen, known = world.observations, world.landmarks
    squared, _ = mahalanobis(seen, known, *predicted_measurements(world.estimate, known))
    squared[:, np.linalg.norm(known.p_world - world.estimate.T_world_camera[:3, 3], axis=1) >= 6.0] = np.inf
    wanted = np.full(len(seen), NEW)
    while squared.min() < benchmark.THRESHOLD:
        k, n = np.unravel_index(np.argmin(squared), squared.shape)
        wanted[k] = n
        squared[k], squared[:, n] = np.inf, np.inf
    found = NearestAssociator().associate(seen, known, world.estimate)
    assert (found.landmark_ids >= 0).sum() > 10
    np.testing.assert_array_equal(found.landmark_ids, wanted)


def test_one_associator_follows_a_map_that_moves_grows_and_shrinks(benchmark):
    """It answers for the map it is given, not for one of before: the same as an associator that was made for this call."""
    world = benchmark.make_world(20, 200, 4.0, 1)
    rng = np.random.default_rng(0)
    kept = TwoStageAssociator(likelihood=LIKELIHOOD)
    seen, known, estimate, answers = world.observations, world.landmarks, world.estimate, set()
    for turn in range(12):
        if turn % 3 == 0:  # a loop closes: all moves, the camera too
            shift = np.array([0.0, 0.0, 0.0, 3.0, -0.5, 2.0])
            estimate = Estimate(estimate.T_world_camera @ exp(shift), estimate.joint_covariance)
            known = replace(known, p_world=known.p_world + estimate.T_world_camera[:3, :3] @ shift[3:])
        elif turn % 3 == 1:
            known = known[np.sort(rng.permutation(len(known))[:-10])]
        else:
            missing = np.setdiff1d(world.landmarks.ids, known.ids)[:5]
            moved = world.landmarks[np.sort(np.concatenate([known.ids, missing]))]
            places = {int(i): p for i, p in zip(known.ids, known.p_world, strict=True)}
            p_world = [places.get(int(i), p) for i, p in zip(moved.ids, moved.p_world, strict=True)]
            known = replace(moved, p_world=np.array(p_world))
        fresh = TwoStageAssociator(likelihood=LIKELIHOOD).associate(seen, known, estimate)
        again = kept.associate(seen, known, estimate)
        np.testing.assert_array_equal(again.landmark_ids, fresh.landmark_ids)
        np.testing.assert_array_equal(again.costs, fresh.costs)
        assert set(again.landmark_ids[again.landmark_ids >= 0].tolist()) <= set(known.ids.tolist())
        assert (again.landmark_ids >= 0).any()
        answers.add(tuple(again.landmark_ids.tolist()))
    assert len(answers) > 3
