"""The six rooms: what stands in them, where, what changes, and how the camera walks."""

import functools
import subprocess
import sys
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.simulation import room_models, room_plan, textures
from seo_slam.simulation.casting import Caster, PrimitiveCaster
from seo_slam.simulation.catalogue import Key, pose
from seo_slam.simulation.detector import DetectorKnobs
from seo_slam.simulation.inventories import INVENTORIES, ROOMS, SYNONYMS, inventory
from seo_slam.simulation.labels import LOOK_ALIKES
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.placement import gap_m, linked
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.rendering import make_renderer
from seo_slam.simulation.room_path import WALK_S
from seo_slam.simulation.room_plan import RoomPlan, plan_room
from seo_slam.simulation.rooms import SimulatedRoom
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.stand_ins import STAND_INS
from seo_slam.simulation.world import Part, Thing, World

every_room = pytest.mark.parametrize("room", ROOMS)
every_seed = pytest.mark.parametrize("seed", range(5))


@functools.cache
def plan(room: str, seed: int) -> RoomPlan:
    """A room for tests that look at places only: paint without its blurred copies, which take half of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(textures, "from_image", lambda image, *rest: textures.Texture(image[None], *rest))
        return plan_room(room, seed)


def after(planned: RoomPlan) -> World:
    world = planned.start
    for event, thing in planned.changes:
        world = world.without(thing.id) if event == "removed" else world.with_thing(thing)
    return world


def untouched(planned: RoomPlan) -> list[Thing]:
    touched = {thing.id for _, thing in planned.changes}
    return [thing for thing in planned.start.things if thing.id not in touched]


def assert_apart(world: World) -> None:
    for a, b in combinations(world.things, 2):
        assert gap_m(a, b) >= 0.02, (a.label, b.label)
    for thing in world.things:
        low, high = thing.bounds_world
        assert np.linalg.norm(np.clip(0.0, low, high)) > 0.5, thing.label  # nowhere near the origin


def assert_copies_together(things: list[Thing]) -> None:
    for label in {thing.label for thing in things}:
        assert linked([thing for thing in things if thing.label == label], 0.2), label


def assert_rests(world: World, caster: Caster) -> None:
    """Under the base of each thing, at five places of its box, there is a surface within a few millimetres."""
    for thing in world.things:
        low, high = thing.bounds_world
        if thing.label == "electric outlet":
            start, direction, reach = np.array([[thing.p_world[0], high[1] - 0.05, thing.p_world[2]]]), np.array([[0.0, 1.0, 0.0]]), 0.05
        else:
            xy = np.array([[0.5, 0.5], [0.05, 0.05], [0.95, 0.05], [0.05, 0.95], [0.95, 0.95]])
            start = np.column_stack([low[:2] + xy * (high - low)[:2], np.full(len(xy), low[2] + 0.05)])
            direction, reach = np.tile([0.0, 0.0, -1.0], (len(xy), 1)), 0.05
        hits = caster.cast(start, direction)
        assert np.abs(hits.t - reach).max() < 0.005, thing.label


def test_inventories_add_up() -> None:
    assert {room: sum(INVENTORIES[room].values()) for room in ROOMS} == {"SM1": 11, "SM2": 11, "MD1": 21, "MD2": 20, "LG1": 32, "LG2": 29}
    labels = {label for listed in INVENTORIES.values() for label in listed}
    assert labels == set(STAND_INS)
    assert labels <= set(LOOK_ALIKES)
    assert set(SYNONYMS) <= labels


@pytest.mark.parametrize("label", sorted(STAND_INS))
def test_stand_ins_stand_and_have_a_believable_size(label: str) -> None:
    sizes = {"chair": (0.7, 1.1), "racquet": (0.6, 0.8), "monitor": (0.4, 0.6), "apple": (0.07, 0.1), "teacup": (0.06, 0.15)}
    low, high = room_models._stand_in(label, (0, "test", label)).bounds
    assert low[2] == pytest.approx(0.0, abs=1.01e-3)
    assert (low + high)[:2] == pytest.approx([0.0, 0.0], abs=2.01e-3)
    least, most = sizes.get(label, (0.08, 0.6))
    assert least < (high - low).max() < most


@every_room
@every_seed
def test_room_holds_its_inventory_in_places(room: str, seed: int) -> None:
    planned = plan(room, seed)
    start, end = planned.start, after(planned)
    assert Counter(thing.label for thing in start.things) == inventory(room)
    assert [thing.id for thing in start.things] == list(range(1, len(start.things) + 1))
    caster = PrimitiveCaster(World((), start.structure, start.light, start.gaze_world))
    for world in (start, end):
        assert_apart(world)
        assert_rests(world, caster)
    assert_copies_together(list(start.things))
    assert_copies_together(untouched(planned))


@every_room
@every_seed
def test_two_things_go_and_three_move(room: str, seed: int) -> None:
    planned = plan(room, seed)
    assert [event for event, _ in planned.changes] == ["removed"] * 2 + ["moved"] * 3
    assert len({thing.id for _, thing in planned.changes}) == 5
    for event, thing in planned.changes:
        assert thing.kind == "volatile"
        assert thing.label not in ("electric outlet", "chair", "bin")
        before = planned.start.thing(thing.id)
        moved_m = np.linalg.norm(thing.p_world - before.p_world)
        assert moved_m == 0 if event == "removed" else moved_m >= 0.3
        assert thing.parts is before.parts


@every_room
@every_seed
def test_walk_is_slow_level_and_clear_of_everything(room: str, seed: int) -> None:
    planned = plan(room, seed)
    path = planned.walk.trajectory(400)  # also between the frames
    T, rate_hz = path.T_world_camera, 399 / WALK_S
    p = T[:, :3, 3]
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) * rate_hz
    assert speed.max() <= 0.6
    assert np.abs(np.diff(speed)).max() * rate_hz < 0.5  # m/s^2
    turned = np.einsum("nij,nij->n", T[1:, :3, :3], T[:-1, :3, :3])
    assert np.degrees(np.arccos(np.clip((turned - 1.0) / 2.0, -1.0, 1.0))).max() * rate_hz <= 40
    assert np.allclose(T[:, 2, 0], 0.0)
    assert p[:, 2].min() >= 1.2
    assert p[:, 2].max() <= 1.7
    room_low, room_high = planned.start.structure[0].bounds_world
    assert (p > room_low + 0.25).all()
    assert (p < room_high - 0.25).all()
    for world in (planned.start, after(planned)):
        boxes = np.array([thing.bounds_world for thing in (*world.things, *world.structure[2:])])
        away = np.maximum(np.maximum(boxes[None, :, 0] - p[:, None], p[:, None] - boxes[None, :, 1]), 0.0)
        assert np.linalg.norm(away, axis=-1).min() >= 0.25
        contents = np.array([thing.p_world for thing in world.things if thing.p_world[2] > 0.6 and thing.kind == "volatile"])
        nearest = np.linalg.norm(p[:, None] - contents, axis=-1).min(axis=1)
        assert nearest.min() >= 1.2
        assert nearest.max() <= 2.8


@every_room
def test_everything_is_seen_before_and_after_the_change(room: str) -> None:
    """By another renderer than the one that judged the layout, at other times, in at least 0.15 of the frames."""
    planned = plan(room, 0)
    renderer, camera = make_renderer("auto"), simulated_camera(160, 120)
    enough_px = 2.0 * DetectorKnobs().smallest_px * camera.width * camera.height / (640 * 480)
    path = planned.walk.trajectory(40)
    for world, poses in ((planned.start, path.T_world_camera[:20]), (after(planned), path.T_world_camera[20:])):
        seen = Counter[int]()
        for T_world_camera in poses:
            ids, counts = np.unique(renderer(world, camera, T_world_camera, smooth_edges=False).instance_ids, return_counts=True)
            seen.update(int(i) for i, count in zip(ids, counts, strict=True) if count >= enough_px)
        for thing in world.things:
            assert seen[thing.id] >= 0.15 * len(poses), thing.label


def test_recording_changes_between_two_frames() -> None:
    recording = SimulatedRoom("SM2", 1, frames=7, width=64, height=48, renderer="primitive")
    stamps = recording.trajectory.timestamps_s
    assert stamps[[0, -1]] == pytest.approx([0.0, WALK_S], abs=1e-6)
    (change_s,) = {change.timestamp_s for change in recording.scene.changes}
    assert stamps[3] < change_s < stamps[4]
    assert len(recording.truth["objects"]) == 9
    assert sorted(row["event"] for row in recording.truth["timeline"]) == ["moved"] * 3 + ["removed"] * 2
    frame = recording.frame(6)
    assert frame.rgb.shape == (48, 64, 3)
    assert set(recording.detector.detect(frame).labels)


def test_fewer_frames_or_no_changes_are_the_same_room() -> None:
    many, few = SimulatedRoom("SM1", 2, frames=21), SimulatedRoom("SM1", 2, frames=11, changes=False, level=0.0)
    assert np.allclose(many.trajectory.T_world_camera[::2], few.trajectory.T_world_camera, atol=1e-5)
    assert not few.scene.changes
    for a, b in zip(many.scene.start.things, few.scene.start.things, strict=True):
        assert (a.T_world_thing == b.T_world_thing).all()


_FINGERPRINT = """
import hashlib
from seo_slam.simulation.rooms import SimulatedRoom
room = SimulatedRoom("SM1", 4, frames=4, width=64, height=48, renderer="primitive")
digest = hashlib.sha256(room.trajectory.T_world_camera.tobytes() + room.odometry.T_world_camera.tobytes())
for world in room.scene.worlds:
    for thing in world.things:
        digest.update(f"{thing.id} {thing.label} {thing.model}".encode() + thing.T_world_thing.tobytes())
