"""A skeleton as a graph: its ends, its branchings, and a node every few cells in between."""

from collections.abc import Iterator

import numpy as np

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.navigation.cell_graph import neighbour_pairs
from seo_slam.registry import missing
from seo_slam.types import BoolArray

try:
    import networkx
except ModuleNotFoundError as error:
    raise missing("the global planner", error) from error

_EVERY = 6
"""Cells from node to node along a line: few nodes are searched fast, and one is near everywhere."""

Cells = list[int]
Neighbours = dict[int, Cells]


def skeleton_graph(skeleton: BoolArray, layout: Layout) -> "networkx.Graph[int]":
    """Return the graph of a skeleton (R, C).

    A node is a cell by its flat index, with its place as ``xy``. An edge has its ``length`` in metres and the ``cells`` it runs over,
    both ends included, in one direction or the other.
    """
    beside = _neighbours(skeleton)
    graph: networkx.Graph[int] = networkx.Graph()
    for line in _lines(beside):
        for first in range(0, max(len(line) - 1, 1), _EVERY):
            _join(graph, line[first : first + _EVERY + 1], layout)
    xy = layout.middles(np.argwhere(skeleton)).tolist()
    places = dict(zip(np.flatnonzero(skeleton).tolist(), xy, strict=True))
    networkx.set_node_attributes(graph, {node: places[node] for node in graph}, "xy")
    return graph


def _neighbours(skeleton: BoolArray) -> Neighbours:
    beside: Neighbours = {int(cell): [] for cell in np.flatnonzero(skeleton)}
    ones, others, _ = neighbour_pairs(skeleton)
    for a, b in zip(ones.tolist(), others.tolist(), strict=True):
        beside[a].append(b)
        beside[b].append(a)
    return beside


def _lines(beside: Neighbours) -> Iterator[Cells]:
    """Lines of cells between ends and branchings; rings without any; single cells."""
    done: set[int] = set()
    corners = [cell for cell, others in beside.items() if len(others) != 2]
    for corner in corners:
        done.add(corner)
        if not beside[corner]:
            yield [corner]
        for other in beside[corner]:
            if len(beside[other]) != 2 and other not in done:
                yield [corner, other]
            elif len(beside[other]) == 2 and other not in done:
                yield _followed(corner, other, beside, done)
    for cell, others in beside.items():
        if cell not in done and len(others) == 2:
            done.add(cell)
            yield _followed(cell, others[0], beside, done)


def _followed(first: int, second: int, beside: Neighbours, done: set[int]) -> Cells:
    """The line from one cell over a second one to the next end or branching, or round to where it began."""
    line = [first, second]
    while len(beside[line[-1]]) == 2 and line[-1] != first:
        done.add(line[-1])
        ahead = [cell for cell in beside[line[-1]] if cell != line[-2]]
        line.append(ahead[0])
    return line


def _join(graph: "networkx.Graph[int]", cells: Cells, layout: Layout) -> None:
    """Add an edge over some cells; of two between the same nodes the shorter one stays."""
    graph.add_node(cells[0])
    if len(cells) < 2 or cells[0] == cells[-1]:
        return
    places = np.stack(np.unravel_index(cells, layout.floor.shape), axis=-1)
    length_m = layout.cell_m * float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    before = graph.get_edge_data(cells[0], cells[-1])
    if before is None or length_m < before["length"]:
        graph.add_edge(cells[0], cells[-1], length=length_m, cells=cells)
