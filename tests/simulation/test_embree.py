"""The Embree renderer and caster against closed forms and against the exact renderer."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from seo_slam.camera import Camera
from seo_slam.errors import ConfigError
from seo_slam.geometry import exp
from seo_slam.simulation import textures
from seo_slam.simulation.casting import PrimitiveCaster, caster_for, parts_of
from seo_slam.simulation.desk import build_desk
from seo_slam.simulation.embree import EmbreeCaster, EmbreeRenderer
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.meshes import MeshPaint, MeshShape
from seo_slam.simulation.primitives import Box, Ellipsoid, Frustum, RoomBox, Shape, Torus, cylinder
from seo_slam.simulation.renderer import SKY, render
from seo_slam.simulation.rendering import make_renderer
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.textures import Texture
from seo_slam.simulation.trajectory import look_at
from seo_slam.simulation.world import STRUCTURE_ID, Light, Part, Thing, World

CAMERA = Camera(110.0, 112.0, 63.0, 48.5, 128, 96)
DOWNWARD = np.diag([1.0, -1.0, -1.0, 1.0])
GREY = textures.mottled(("grey",), (0.5, 0.5, 0.5))
SHAPES: list[Shape] = [
    Box((0.3, 0.2, 0.4)),
    Ellipsoid((0.2, 0.25, 0.15)),
    Ellipsoid((0.2, 0.25, 0.15), flat_bottom=True),
    cylinder(0.15, 0.3),
    Frustum(0.1, 0.2, 0.3, top=False),
    Frustum(0.2, 0.05, 0.25),
    Torus(0.2, 0.05),
]
CLOSED = {0: 0.3 * 0.2 * 0.4, 1: 4 / 3 * np.pi * 0.2 * 0.25 * 0.15, 3: np.pi * 0.15**2 * 0.3, 6: 2 * np.pi**2 * 0.2 * 0.05**2}


def at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = (x, y, z)
    return T


def plain(*rgb: float) -> Texture:
    return Texture(np.array(rgb, dtype=np.float32)[None, None, None], (1.0, 1.0))


def world_of(*shapes_and_poses: tuple[Shape, np.ndarray], structure: tuple[Thing, ...] = (), texture: Texture = GREY) -> World:
    things = tuple(Thing(k + 1, f"thing {k + 1}", (Part(shape, texture, np.eye(4)),), T) for k, (shape, T) in enumerate(shapes_and_poses))
    return World(things, structure, Light(np.array([0.0, 0.0, 1.0])), np.zeros(3))


def square(size_m: float, paint: MeshPaint | None = None) -> MeshShape:
    half = size_m / 2
    return MeshShape(
        np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]]), np.array([[0, 1, 2], [0, 2, 3]]), paint
    )


# Triangles -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", range(len(SHAPES)))
def test_triangles_lie_on_the_surface_and_reach_as_far(index: int) -> None:
    shape = SHAPES[index]
    vertices, faces = shape.triangles()
    middles = vertices[faces].mean(axis=1)
    rng = np.random.default_rng(index)
    for direction in rng.normal(size=(20, 3)):
        direction /= np.linalg.norm(direction)
        assert -1e-9 < shape.support(direction) - (vertices @ direction).max() < 2e-4
    # A ray from just outside, along the exact normal, meets the surface where the triangle is.
    normals = shape.normals(middles)
    t = np.array([shape.intersect(p + 0.01 * n, -n[None])[0] for p, n in zip(middles[::7], normals[::7], strict=True)])
    assert np.abs(t - 0.01).max() < 2e-4


@pytest.mark.parametrize(("index", "volume_m3"), CLOSED.items())
def test_triangles_turn_outward_and_leave_no_hole(index: int, volume_m3: float) -> None:
    vertices, faces = SHAPES[index].triangles()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = float(np.sum(np.cross(a, b) * c) / 6.0)
    assert volume == pytest.approx(volume_m3, rel=0.02)


def test_shapes_without_triangles_say_so() -> None:
    class Odd(Box):
        triangles = Shape.triangles

    with pytest.raises(ConfigError, match="Odd"):
        Odd((1.0, 1.0, 1.0)).triangles()


# Casting ---------------------------------------------------------------------------------------------------------------------------


def test_rays_at_planes_have_exact_lengths() -> None:
    caster = EmbreeCaster(world_of((Box((1.0, 1.0, 1.0)), at(0, 0, 0.5)), (Box((0.2, 0.2, 0.2)), at(3, 0, 0.1))))
    starts = np.array([[0.1, 0.2, 4.0], [3.0, 0.0, 2.2], [9.0, 9.0, 9.0], [0.0, 0.0, 0.5]])
    directions = np.array([[0, 0, -1.0], [0, 0, -2.0], [0, 0, -1.0], [1.0, 0, 0]])
    hits = caster.cast(starts, directions)
    assert np.allclose(hits.t, [3.0, 1.0, np.inf, 0.5], atol=1e-6)  # the last one starts inside: both sides count
    assert hits.part.tolist() == [0, 1, -1, 0]


@pytest.mark.parametrize("shape", SHAPES)
def test_casters_agree(shape: Shape) -> None:
    world = world_of((shape, at(0.3, -0.2, 0.1) @ exp([0.4, -0.3, 0.8, 0, 0, 0])), (Box((2.0, 2.0, 0.1)), at(0, 0, -0.4)))
    rng = np.random.default_rng(5)
    starts = np.array([0.3, -0.2, 0.1]) + 2.0 * rng.normal(size=(2000, 3))
    aims = np.array([0.3, -0.2, 0.1]) + 0.15 * rng.normal(size=(2000, 3))
    embree, exact = EmbreeCaster(world).cast(starts, aims - starts), PrimitiveCaster(world).cast(starts, aims - starts)
    # At the very edge; and the exact torus, found step by step, lets some grazing rays through that do meet it.
    assert np.mean(embree.part != exact.part) < (6e-3 if isinstance(shape, Torus) else 2e-3)
    same = (embree.part == exact.part) & (exact.part >= 0)
    assert same.sum() > 500
    gap_m = np.abs(embree.t[same] - exact.t[same]) * np.linalg.norm(aims - starts, axis=1)[same]
    assert np.mean(gap_m > 2e-3) < 5e-3


def test_a_room_is_seen_from_inside_and_passed_from_outside() -> None:
    room = Thing(STRUCTURE_ID, "room", (Part(RoomBox((4.0, 4.0, 2.0)), GREY, np.eye(4)),), np.eye(4))
    world = world_of((Box((0.2, 0.2, 0.2)), np.eye(4)), structure=(room,))
    hits = EmbreeCaster(world).cast(np.array([[0, 1.0, 0], [-10.0, 1.0, 0], [-10.0, 0.0, 0.0]]), np.tile([1.0, 0, 0], (3, 1)))
    assert np.allclose(hits.t, [2.0, 12.0, 9.9], atol=1e-5)
    assert [parts_of(world)[k][0].label for k in hits.part] == ["room", "room", "thing 1"]


def test_a_cast_of_no_rays_and_a_world_of_nothing() -> None:
    nothing = World((), (), Light(np.array([0.0, 0.0, 1.0])), np.zeros(3))
    assert EmbreeCaster(nothing).cast(np.zeros((0, 3)), np.zeros((0, 3))).t.shape == (0,)
    assert EmbreeCaster(nothing).cast(np.zeros((2, 3)), np.ones((2, 3))).part.tolist() == [-1, -1]
    drawn = EmbreeRenderer()(nothing, CAMERA, np.eye(4))
    assert not drawn.depth_m.any()
    assert dict(drawn.covered_px) == {}


def test_worlds_with_meshes_get_the_embree_caster() -> None:
    assert isinstance(caster_for(world_of((square(1.0), np.eye(4)))), EmbreeCaster)


# Drawing ---------------------------------------------------------------------------------------------------------------------------


def test_the_renderers_agree_on_a_scene_of_primitives() -> None:
    world = build_desk(0)
    camera = simulated_camera(160, 120)
    for offset in ([-0.9, -1.0, 0.8], [0.7, -1.2, 0.5]):
        pose = look_at(world.gaze_world + np.array(offset), world.gaze_world)
        ours, exact = make_renderer("embree")(world, camera, pose), render(world, camera, pose)
        assert np.mean(ours.instance_ids != exact.instance_ids) < 1e-3
        assert np.mean(np.abs(ours.depth_m - exact.depth_m) > 0.005) < 1e-3
        gap = np.abs(ours.rgb.astype(np.float64) - exact.rgb)
        assert gap.mean() < 0.6
        assert np.mean(gap.max(axis=2) > 12) < 0.02  # shadows' edges, which only one of them smooths
        assert ours.covered_px.keys() == exact.covered_px.keys()
        for thing_id, count in exact.covered_px.items():
            assert abs(ours.covered_px[thing_id] - count) <= 2 + 0.01 * count


def test_rays_that_meet_nothing_are_sky() -> None:
    drawn = EmbreeRenderer()(world_of((Box((0.2, 0.2, 0.2)), at(0, 0, -3.0))), CAMERA, np.eye(4))
    assert not drawn.depth_m.any()
    assert (drawn.instance_ids == STRUCTURE_ID).all()
    assert np.abs(drawn.rgb - 255.0 * SKY).max() <= 0.51
    assert dict(drawn.covered_px) == {}


def test_distortion_is_honoured() -> None:
    bent = Camera(110.0, 112.0, 63.0, 48.5, 128, 96, (-0.2, 0.05, 0.001, -0.002, 0.0))
    world = world_of((Ellipsoid((0.3, 0.2, 0.2)), at(0.2, 0.1, 1.5)))
    ours, exact = EmbreeRenderer()(world, bent, np.eye(4)), render(world, bent, np.eye(4))
    assert np.mean(ours.instance_ids != exact.instance_ids) < 2e-3
    assert abs(ours.covered_px[1] - exact.covered_px[1]) <= 4
    straight = EmbreeRenderer()(world, CAMERA, np.eye(4))
    assert np.mean(straight.instance_ids != exact.instance_ids) > 2e-3


def test_what_a_thing_would_cover_does_not_depend_on_what_hides_it() -> None:
    far, near = (Ellipsoid((0.3, 0.3, 0.3)), at(0, 0, 2.0)), (Box((0.3, 0.3, 0.1)), at(0.05, 0, 1.2))
    beside = (Box((0.1, 0.1, 0.1)), at(0, 0, -2.0))  # behind the camera
    drawn = EmbreeRenderer()(world_of(far, near, beside), CAMERA, np.eye(4))
    alone = EmbreeRenderer()(world_of(far), CAMERA, np.eye(4))
    assert set(drawn.covered_px) == {1, 2}
    assert drawn.covered_px[1] == (alone.instance_ids == 1).sum() > (drawn.instance_ids == 1).sum()
    assert drawn.covered_px[2] == (drawn.instance_ids == 2).sum()


def test_shadows_fall_on_what_lies_below() -> None:
    ground = Thing(STRUCTURE_ID, "floor", (Part(Box((6.0, 6.0, 0.1)), plain(0.5, 0.5, 0.5), np.eye(4)),), at(0, 0, -0.05))
    world = world_of((Box((0.4, 0.4, 0.02)), at(0, 0, 1.0)), structure=(ground,))
    pose = look_at(np.array([0.0, -2.0, 0.5]), np.zeros(3))
    dark, bright = EmbreeRenderer()(world, CAMERA, pose, False), EmbreeRenderer(shadows=False)(world, CAMERA, pose, False)
    floor = dark.instance_ids == STRUCTURE_ID
    shaded = floor & (dark.rgb.astype(int) < bright.rgb.astype(int) - 20).all(axis=2)
    assert 20 < shaded.sum() < 0.2 * floor.sum()
    assert (dark.rgb[floor & ~shaded] == bright.rgb[floor & ~shaded]).all()


def test_edges_are_smooth_if_wanted() -> None:
    world = world_of((Ellipsoid((0.3, 0.3, 0.3)), at(0, 0, 1.5)), texture=plain(1.0, 0.0, 0.0))
    smooth, hard = (EmbreeRenderer()(world, CAMERA, np.eye(4), wanted) for wanted in (True, False))
    changed = (smooth.rgb != hard.rgb).any(axis=2)
    assert 0 < changed.sum() < 0.1 * changed.size
    assert (smooth.instance_ids == hard.instance_ids).all()
    assert (smooth.depth_m == hard.depth_m).all()


# Paint -----------------------------------------------------------------------------------------------------------------------------


def drawn_from_above(shape: Shape, texture: Texture = GREY) -> np.ndarray:
    """The square of 1 m from 1 m above, fully lit: x to the right, y up in the image."""
    camera = Camera(64.0, 64.0, 31.5, 31.5, 64, 64)
    world = World(
        (Thing(1, "square", (Part(shape, texture, np.eye(4), glow=1.0),), np.eye(4)),), (), Light(np.array([0, 0, 1.0])), np.zeros(3)
    )
    return EmbreeRenderer()(world, camera, at(0, 0, 1.0) @ DOWNWARD, False).rgb.astype(int)


def test_an_image_lies_the_right_way_up_on_a_mesh() -> None:
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32], image[:32, 32:], image[32:, :32] = (200, 0, 0), (0, 200, 0), (0, 0, 200)
    corners = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float32)  # right and down
    paint = MeshPaint(np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]]), np.zeros(2, dtype=np.int64), (image,))
    rgb = drawn_from_above(square(1.0, paint))
    assert np.abs(rgb[2:30, 2:30] - (200, 0, 0)).max() <= 1
    assert np.abs(rgb[2:30, 34:62] - (0, 200, 0)).max() <= 1
    assert np.abs(rgb[34:62, 2:30] - (0, 0, 200)).max() <= 1
    assert np.abs(rgb[34:62, 34:62]).max() <= 1


def test_tints_are_mixed_between_corners() -> None:
    tint = np.array([[[1, 0, 0], [0, 1, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [1, 0, 0]]], dtype=np.float32)  # red left, green right
    paint = MeshPaint(np.zeros((2, 3, 2), np.float32), np.zeros(2, dtype=np.int64), (np.full((1, 1, 3), 200, np.uint8),), tint)
    rgb = drawn_from_above(square(1.0, paint))
    share = (np.arange(64) + 0.5) / 64
    assert np.abs(rgb[..., 0] - 200 * (1 - share)).max() <= 2
    assert np.abs(rgb[..., 1] - 200 * share).max() <= 2


def test_a_fine_pattern_seen_from_afar_becomes_its_mean() -> None:
    checks = np.where(np.indices((256, 256)).sum(axis=0)[..., None] % 2 == 0, 255, 0).astype(np.uint8) * np.ones(3, np.uint8)
    corners = np.array([[0, 4], [4, 4], [4, 0], [0, 0]], dtype=np.float32)
    paint = MeshPaint(np.stack([corners[[0, 1, 2]], corners[[0, 2, 3]]]), np.zeros(2, dtype=np.int64), (checks,))
    assert np.abs(drawn_from_above(square(1.0, paint)) - 127.5).max() <= 2


def test_a_mesh_without_paint_wears_the_texture_of_its_part() -> None:
    texture = textures.cover(("cover",), (0.8, 0.2, 0.1), (0.1, 0.2, 0.8), (1.0, 1.0))
    bare, box = drawn_from_above(square(1.0), texture), drawn_from_above(Box((1.0, 1.0, 1e-5)), texture)
    assert np.abs(bare - box).mean() < 0.3
    assert np.abs(bare - box).max() < 16
    assert bare.std() > 10
    around = textures.bands(("bands",), (0.8, 0.2, 0.1), (0.1, 0.2, 0.8), 0.5)  # mapped around the axis: cannot be laid on triangles
    assert drawn_from_above(square(1.0), around).std() > 3


# Real meshes -----------------------------------------------------------------------------------------------------------------------

_PRINT_HASH = """
import hashlib, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from test_embree import hash_of_a_table
print(hash_of_a_table(Path(sys.argv[2])))
"""


def table_of(meshes: Path) -> World:
    """Three things on a table, two of them copies."""
    library = MeshLibrary(meshes)
    table = Thing(STRUCTURE_ID, "table", (Part(Box((1.2, 0.8, 0.04)), GREY, np.eye(4)),), at(0, 0, -0.02))
    places = (("ycb_mug", -0.2), ("ycb_mug", 0.0), ("ycb_cracker_box", 0.25))
    things = tuple(Thing(k + 1, library[name].label, library.parts(name), at(x, 0.05 * k, 0)) for k, (name, x) in enumerate(places))
    return World(things, (table,), Light(np.array([-0.4, -0.5, 0.77]) / np.linalg.norm([-0.4, -0.5, 0.77])), np.array([0.0, 0.0, 0.05]))


def hash_of_a_table(meshes: Path) -> str:
    world = table_of(meshes)
    drawn = EmbreeRenderer()(world, simulated_camera(160, 120), look_at(np.array([0.1, -0.6, 0.4]), world.gaze_world))
    return hashlib.sha256(
        drawn.rgb.tobytes() + drawn.depth_m.tobytes() + drawn.instance_ids.tobytes() + repr(dict(drawn.covered_px)).encode()
    ).hexdigest()


def test_every_process_draws_the_same_bytes(shared: Path) -> None:
    meshes = shared / "meshes" / "ycb"
    here = hash_of_a_table(meshes)
    command = [sys.executable, "-c", _PRINT_HASH, str(Path(__file__).parent), str(meshes)]
    there = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout.strip()
    assert here == there == hash_of_a_table(meshes)


def test_real_meshes_are_drawn_where_they_stand(shared: Path) -> None:
    world = table_of(shared / "meshes" / "ycb")
    camera = simulated_camera(160, 120)
    pose = look_at(np.array([0.1, -0.6, 0.4]), world.gaze_world)
    drawn = EmbreeRenderer()(world, camera, pose)
    points = (
        camera.back_project(np.stack(np.meshgrid(np.arange(160), np.arange(120)), axis=-1), drawn.depth_m) @ pose[:3, :3].T + pose[:3, 3]
    )
    for thing in world.things:
        seen = points[drawn.instance_ids == thing.id]
        low, high = thing.bounds_world
        assert len(seen) > 50
        assert (seen > low - 1e-3).all()
        assert (seen < high + 1e-3).all()
    mug, box = (drawn.rgb[drawn.instance_ids == k].mean(axis=0) for k in (2, 3))
    assert mug[0] > 2 * mug[1:].max()  # red enamel
    assert box[0] > 1.4 * box[1:].max()  # a red carton
    hits = EmbreeCaster(world).cast(np.array([[0.25, 0.1, 1.0]]), np.array([[0, 0, -1.0]]))
    assert hits.t[0] == pytest.approx(1.0 - world.things[2].bounds_world[1][2], abs=5e-3)
    assert hits.part[0] == 3
