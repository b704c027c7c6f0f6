"""A hall with more things than any simulated home: tables full of them in two rows, back to back, and a walk around them, lap after lap.

Every frame sees about two tables. A lap is closed, so that each lap sees what the one before saw, from the same places.
"""

from pathlib import Path

import numpy as np
from long_walk import LongWalk

from seo_slam.geometry import FloatArray
from seo_slam.records import Trajectory
from seo_slam.simulation import catalogue, textures
from seo_slam.simulation.home_models import Model, furniture_model, small_models
from seo_slam.simulation.primitives import Box, RoomBox
from seo_slam.simulation.scene import Scene
from seo_slam.simulation.simulated_recording import SimulatedRecording, simulated_camera
from seo_slam.simulation.trajectory import look_at
from seo_slam.simulation.world import STRUCTURE_ID, Light, Part, Thing, World

RATE_HZ = 6.0
SPEED_M_S = 0.55

_OFFERED = 18  # models that a table takes from, while there is room
_TABLE_GAP_M, _THING_GAP_M, _RIM_M = 0.1, 0.04, 0.03
_WIDEST_M, _TALLEST_M, _DEEPEST_M = 0.3, 0.3, 0.3
_LOW_M = 0.14  # lower things stand in front, the others behind them
_SPINE_M = 0.6  # from the wall between the rows to the middle of a table
_AISLE_M, _EYE_M, _GAZE_M = 1.6, 1.4, 0.75  # of the camera: from the middle of a table, above the floor, and the height it looks at
_WALL_M = 1.7  # height of the wall between the rows: from one side the other one is not seen


def hall(seed: int, tables: int) -> World:
    """Return the hall; every table carries eight to twelve things, no two of one label but for two copies."""
    placed = _tables(seed, tables)
    things = list(placed)
    for number, table in enumerate(placed):
        things += _things_on(table, seed, number, 1 + len(things))
    half_m = max(float(np.abs(table.bounds_world[k][0])) for table in placed for k in (0, 1))
    size_m = (2 * half_m + 2 * (_SPINE_M + _AISLE_M + 1.0), 2 * (_SPINE_M + _AISLE_M + 1.0), 2.6)
    direction = np.array([-0.35, -0.5, 1.0])
    light = Light(direction / np.linalg.norm(direction), ambient=0.6)
    return World(tuple(things), _structure(seed, size_m, half_m), light, np.array([0.0, 0.0, _GAZE_M]))


def _tables(seed: int, count: int) -> list[Thing]:
    """Half of them look to -y, half to +y; each row is centred."""
    placed: list[Thing] = []
    for side, number in ((0, (count + 1) // 2), (1, count // 2)):
        models = [furniture_model("table", (seed, "hall table", side, k), None) for k in range(number)]
        widths_m = [float(np.diff([bound[0] for bound in _bounds(model)])[0]) for model in models]
        x = -(sum(widths_m) + _TABLE_GAP_M * (number - 1)) / 2
        for model, width_m in zip(models, widths_m, strict=True):
            y = _SPINE_M if side else -_SPINE_M
            placed.append(model.thing(len(placed) + 1, catalogue.pose(x + width_m / 2, y, 0.0, omega=(0.0, 0.0, np.pi * side))))
            x += width_m + _TABLE_GAP_M
    return placed


def _bounds(model: Model) -> tuple[FloatArray, FloatArray]:
    return model.thing(1, np.eye(4)).bounds_thing


def _things_on(table: Thing, seed: int, number: int, first_id: int) -> list[Thing]:
    """Low things in front, taller ones behind them, side by side while there is room."""
    low, high = table.bounds_thing
    ends = {True: float(low[0]) + _RIM_M, False: float(low[0]) + _RIM_M}
    placed: list[Thing] = []
    for model in small_models(_OFFERED, (seed, "hall", number), None):
        size_m = _bounds(model)[1] - _bounds(model)[0]
        front = float(size_m[2]) < _LOW_M
        fits = (size_m <= (_WIDEST_M, _DEEPEST_M, _TALLEST_M)).all() and ends[front] + size_m[0] <= high[0] - _RIM_M
        if not fits:
            continue
        y = float(low[1] + _RIM_M + size_m[1] / 2 if front else high[1] - _RIM_M - size_m[1] / 2)
        T_table_thing = catalogue.pose(ends[front] + float(size_m[0]) / 2, y, float(high[2]))
        placed.append(model.thing(first_id + len(placed), table.T_world_thing @ T_table_thing))
        ends[front] += float(size_m[0]) + _THING_GAP_M
    return placed


def _structure(seed: int, size_m: tuple[float, float, float], half_m: float) -> tuple[Thing, ...]:
    x, y, z = size_m
    paper = textures.wallpaper((seed, "hall wall"), (0.80, 0.79, 0.72), (0.62, 0.68, 0.66))
    boards = textures.planks((seed, "hall floor"), (0.55, 0.40, 0.27))
    return (
        Thing(STRUCTURE_ID, "room", (Part(RoomBox(size_m), paper, catalogue.pose()),), catalogue.pose(0, 0, z / 2 - 0.05)),
        Thing(STRUCTURE_ID, "floor", (Part(Box((x, y, 0.02)), boards, catalogue.pose()),), catalogue.pose(0, 0, -0.01)),
        Thing(STRUCTURE_ID, "wall", (Part(Box((2 * half_m, 0.06, _WALL_M)), paper, catalogue.pose()),), catalogue.pose(0, 0, _WALL_M / 2)),
    )


def around(half_m: float, frames: int | None = None) -> Trajectory:
    """Return one lap around rows that reach from -half_m to half_m along x, looking inwards; the frame after the last is the first."""
    radius_m = _SPINE_M + _AISLE_M
    straight_m, turn_m = 2 * half_m, np.pi * radius_m
    length_m = 2 * (straight_m + turn_m)
    count = round(length_m / SPEED_M_S * RATE_HZ) if frames is None else frames
    poses = []
    for walked_m in np.arange(count) * length_m / count:
        side, along_m = divmod(walked_m, straight_m + turn_m)
        sign = 1.0 if side == 0 else -1.0  # the second half is the first one, turned
        if along_m < straight_m:
            spine, out = along_m - half_m, np.array([0.0, -1.0])
        else:
            angle = (along_m - straight_m) / radius_m - np.pi / 2
            spine, out = half_m, np.array([np.cos(angle), np.sin(angle)])
        middle = np.array([spine, 0.0])
        eye, target = sign * (middle + radius_m * out), sign * (middle + (_SPINE_M if along_m < straight_m else 0.0) * out)
        poses.append(look_at(np.array([*eye, _EYE_M]), np.array([*target, _GAZE_M])))
    return Trajectory(np.round(np.arange(count) / RATE_HZ, 6), np.stack(poses))


def crowded_hall(
    seed: int, level: float, tables: int, laps: int, size_px: tuple[int, int], frames: int | None = None, cache: str | Path | None = None
) -> LongWalk:
    """Return so many laps around the hall, one after the other; ``frames`` are those of one lap. Nothing is drawn yet."""
    world = hall(seed, tables)
    reach_m = max(float(thing.bounds_world[1][0]) for thing in world.things if thing.kind == "anchor")
    lap = around(max(reach_m - 0.7, 0.1), frames)  # the straight parts end before the middle of the last table
    once = SimulatedRecording(
        f"hall of {tables} tables seed {seed}", Scene(world), lap, simulated_camera(*size_px), seed=seed, level=level, cache=cache
    )
    return LongWalk(once, laps * len(lap), np.arange(laps * len(lap)) % len(lap))