for frame in room:
    digest.update(frame.rgb.tobytes() + frame.depth_m.tobytes())
"""


def test_same_seed_same_bytes_in_every_process() -> None:
    here: dict = {}
    exec(_FINGERPRINT, here)
    there = subprocess.run(
        [sys.executable, "-c", _FINGERPRINT + "print(digest.hexdigest())"],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONHASHSEED": "7", "PATH": ""},
    )
    assert there.stdout.strip() == here["digest"].hexdigest()


def test_seeds_differ() -> None:
    a, b = plan("SM1", 0), plan("SM1", 1)
    assert not np.allclose([t.p_world for t in a.start.things], [t.p_world for t in b.start.things])
    assert {thing.label for _, thing in a.changes} != {thing.label for _, thing in b.changes}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"room": "SM3"}, "room: got 'SM3', wanted one of SM1, SM2, MD1, MD2, LG1, LG2; did you mean 'SM"),
        ({"room": "lg2"}, "did you mean 'LG2'"),
        ({"frames": 1}, "frames: got 1"),
        ({"level": -0.5}, "level: got -0.5"),
        ({"width": 8}, "image size"),
    ],
)
def test_bad_arguments(arguments: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        SimulatedRoom(**arguments)


def test_a_thing_without_a_place_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def huge(key: Key) -> tuple[Part, ...]:
        return (Part(Box((3.0, 3.0, 0.2)), textures.mottled(key, (0.5, 0.5, 0.5)), pose(z=0.1)),)

    monkeypatch.setitem(STAND_INS, "helmet", huge)
    monkeypatch.setattr(room_plan, "_LAYOUTS", 2)
    with pytest.raises(ConfigError, match="room SM1, seed 3: no free place for the helmet"):
        plan_room("SM1", 3)


def test_mesh_folders_that_do_not_do(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="manifest"):
        SimulatedRoom("SM1", meshes=tmp_path)
    (tmp_path / "manifest.json").write_text("[]")
    with pytest.raises(ConfigError, match="room SM1: got no mesh with the label 'bag'"):
        SimulatedRoom("SM1", meshes=tmp_path)


@pytest.mark.parametrize(("room", "seed"), [("SM2", 0), ("LG2", 2)])
def test_rooms_of_meshes(shared: Path, room: str, seed: int) -> None:
    from seo_slam.simulation.embree import EmbreeCaster

    planned = plan_room(room, seed, MeshLibrary(shared / "meshes"))
    start, end = planned.start, after(planned)
    assert Counter(thing.label for thing in start.things) == inventory(room)
    assert all(part.shape.is_mesh for thing in start.things for part in thing.parts)
    caster = EmbreeCaster(World((), start.structure, start.light, start.gaze_world))
    for world in (start, end):
        assert_apart(world)
        assert_rests(world, caster)
    assert_copies_together(untouched(planned))
    for thing in start.things:
        assert not {"toy", "box", "tool", "figure", "fruit", "ball"} & {thing.label, *thing.accepted_labels}


def test_tables_can_be_things_of_their_own():
    plain = SimulatedRoom("SM1", 0, frames=2, changes=False)
    named = SimulatedRoom("SM1", 0, frames=2, changes=False, tables_are_things=True)
    known = {thing.id for thing in plain.scene.start.things}
    tables = [thing for thing in named.scene.start.things if thing.id not in known]
    assert tables
    assert {thing.kind for thing in tables} == {"anchor"}
    assert len(named.scene.start.structure) + len(tables) == len(plain.scene.start.structure)
    assert {thing.label for thing in named.scene.start.structure} == {"room", "floor"}
    assert named.name != plain.name
