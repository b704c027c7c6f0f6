"""Layouts drawn as text for the tests of the planners."""

from itertools import pairwise

import numpy as np

from seo_slam.abstraction.abstract_map import Layout


def layout_from(drawing, cell_m=0.1, corner=(0.0, 0.0)):
    """A layout from lines of text, the last line at the lowest y: "#" obstacle, "." floor, " " never seen."""
    rows = [line for line in drawing.splitlines() if line][::-1]
    width = max(len(line) for line in rows)
    cells = np.array([list(line.ljust(width)) for line in rows])
    return layout_of_cells(cells == "#", cells == ".", cell_m, corner)


def layout_of_cells(obstacles, floor, cell_m=0.1, corner=(0.0, 0.0)):
    none = np.zeros(obstacles.shape, dtype=np.bool_)
    return Layout(np.array(corner), cell_m, none, obstacles, floor, np.zeros(obstacles.shape, dtype=np.int16))


def random_layout(seed, shape=(30, 40), share=0.06, cell_m=0.1):
    """Floor with obstacles strewn over it."""
    obstacles = np.random.default_rng(seed).random(shape) < share
    return layout_of_cells(obstacles, ~obstacles, cell_m, corner=(-1.0, 2.0))


def distance_to_blocked_m(layout, points):
    """Distance of each point from the nearest cell that is not traversable, as a square: by brute force, outside counts as blocked."""
    blocked = np.pad(~(layout.floor & ~layout.obstacles & ~layout.walls), 1, constant_values=True)
    low = layout.corner_world + (np.argwhere(blocked)[:, ::-1] - 1) * layout.cell_m
    beside = np.maximum(np.maximum(low[None] - points[:, None], points[:, None] - low[None] - layout.cell_m), 0.0)
    return np.linalg.norm(beside, axis=2).min(axis=1)


def along(path, step_m=0.005):
    """Points along a way, densely."""
    counts = [int(np.linalg.norm(b - a) / step_m) + 2 for a, b in pairwise(path)]
    return np.concatenate([np.linspace(a, b, count) for (a, b), count in zip(pairwise(path), counts, strict=True)])
