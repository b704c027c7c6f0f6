"""Points are grouped by voxel as a plain loop would, whatever the span of their coordinates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seo_slam.perception.voxels import cell_order, sums_of_groups, voxel_cells, voxel_means


def groups_by_loop(cells, owners):
    groups = {}
    for row, (owner, cell) in enumerate(zip(owners.tolist(), cells.tolist(), strict=True)):
        groups.setdefault((owner, *cell), []).append(row)
    return [groups[name] for name in sorted(groups)]


# 10**7 along each axis does not fit into one number: the other way of sorting
@pytest.mark.parametrize("reach", [3, 10**7])
@settings(deadline=None)
@given(data=st.data())
def test_groups_are_those_of_a_loop(reach, data):
    M = data.draw(st.integers(1, 30))
    cells = data.draw(arrays(np.int64, (M, 3), elements=st.integers(-reach, reach)))
    cells[0], cells[-1] = -reach, reach
    owners = data.draw(arrays(np.int64, M, elements=st.integers(0, 2)))
    order, starts = cell_order(cells, owners)
    assert [part.tolist() for part in np.split(order, starts[1:])] == groups_by_loop(cells, owners)


def test_without_owners_all_have_one():
    cells = np.array([[1, 0, 0], [0, 0, 0], [1, 0, 0]])
    order, starts = cell_order(cells)
    assert order.tolist() == [1, 0, 2]
    assert starts.tolist() == [0, 1]


def test_no_points_no_groups():
    order, starts = cell_order(np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64))
    assert len(order) == len(starts) == 0
    assert voxel_means(np.zeros((0, 3)), order, starts).shape == (0, 3)
    assert len(sums_of_groups(np.zeros(0), starts)) == 0


def test_a_cell_reaches_from_its_corner_up_to_the_next():
    p_m = np.array([[0.0, 0.019, 0.02], [-0.001, -0.02, -0.021]])
    assert voxel_cells(p_m, 0.02).tolist() == [[0, 0, 1], [-1, -1, -2]]


@settings(deadline=None)
@given(st.integers(0, 10**6))
def test_means_are_those_of_the_points_of_each_voxel(seed):
    rng = np.random.default_rng(seed)
    p_m, weights = rng.uniform(-0.05, 0.05, (40, 3)), rng.integers(1, 5, 40).astype(float)
    cells = voxel_cells(p_m, 0.03)
    order, starts = cell_order(cells)
    rows = [np.flatnonzero((cells == cells[part[0]]).all(axis=1)) for part in np.split(order, starts[1:])]
    np.testing.assert_allclose(voxel_means(p_m, order, starts), [p_m[r].mean(axis=0) for r in rows], atol=1e-15)
    weighted = [np.average(p_m[r], axis=0, weights=weights[r]) for r in rows]
    np.testing.assert_allclose(voxel_means(p_m, order, starts, weights), weighted, atol=1e-15)
