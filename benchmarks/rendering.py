"""The Embree renderer: frames a second with many triangles, and its pixels against the exact renderer's. Prints one JSON object.

python benchmarks/rendering.py [--meshes DIR] [--frames 12] [--seed 0]

Colour, depth and instance ids, with shadows and smooth edges, one process on all its processors. Without --meshes only the desk.
"""

import argparse
import json
import os
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from seo_slam.geometry import FloatArray
from seo_slam.run_files import versions
from seo_slam.simulation import catalogue, textures
from seo_slam.simulation.desk import build_desk
from seo_slam.simulation.embree_world import compiled
from seo_slam.simulation.mesh_library import MeshLibrary, MeshModel
from seo_slam.simulation.primitives import Box, RoomBox
from seo_slam.simulation.rendering import Renderer, make_renderer
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.trajectory import look_at, swaying_arc
from seo_slam.simulation.world import STRUCTURE_ID, Light, Part, Thing, World

SIZES = ((320, 240), (640, 480))
FEWEST_TRIANGLES = 600_000
TABLE_HEIGHT_M = 0.74
OBJECTS = 30


def furnished_room(library: MeshLibrary) -> World:
    """A room with 12 pieces of furniture around a table of 30 objects; the last objects are taken for their triangles."""
    anchors = sorted((model for model in library if model.kind == "anchor"), key=lambda model: model.name)[:12]
    placed = [
        (model, catalogue.pose(2.9 * np.cos(angle), 2.9 * np.sin(angle), 0.0, (0.0, 0.0, angle - np.pi / 2)))
        for model, angle in zip(anchors, 2 * np.pi * np.arange(len(anchors)) / len(anchors), strict=True)
    ]
    for k, model in enumerate(objects_for(library, FEWEST_TRIANGLES - sum(model.faces for model in anchors))):
        row, column = divmod(k, 8)
        placed.append((model, catalogue.pose(0.34 * column - 1.2, 0.34 * row - 0.6, TABLE_HEIGHT_M, (0.0, 0.0, 0.7 * k))))
    things = tuple(Thing(k + 1, model.label, library.parts(model.name), T, kind=model.kind) for k, (model, T) in enumerate(placed))
    light = np.array([-0.45, -0.55, 1.0])
    return World(things, room(), Light(light / np.linalg.norm(light)), np.array([0.0, 0.0, 0.8]))


def objects_for(library: MeshLibrary, triangles: int) -> list[MeshModel]:
    """Thirty small models, as plain as possible, that have this many triangles together."""
    small = sorted((model for model in library if model.kind == "volatile" and max(model.size_m) < 0.35), key=lambda m: (m.faces, m.name))
    for first in range(len(small) - OBJECTS):
        chosen = small[first : first + OBJECTS]
        if sum(model.faces for model in chosen) >= triangles:
            return chosen
    return small[-OBJECTS:]


def room() -> tuple[Thing, ...]:
    """Walls, floor and a table."""
    wall = textures.wallpaper((0, "wall"), (0.80, 0.79, 0.72), (0.62, 0.68, 0.66))
    boards, wood = textures.planks((0, "floor"), (0.55, 0.40, 0.27)), textures.wood((0, "table"), (0.72, 0.54, 0.36))
    pieces = (
        ("room", Part(RoomBox((8.0, 8.0, 2.8)), wall, catalogue.pose(z=1.35))),
        ("floor", Part(Box((8.0, 8.0, 0.02)), boards, catalogue.pose(z=-0.01))),
        ("table", Part(Box((3.0, 1.6, 0.04)), wood, catalogue.pose(z=TABLE_HEIGHT_M - 0.02))),
    )
    return tuple(Thing(STRUCTURE_ID, name, (part,), np.eye(4)) for name, part in pieces)


def around(p_world: FloatArray, frames: int) -> list[FloatArray]:
    """Poses on a circle about a point, looking at it."""
    angles = np.linspace(0.0, 2.0 * np.pi, frames, endpoint=False)
    return [look_at(p_world + np.array([1.9 * np.cos(a), 1.9 * np.sin(a), 0.85]), p_world) for a in angles]


