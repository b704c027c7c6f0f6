"""Both planners in three homes: no collision with the true geometry, a way wherever one exists, and how long a query takes.

python benchmarks/planner.py --meshes DIR [--homes house,0,1] [--pairs 1000] [--local-pairs 200] [--cache DIR]
Prints one JSON object. Each home is planned in twice: over its true free floor, and over the layout that the scene cloud of a tour gives,
at true poses and with depth at the frozen level of errors. Ways over both are checked against the true occupancy, grown by the robot's
radius, at points a centimetre apart; existence is checked against the connected components of the same grid.
"""

import argparse
import json
import math
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from run_options import frozen_level
from scipy import ndimage

from seo_slam.abstraction.abstract_map import Layout
from seo_slam.abstraction.scene_cloud import SceneCloud
from seo_slam.errors import ConfigError, NoPathError, SeoSlamError
from seo_slam.geometry import FloatArray
from seo_slam.navigation.cell_graph import CellGraph
from seo_slam.navigation.global_planner import VoronoiPlanner
from seo_slam.navigation.grid import NavigationGrid
from seo_slam.navigation.local_planner import RrtStar
from seo_slam.navigation.motion import path_length_m
from seo_slam.settings.planning import LayoutSettings, PlannerSettings
from seo_slam.simulation.apartment import SimulatedApartment
from seo_slam.simulation.free_space import FreeSpace
from seo_slam.simulation.home import SimulatedHome
from seo_slam.simulation.house import SimulatedHouse
from seo_slam.simulation.sensors import sense_depth

EVERY_NTH_FRAME = 3
SIZE = (160, 120)
LOCAL_M = 2.0
STEP_M = 0.01
MOST_CLEARANCE_M = 0.25  # farther is not told apart
COMPARED = 100  # ways that are compared with the shortest over cells, which is slow

_TOUCHING_M = 1e-6


@dataclass(frozen=True)
class Options:
    """What is asked of each home."""

    pairs: int
    local_pairs: int
    seed: int
    settings: PlannerSettings


class Truth:
    """Distance of points from what is truly occupied, cells as squares; outside of the home all is."""

    def __init__(self, free: FreeSpace) -> None:
        """Look at a true floor."""
        self._free = free
        self._reach = math.ceil(MOST_CLEARANCE_M / free.cell_m)
        self._blocked = np.pad(free.occupied, self._reach + 1, constant_values=True)

    def clearance_m(self, xy_world: FloatArray) -> FloatArray:
        """Return (N,) exact distances of points (N, 2) from the nearest occupied square, at most ``MOST_CLEARANCE_M``."""
        cell_m, reach = self._free.cell_m, self._reach
        at = (xy_world - self._free.corner_world) / cell_m + reach + 1
        index = np.clip(np.floor(at).astype(int), reach, np.array(self._blocked.shape)[::-1] - reach - 1)
        out = np.full(len(xy_world), MOST_CLEARANCE_M)
        for down in range(-reach, reach + 1):
            for right in range(-reach, reach + 1):
                there = self._blocked[index[:, 1] + down, index[:, 0] + right]
                low = index[there] + np.array([right, down])
                beside = np.maximum(np.maximum(low - at[there], at[there] - low - 1.0), 0.0)
                out[there] = np.minimum(out[there], cell_m * np.hypot(beside[:, 0], beside[:, 1]))
        return out


def true_layout(free: FreeSpace) -> Layout:
    """Return the layout that a perfect map would have."""
    none = np.zeros_like(free.occupied)
    return Layout(free.corner_world, free.cell_m, none, free.occupied, ~free.occupied, np.zeros(none.shape, dtype=np.int16))


def mapped_layout(home: SimulatedHome) -> tuple[Layout, dict[str, Any]]:
    """Return the layout from the frames of a tour, and what it took."""
    cloud, taken, seconds = SceneCloud(LayoutSettings()), 0, 0.0
    frames = range(0, len(home), EVERY_NTH_FRAME)
    for index in frames:
        depth_m = sense_depth(home.rendered(index).depth_m, home.sensor_knobs, home.seed, index)
        start = time.perf_counter()
        taken += cloud.add(depth_m, home.camera, home.trajectory.T_world_camera[index])
        seconds += time.perf_counter() - start
    start = time.perf_counter()
    layout = cloud.layout()
    return layout, {
        "frames": len(frames),
        "taken": taken,
        "megabytes": round(cloud.nbytes / 1e6, 1),
        "ms_per_frame": round(1e3 * seconds / len(frames), 2),
        "ms_layout": round(1e3 * (time.perf_counter() - start), 1),
    }


def home_of(name: str, meshes: str | None, cache: str | None, level: float) -> SimulatedHome:
    """Return a home by name.

    Raises:
        ConfigError: neither "house" nor a seed.
    """
    width, height = SIZE
    if name == "house":
        return SimulatedHouse(0, level, meshes, width=width, height=height, changes=False, cache=cache)
    if not name.isdigit():
        raise ConfigError(f"--homes: got {name!r}, wanted house or the seed of an apartment")
    return SimulatedApartment(int(name), level, meshes=meshes, width=width, height=height, changes=False, cache=cache)


