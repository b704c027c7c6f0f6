"""The graph of a skeleton: nodes a few cells apart, and nothing that was joined is parted."""

import networkx
import numpy as np
import pytest
from grid_worlds import layout_of_cells
from scipy import ndimage
from skimage.morphology import skeletonize

from seo_slam.navigation.skeleton_graph import skeleton_graph


def graph_of(drawing):
    skeleton = np.array([[mark == "#" for mark in line] for line in drawing])
    return skeleton_graph(skeleton, layout_of_cells(~skeleton, skeleton)), skeleton


def test_a_line_has_its_ends_and_a_node_every_six_cells():
    graph, _ = graph_of(["." * 16, ".##############.", "." * 16])
    assert sorted(graph) == [17, 23, 29, 30]
    assert graph.edges[17, 23]["length"] == pytest.approx(0.6)
    assert sorted(graph.edges[23, 29]["cells"]) == list(range(23, 30))
    assert graph.nodes[17]["xy"] == pytest.approx([0.15, 0.15])


def test_rings_branchings_and_single_cells():
    ring, _ = graph_of(["#" * 9, *["#.......#"] * 7, "#" * 9])
    assert networkx.number_connected_components(ring) == 1
    assert sum(length for *_, length in ring.edges(data="length")) == pytest.approx(3.0, abs=0.2)  # round the corners
    cross, _ = graph_of(["..#..", "..#..", "#####", "..#..", "..#.."])
    assert {2, 10, 14, 22} <= set(cross)
    assert networkx.is_connected(cross)
    single, _ = graph_of(["...", ".#.", "..."])
    assert list(single) == [4]
    nothing, _ = graph_of(["...", "..."])
    assert len(nothing) == 0


@pytest.mark.parametrize("seed", range(6))
def test_the_graph_has_the_parts_and_edges_of_the_skeleton(seed):
    free = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal((60, 60)), 2.0) > -0.02
    skeleton = skeletonize(free)
    graph = skeleton_graph(skeleton, layout_of_cells(~free, free))
    labels, parts = ndimage.label(skeleton, np.ones((3, 3)))
    assert networkx.number_connected_components(graph) == parts
    for a, b, kept in graph.edges(data=True):
        cells = kept["cells"]
        assert {cells[0], cells[-1]} == {a, b}
        assert skeleton.ravel()[cells].all()
        places = np.stack(np.unravel_index(cells, skeleton.shape), axis=1)
        assert np.abs(np.diff(places, axis=0)).max() == 1
        assert kept["length"] == pytest.approx(0.1 * np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    covered = set(graph).union(*(kept["cells"] for *_, kept in graph.edges(data=True)))
    assert len(covered) > 0.95 * skeleton.sum()
    assert labels.ravel()[list(covered)].all()