def timed(renderer: Renderer, world: World, poses: Sequence[FloatArray], size: tuple[int, int]) -> dict[str, float]:
    """Frames a second at the median and at best (other work on the machine slows most frames), processor time, and all ``covered_px``."""
    camera = simulated_camera(*size)
    dict(renderer(world, camera, poses[0]).covered_px)  # makes the world ready
    seconds, processor, covered = [], [], []
    for T_world_camera in poses:
        begin, begin_processor = time.perf_counter(), time.process_time()
        drawn = renderer(world, camera, T_world_camera)
        seconds.append(time.perf_counter() - begin)
        processor.append(time.process_time() - begin_processor)
        begin = time.perf_counter()
        dict(drawn.covered_px)
        covered.append(time.perf_counter() - begin)
    return {
        "frames_per_s": round(1.0 / float(np.median(seconds)), 2),
        "best_frames_per_s": round(1.0 / min(seconds), 2),
        "processor_ms": round(1e3 * float(np.median(processor)), 1),
        "covered_px_ms": round(1e3 * float(np.median(covered)), 2),
    }


def differences(world: World, poses: Sequence[FloatArray], size: tuple[int, int]) -> dict[str, float]:
    """Pixels in which the two renderers differ."""
    camera = simulated_camera(*size)
    embree, exact = make_renderer("embree"), make_renderer("primitive")
    rows = []
    for T_world_camera in poses:
        a, b = embree(world, camera, T_world_camera), exact(world, camera, T_world_camera)
        gap = np.abs(a.rgb.astype(np.float64) - b.rgb)
        rows.append([np.mean(a.instance_ids != b.instance_ids), np.mean(np.abs(a.depth_m - b.depth_m) > 0.005), gap.mean()])
    ids, depth, colour = np.mean(rows, axis=0)
    return {
        "share_of_other_ids": float(ids),
        "share_of_depth_over_5_mm": float(depth),
        "mean_colour_difference_of_255": round(float(colour), 3),
    }


def triangles_of(world: World) -> int:
    """How many triangles the Embree renderer draws."""
    return sum(len(part.shape.triangles()[1]) for thing in world for part in thing.parts)


def of_meshes(folder: str, frames: int) -> dict[str, Any]:
    """Figures of the furnished room."""
    begin = time.perf_counter()
    world = furnished_room(MeshLibrary(folder))
    loading = time.perf_counter() - begin
    begin = time.perf_counter()
    compiled(world)
    ready = time.perf_counter() - begin
    poses = around(world.gaze_world, frames)
    return {
        "things": len(world.things),
        "triangles": triangles_of(world),
        "loading_s": round(loading, 2),
        "making_ready_s": round(ready, 2),
        **{f"{w}x{h}": timed(make_renderer("embree"), world, poses, (w, h)) for w, h in SIZES},
    }


def of_desk(seed: int, frames: int) -> dict[str, Any]:
    """Figures of a scene that both renderers draw."""
    world = build_desk(seed)
    poses = list(swaying_arc(world.gaze_world, frames, seed).T_world_camera)
    out: dict[str, Any] = {"things": len(world.things), "triangles": triangles_of(world)}
    for size in SIZES:
        embree, primitive = (timed(make_renderer(name), world, poses, size) for name in ("embree", "primitive"))
        out[f"{size[0]}x{size[1]}"] = {
            "embree": embree,
            "primitive": {key: primitive[key] for key in ("frames_per_s", "best_frames_per_s", "processor_ms")},
            "ratio": round(embree["frames_per_s"] / primitive["frames_per_s"], 2),
            "differ": differences(world, poses[:4], size),
        }
    return out


def main() -> None:
    """Draw, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", help="folder of meshes with a manifest")
    parser.add_argument("--frames", type=int, default=12)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    result: dict[str, Any] = {"what": "colour, depth and ids with shadows and smooth edges", "processors": len(os.sched_getaffinity(0))}
    if given.meshes:
        result["meshes"] = of_meshes(given.meshes, given.frames)
    print(json.dumps({**result, "primitives": of_desk(given.seed, given.frames), "versions": versions()}, indent=2))


if __name__ == "__main__":
    main()
