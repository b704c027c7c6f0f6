"""Masks of the simulated detector: the visible pixels of a thing in its box; an ellipse where nothing is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.simulation import textures
from seo_slam.simulation.detector import DetectorKnobs, PhantomSpot, SimulatedBox, SimulatedDetector, View, octant
from seo_slam.simulation.masks import PackedMasks, Patch, patches_of, pixels_of
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.renderer import Rendered, render
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.trajectory import look_at
from seo_slam.simulation.world import Light, Part, Thing, World

CAMERA = simulated_camera(160, 120)
SIZE = (120, 160)
CUBE = (Part(Box((0.2, 0.2, 0.2)), textures.mottled(("a",), (0.5, 0.5, 0.5)), np.eye(4)),)


def pose(x: float, y: float = 0.0, turn: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    T[:2, 3] = (x, y)
    return T


def cubes(*x: float, label: str = "cup") -> World:
    things = tuple(Thing(k + 1, label, CUBE, pose(at)) for k, at in enumerate(x))
    return World(things, (), Light(np.array([0.0, 0.0, 1.0])), np.zeros(3))


def view_of(world: World, index: int = 0) -> View:
    T = look_at(np.array([0.0, -1.5, 0.5]), np.zeros(3))
    return View(index, world, CAMERA, T, render(world, CAMERA, T, smooth_edges=False))


def full(patch: Patch) -> np.ndarray:
    return PackedMasks([patch], *SIZE).unpacked()[0]


def touched(box_px: np.ndarray) -> np.ndarray:
    mask = np.zeros(SIZE, dtype=bool)
    mask[pixels_of(box_px)] = True
    return mask


def reported(knobs: DetectorKnobs, view: View, frames: int = 300, **options):
    detector = SimulatedDetector(knobs, 0, **options)
    return [detector.boxes(replace(view, index=index)) for index in range(frames)]


def test_masks_of_level_zero_are_the_instances() -> None:
    desk = SimulatedDesk(seed=1, frames=3, level=0.0)
    for frame in desk:
        detections = desk.detector.detect(frame)
        ids = desk.rendered(frame.index).instance_ids
        assert detections.masks is not None
        assert detections.masks.shape == (len(detections), 240, 320)
        for label, mask in zip(detections.labels, detections.masks, strict=True):
            (thing_id,) = set(np.unique(ids[mask]))
            assert desk.world.thing(int(thing_id)).label == label
            assert (mask == (ids == thing_id)).all()


def test_a_mask_is_what_of_the_thing_is_in_the_jittered_box() -> None:
    view = view_of(cubes(-0.3, 0.3))
    for boxes in reported(DetectorKnobs(box_jitter=0.1), view, 50):
        for box in boxes:
            assert box.patch is not None
            expected = (view.rendered.instance_ids == box.thing_ids[0]) & touched(box.box_px)
            assert (full(box.patch) == expected).all()


def test_a_merged_box_has_both_masks() -> None:
    view = view_of(cubes(-0.12, 0.12))
    merged = [boxes[0] for boxes in reported(DetectorKnobs(merge=1.0), view, 5)]
    assert all(box.thing_ids == (1, 2) for box in merged)
    assert (full(merged[0].patch) == np.isin(view.rendered.instance_ids, (1, 2))).all()


def test_halves_have_half_the_mask_and_doubles_the_same() -> None:
    view = view_of(cubes(0.0))
    own = view.rendered.instance_ids == 1
    kinds = set()
    for a, b in reported(DetectorKnobs(split=1.0), view, 40):
        first, second = full(a.patch), full(b.patch)
        if (a.box_px == b.box_px).all():
            kinds.add("twice")
            assert (first == own).all()
            assert (second == own).all()
        else:
            kinds.add("halves")
            assert ((first | second) == own).all()
            assert (first == (own & touched(a.box_px))).all()
            assert (first & second).any(axis=int(a.box_px[2] == b.box_px[2])).sum() <= 1  # but for the pixels that the cut goes through
            assert 0.1 < first.sum() / own.sum() < 0.9
    assert kinds == {"twice", "halves"}


def test_false_boxes_have_ellipses() -> None:
    view = view_of(cubes(0.5))
    loose = [box for boxes in reported(DetectorKnobs(spurious=2.0), view) for box in boxes if not box.thing_ids]
    assert loose
    for box in loose:
        mask = full(box.patch)
        assert not (mask & ~touched(box.box_px)).any()
        if min(box.box_px[2:] - box.box_px[:2]) > 12:
            assert mask.sum() == pytest.approx(np.pi / 4 * np.prod(box.box_px[2:] - box.box_px[:2]), rel=0.06)


def test_a_box_at_the_border_keeps_the_pixels_in_the_image() -> None:
    view = view_of(cubes(0.95))  # cut off at the right
    for boxes in reported(DetectorKnobs(box_jitter=0.05), view, 50):
        for box in boxes:
            assert box.box_px[2] <= CAMERA.width
            assert (full(box.patch) == ((view.rendered.instance_ids == 1) & touched(box.box_px))).all()
    assert view.rendered.instance_ids[:, -1].any()


def test_a_box_beside_its_thing_has_an_ellipse() -> None:
    patch = Patch(50, 60, np.ones((5, 5), dtype=bool))
    beside = SimulatedBox(np.array([10.0, 10.0, 30.0, 20.0]), "cup", 0.9, (1,), patch).finished(CAMERA)
    assert beside is not None
    assert beside.patch.pixels.shape == (10, 20)
    assert (beside.patch.row, beside.patch.column) == (10, 10)
    assert not beside.patch.pixels[0, 0]
    outside = SimulatedBox(np.array([-20.0, 10.0, 0.5, 20.0]), "cup", 0.9, (1,), patch)
    assert outside.finished(CAMERA) is None


@given(st.integers(0, 2**32 - 1))
def test_patches_are_the_ids_and_joining_is_or(seed: int) -> None:
    draws = np.random.default_rng(seed)
    ids = (draws.integers(0, 5, SIZE) * (draws.random(SIZE) < 0.01)).astype(np.int32)
    patches = patches_of(ids)
    assert set(patches) == set(np.unique(ids)) - {0}
    for thing_id, patch in patches.items():
        assert (full(patch) == (ids == thing_id)).all()
        assert patch.pixels[0].any()  # tight
        assert patch.pixels[-1].any()
        assert patch.pixels[:, 0].any()
        assert patch.pixels[:, -1].any()
    if len(patches) > 1:
        a, b = list(patches)[:2]
        assert (full(patches[a].joined(patches[b])) == np.isin(ids, (a, b))).all()
        low = draws.uniform(0, [100, 80])
        box_px = np.concatenate([low, low + draws.uniform(1, 40, 2)])
        inside = patches[a].inside(box_px)
        expected = (ids == a) & touched(box_px)
        assert (np.zeros(SIZE, dtype=bool) if inside is None else full(inside)).tolist() == expected.tolist()


@given(st.floats(0, 60), st.floats(0, 60), st.floats(1, 50), st.floats(1, 50))
def test_an_ellipse_is_never_empty_and_stays_in_its_box(x: float, y: float, width: float, height: float) -> None:
    box_px = np.array([x, y, x + width, y + height])
    mask = full(Patch.ellipse(box_px))
    assert mask.any()
    assert not (mask & ~touched(box_px)).any()


def test_a_whole_recording_of_masks_is_small() -> None:
    masks = [Patch(0, 0, np.ones((40, 40), dtype=bool))] * 15
    packed = PackedMasks(masks, 480, 640)
    assert sum(bits.nbytes for *_, bits in packed._packed) == 15 * 200
    assert packed.unpacked().sum() == 15 * 1600


def test_what_happens_to_a_thing_does_not_depend_on_the_others() -> None:
    knobs = replace(DetectorKnobs.at_level(1.0), merge=0.0, phantom_spots=0, spurious=0.0)
    both, one = view_of(cubes(-0.4, 0.4)), view_of(cubes(-0.4, 0.4).without(1))
    swapped = view_of(replace(both.world, things=both.world.things[::-1]))  # as after the first was moved to where it was
    rows = [
        [[(b.box_px.tolist(), b.label, b.score) for b in boxes if b.thing_ids == (2,)] for boxes in reported(knobs, view, 60)]
        for view in (both, one, swapped)
    ]
    assert rows[0] == rows[1] == rows[2]


def test_merging_does_not_depend_on_the_order_of_things() -> None:
    world = cubes(-0.12, 0.12)
    views = [view_of(w) for w in (world, replace(world, things=world.things[::-1]))]
    pairs = [[[box.thing_ids for box in boxes] for boxes in reported(DetectorKnobs(merge=0.35), view, 60)] for view in views]
    assert pairs[0] == pairs[1]


def test_a_side_turns_with_its_thing() -> None:
    view = view_of(cubes(0.0))
    thing = view.world.things[0]
    sides = [octant(thing.at(pose(0.0, turn=k * np.pi / 4 + 0.1)), view) for k in range(8)]
    assert sorted(sides) == list(range(8))


def test_look_alikes_are_found_in_any_case() -> None:
    view = view_of(cubes(0.0, label="cheez-it box"))
    words = {box.label for boxes in reported(DetectorKnobs(relabel=0.9, sticky=0.0), view, 60) for box in boxes}
    assert words == {"cheez-it box", "box", "snack"}


def test_a_thing_put_before_a_phantom_hides_it() -> None:
    wall = Thing(0, "wall", (Part(Box((6.0, 0.1, 4.0)), CUBE[0].texture, np.eye(4)),), pose(0.0, 1.0))
    before = replace(cubes(0.8), structure=(wall,))
    spot = PhantomSpot(np.array([0.0, 0.95, -0.3]), 0.2, "poster")
    after = before.with_thing(before.things[0].at(pose(0.0)))

    def posters(world: World) -> list[bool]:
        boxes = reported(DetectorKnobs(phantom_rate=0.35), view_of(world), 100, phantoms=[spot])
        return [any(box.label == "poster" for box in row) for row in boxes]

    seen = posters(before)
    assert 15 < sum(seen) < 60
    assert not any(posters(after))
    assert posters(after.with_thing(before.things[0])) == seen  # when it is gone again, the same phantom is back


def test_a_perfect_detector_needs_no_visibility() -> None:
    class Never(dict):
        def get(self, *_: object) -> int:
            raise AssertionError("covered pixels cost rays")

    view = view_of(cubes(0.0))
    shown = Rendered(view.rendered.rgb, view.rendered.depth_m, view.rendered.instance_ids, Never())
    assert len(SimulatedDetector().boxes(replace(view, rendered=shown))) == 1
