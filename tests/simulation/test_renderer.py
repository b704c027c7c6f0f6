"""The ray caster against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.camera import Camera
from seo_slam.errors import ConfigError
from seo_slam.geometry import exp, inverse, transform_points
from seo_slam.simulation import textures
from seo_slam.simulation.desk import build_desk
from seo_slam.simulation.primitives import Box, Ellipsoid, Frustum, RoomBox, Shape, Torus, cylinder
from seo_slam.simulation.renderer import render
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.trajectory import look_at, swaying_arc
from seo_slam.simulation.world import Light, Part, Thing, World

CAMERA = Camera(110.0, 112.0, 63.0, 48.5, 128, 96)
GREY = textures.mottled(("grey",), (0.5, 0.5, 0.5))
SHAPES = [
    Box((0.3, 0.2, 0.4)),
    Ellipsoid((0.2, 0.25, 0.15)),
    Ellipsoid((0.2, 0.25, 0.15), flat_bottom=True),
    cylinder(0.15, 0.3),
    Frustum(0.1, 0.2, 0.3, top=False),
    Frustum(0.2, 0.05, 0.25),
    Torus(0.2, 0.05),
]


def world_of(*shapes_and_poses: tuple[Shape, np.ndarray], ambient: float = 0.5) -> World:
    things = tuple(Thing(k + 1, f"thing {k + 1}", (Part(shape, GREY, np.eye(4)),), T) for k, (shape, T) in enumerate(shapes_and_poses))
    return World(things, (), Light(np.array([0.0, 0.0, 1.0]), ambient), np.zeros(3))


def at(x: float, y: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = (x, y, z)
    return T


def test_plane_depth_is_constant() -> None:
    # A wall at right angles to the view: depth along z is the same everywhere, however slanted the ray.
    view = render(world_of((Box((9.0, 9.0, 1.0)), at(0, 0, 2.5))), CAMERA, np.eye(4))
    assert np.abs(view.depth_m - 2.0).max() < 1e-6
    assert (view.instance_ids == 1).all()


def test_tilted_plane_depth() -> None:
    tilt = exp([0.3, -0.2, 0.1, 0, 0, 0])
    T = at(0, 0, 3.0) @ tilt @ at(0, 0, 0.5)  # the middle of the near face lies at (0, 0, 3)
    view = render(world_of((Box((20.0, 20.0, 1.0)), T)), CAMERA, np.eye(4))
    normal = tilt[:3, 2]
    rays = np.concatenate([CAMERA.rays(), np.ones((96, 128, 1))], axis=-1)
    assert np.abs(view.depth_m - normal[2] * 3.0 / (rays @ normal)).max() < 1e-5


def test_sphere_depth_and_outline() -> None:
    centre, radius = np.array([0.1, -0.05, 1.5]), 0.3
    view = render(world_of((Ellipsoid((radius,) * 3), at(*centre))), CAMERA, np.eye(4))
    d = np.concatenate([CAMERA.rays(), np.ones((96, 128, 1))], axis=-1)
    a, b, c = (d * d).sum(-1), d @ centre, centre @ centre - radius**2
    under = b * b - a * c
    expected = np.where(under > 0, (b - np.sqrt(np.maximum(under, 0))) / a, 0.0)
    assert (view.instance_ids == 1).sum() == (under > 0).sum() == view.covered_px[1]
    assert np.abs(view.depth_m - expected).max() < 1e-6


def test_box_depth() -> None:
    view = render(world_of((Box((0.4, 0.2, 0.6)), at(0, 0, 1.3))), CAMERA, np.eye(4))
    v, u = np.nonzero(view.instance_ids)
    assert np.abs(view.depth_m[v, u] - 1.0).max() < 1e-6  # only its near face is seen
    left, right = CAMERA.project([-0.2, 0, 1.0])[0], CAMERA.project([0.2, 0, 1.0])[0]
    assert u.min() == np.ceil(left)
    assert u.max() == np.floor(right)


def test_open_cup_shows_its_inside() -> None:
    cup, lid = Frustum(0.2, 0.2, 0.3, top=False), Frustum(0.2, 0.2, 0.3)
    above = look_at(np.array([0.0, -1e-4, 1.0]), np.zeros(3))
    middle = np.s_[48, 63]
    assert render(world_of((cup, np.eye(4))), CAMERA, above).depth_m[middle] == pytest.approx(1.15, abs=1e-3)
    assert render(world_of((lid, np.eye(4))), CAMERA, above).depth_m[middle] == pytest.approx(0.85, abs=1e-3)


def test_room_is_seen_from_within() -> None:
    world = World(
        (), (Thing(0, "room", (Part(RoomBox((4.0, 6.0, 2.0)), GREY, np.eye(4)),), np.eye(4)),), Light(np.array([0.0, 0, 1])), np.zeros(3)
    )
    view = render(world, CAMERA, look_at(np.zeros(3), np.array([0.0, 1.0, 0.0])))
    assert view.depth_m[48, 63] == pytest.approx(3.0, abs=1e-6)
    assert (view.depth_m > 0).all()
    assert not view.instance_ids.any()


def test_nearer_thing_hides_the_other() -> None:
    both = world_of((Ellipsoid((0.2,) * 3), at(0, 0, 2)), (Box((0.2, 0.2, 0.2)), at(0, 0, 1)))
    view = render(both, CAMERA, np.eye(4))
    alone = render(both.without(2), CAMERA, np.eye(4))
    assert view.instance_ids[48, 63] == 2
    assert view.covered_px[1] == (alone.instance_ids == 1).sum() > (view.instance_ids == 1).sum()


@pytest.mark.parametrize("shape", SHAPES, ids=repr)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_hits_lie_on_the_surface(shape: Shape, seed: int) -> None:
    # Laws that need no other implementation: a hit is inside the bounds, and its normal is of unit length and, from outside,
    # faces the ray unless the shape is open.
    draws = np.random.default_rng(seed)
    start = draws.normal(size=3)
    start *= 1.5 / np.linalg.norm(start)
    low, high = shape.bounds()
    directions = draws.uniform(low, high, (200, 3)) - start
    t = shape.intersect(start, directions)
    hit = np.isfinite(t)
    assert hit.any()
    p = start + t[hit, None] * directions[hit]
    assert (p >= low - 1e-5).all()
    assert (p <= high + 1e-5).all()
    normals = shape.normals(p)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    is_closed = not (getattr(shape, "flat_bottom", False) or not getattr(shape, "top", True))
    if is_closed:
        assert ((normals * directions[hit]).sum(1) < 1e-3).all()
        again = shape.intersect(p + 1e-4 * directions[hit], directions[hit])
        assert np.isfinite(again).mean() > 0.9  # a solid is left again, but for rays that graze it
    # No point of the surface reaches farther than the support says.
    axis = draws.normal(size=3)
    assert (p @ axis <= shape.support(axis) + 1e-5).all()
    assert (p @ axis).max() <= shape.support(axis) + 1e-5


@pytest.mark.parametrize("shape", SHAPES, ids=repr)
def test_turned_shape_renders_like_a_turned_camera(shape: Shape) -> None:
    T = exp([0.4, -0.3, 0.8, 0.2, 0.1, -0.3])
    camera_pose = look_at(np.array([0.2, -1.0, 0.6]), np.zeros(3))
    still = render(world_of((shape, np.eye(4))), CAMERA, camera_pose)
    moved = render(world_of((shape, T)), CAMERA, T @ camera_pose)
    assert (still.instance_ids != moved.instance_ids).sum() <= 2  # rounding on the outline
    same = (still.instance_ids == 1) & (moved.instance_ids == 1)
    assert np.quantile(np.abs(still.depth_m - moved.depth_m)[same], 0.99) < 1e-4


def test_shadow_falls_below_the_light() -> None:
    floor, ball = (Box((4.0, 4.0, 0.2)), at(0, 0, -0.1)), (Ellipsoid((0.2,) * 3), at(0, 0, 1.0))
    view_from = look_at(np.array([0.0, -2.0, 0.7]), np.zeros(3))
    shaded, free = (render(world_of(*things), CAMERA, view_from, smooth_edges=False) for things in ([floor, ball], [floor]))
    u, v = np.round(CAMERA.project(transform_points(inverse(view_from), [0, 0, 0]))).astype(int)
    assert shaded.instance_ids[v, u] == 1
    assert shaded.rgb[v, u].mean() < 0.7 * free.rgb[v, u].mean()
    assert (shaded.rgb[90, 5] == free.rgb[90, 5]).all()  # far from the ball nothing changes


def test_smooth_edges_change_colour_only() -> None:
    world = world_of((Ellipsoid((0.3,) * 3), at(0, 0, 1.2)))
    hard, soft = (render(world, CAMERA, np.eye(4), smooth_edges=smooth) for smooth in (False, True))
    assert (hard.depth_m == soft.depth_m).all()
    assert (hard.instance_ids == soft.instance_ids).all()
    changed = (hard.rgb != soft.rgb).any(axis=2)
    assert 0 < changed.mean() < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_points_of_things_project_onto_their_own_pixels(seed: int) -> None:
    world, camera = build_desk(seed), simulated_camera()
    T_world_camera = swaying_arc(world.gaze_world, 5, seed).T_world_camera[2]
    view = render(world, camera, T_world_camera)
    v, u = np.nonzero(view.instance_ids)
    p_world = transform_points(T_world_camera, camera.back_project(np.stack([u, v], -1), view.depth_m[v, u]))
    for thing in world.things:
        own = p_world[view.instance_ids[v, u] == thing.id]
        low, high = thing.bounds_world
        assert (own >= low - 1e-5).all(), thing.label
        assert (own <= high + 1e-5).all(), thing.label
    assert len(np.unique(view.instance_ids)) > 12


def test_lens_distortion_is_honoured() -> None:
    bent = Camera(110.0, 112.0, 63.0, 48.5, 128, 96, (0.3, -0.3, 0.001, 0.002, 0.0))
    p_world = np.array([0.6, 0.35, 1.5])
    view = render(world_of((Ellipsoid((0.02,) * 3), at(*p_world))), bent, np.eye(4))
    v, u = np.nonzero(view.instance_ids)
    assert np.hypot(*(bent.project(p_world) - [u.mean(), v.mean()])) < 0.6
    assert np.hypot(*(CAMERA.project(p_world) - [u.mean(), v.mean()])) > 1.5


@pytest.mark.parametrize("make", [lambda: Box((0.1, 0.0, 0.1)), lambda: Frustum(0.1, -0.1, 0.2), lambda: Torus(np.nan, 0.1)])
def test_bad_sizes_are_refused(make) -> None:
    with pytest.raises(ConfigError, match="wanted metres above 0"):
        make()


def test_bad_worlds_are_refused() -> None:
    part = Part(Box((1.0, 1.0, 1.0)), GREY, np.eye(4))
    things = tuple(Thing(i, "a", (part,), np.eye(4)) for i in (1, 1))
    with pytest.raises(ConfigError, match="wanted different ones"):
        World(things, (), Light(np.array([0.0, 0, 1])), np.zeros(3))
    with pytest.raises(ConfigError, match="no parts"):
        Thing(1, "a", (), np.eye(4))
    with pytest.raises(ConfigError, match="got thing 7"):
        World(things[:1], (), Light(np.array([0.0, 0, 1])), np.zeros(3)).thing(7)
    with pytest.raises(ConfigError, match="not vertical"):
        look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3))