def planned(layout: Layout, truth: Truth, options: Options) -> dict[str, Any]:
    """Return how both planners do on a layout."""
    start = time.perf_counter()
    grid = NavigationGrid(layout, options.settings.radius_m)
    grid_s = time.perf_counter() - start
    if len(grid.free_cells) < 2:
        return {"cells": list(layout.floor.shape), "free_share": round(grid.free_share, 4)}
    start = time.perf_counter()
    planner = VoronoiPlanner(grid, options.settings)
    graph_s = time.perf_counter() - start
    parts = np.sort(np.bincount(grid.parts.ravel())[1:])[::-1]
    return {
        "cells": list(layout.floor.shape),
        "free_share": round(grid.free_share, 4),
        "largest_part_share": round(float(parts[0] / parts.sum()), 4),
        "nodes": planner.graph.number_of_nodes(),
        "ms_grid": round(1e3 * grid_s, 1),
        "ms_graph": round(1e3 * graph_s, 1),
        "global": {
            **_asked(planner, grid, truth, options.pairs, options.seed, math.inf),
            "ends_joined_by_grid": planner.joined_by_grid,
            "ways_by_grid": planner.found_by_grid,
        },
        "local": _asked(None, grid, truth, options.local_pairs, options.seed, LOCAL_M, options.settings),
    }


def _asked(
    planner: VoronoiPlanner | None,
    grid: NavigationGrid,
    truth: Truth,
    pairs: int,
    seed: int,
    within_m: float,
    settings: PlannerSettings | None = None,
) -> dict[str, Any]:
    """Ask for ways between random free places."""
    components, _ = ndimage.label(grid.free, np.ones((3, 3)))
    draws = np.random.default_rng(seed)
    cells = CellGraph(grid)
    times, ratios, least = [], [], []
    counts = dict.fromkeys(("exist", "found", "missed", "wrongly_found", "in_collision"), 0)
    for k in range(pairs):
        a, b, joined = _pair(grid, components, draws, within_m)
        counts["exist"] += joined
        ask = planner or RrtStar(grid, settings, seed=k)
        start = time.perf_counter()
        try:
            way = ask.path(a, b)
        except NoPathError:
            counts["missed"] += joined
            continue
        finally:
            if joined:
                times.append(time.perf_counter() - start)
        counts["found"] += 1
        counts["wrongly_found"] += not joined
        least.append(float(truth.clearance_m(_dense(way)).min()))
        if len(ratios) < COMPARED and np.linalg.norm(a - b) > 0.3:
            ratios.append(path_length_m(way) / path_length_m(cells.way(a, b)))
    counts["in_collision"] = sum(clearance < grid.radius_m - _TOUCHING_M for clearance in least)
    return {
        "pairs": pairs,
        **counts,
        "least_true_clearance_m": round(min(least), 4) if least else None,
        "ms_median": round(1e3 * float(np.median(times)), 2),
        "ms_p99": round(1e3 * float(np.percentile(times, 99)), 2),
        "mean_length_over_shortest_by_cells": round(float(np.mean(ratios)), 3) if ratios else None,
    }


def _pair(grid: NavigationGrid, components: Any, draws: np.random.Generator, within_m: float) -> tuple[FloatArray, FloatArray, bool]:
    """Two random free places not farther apart than so much, and whether they are in one component."""
    while True:
        cells = grid.free_cells[draws.integers(len(grid.free_cells), size=2)]
        a, b = grid.layout.middles(cells) + grid.cell_m * draws.uniform(-0.49, 0.49, (2, 2))
        if np.linalg.norm(a - b) <= within_m:
            return a, b, bool(components[tuple(cells[0])] == components[tuple(cells[1])])


def _dense(way: FloatArray) -> FloatArray:
    """Points of a way, ``STEP_M`` apart at most."""
    counts = np.ceil(np.linalg.norm(np.diff(way, axis=0), axis=1) / STEP_M).astype(int) + 1
    return np.concatenate([np.linspace(a, b, count) for a, b, count in zip(way[:-1], way[1:], counts, strict=True)])


def main(arguments: list[str] | None = None) -> int:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", metavar="DIR", help="folder of meshes; the house needs it")
    parser.add_argument("--homes", default="house,0,1", help="house, and seeds of apartments")
    parser.add_argument("--pairs", type=int, default=1000, help="of the global planner, a grid")
    parser.add_argument("--local-pairs", type=int, default=200, help=f"of RRT*, a grid; within {LOCAL_M} m")
    parser.add_argument("--seed", type=int, default=0, help="of the pairs and of RRT*")
    parser.add_argument("--cache", metavar="DIR", help="folder of drawn frames")
    given = parser.parse_args(arguments)
    options = Options(given.pairs, given.local_pairs, given.seed, PlannerSettings())
    level, homes = frozen_level(), {}
    try:
        for name in given.homes.split(","):
            home = home_of(name, given.meshes, given.cache, level)
            truth = Truth(home.free)
            mapped, took = mapped_layout(home)
            homes[home.name] = {
                "true_floor": planned(true_layout(home.free), truth, options),
                "mapped_floor": {"scene_cloud": took, **planned(mapped, truth, options)},
            }
            print(f"{home.name}: done", file=sys.stderr)
    except SeoSlamError as error:
        print(f"planner.py: {error}", file=sys.stderr)
        return 2
    rows = [row for home in homes.values() for row in home.values()]
    summary = {
        "collisions": sum(row[kind]["in_collision"] for row in rows for kind in ("global", "local")),
        "global_missed": sum(row["global"]["missed"] for row in rows),
        "local_missed": sum(row["local"]["missed"] for row in rows),
        "worst_global_ms_median": max(row["global"]["ms_median"] for row in rows),
    }
    settings = {"radius_m": options.settings.radius_m, "level": level, "seed": given.seed, "every_nth_frame": EVERY_NTH_FRAME, "size": SIZE}
    print(json.dumps({"benchmark": "planner", **settings, "summary": summary, "homes": homes}, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
