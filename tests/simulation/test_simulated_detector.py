"""Rates of the simulated detector against its knobs."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam.errors import ConfigError, FrameError
from seo_slam.geometry import inverse, transform_points
from seo_slam.interfaces import Detector
from seo_slam.simulation import textures
from seo_slam.simulation.detector import DetectorKnobs, PhantomSpot, SimulatedDetector, View, octant
from seo_slam.simulation.labels import LOOK_ALIKES
from seo_slam.simulation.primitives import Box
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.renderer import render
from seo_slam.simulation.simulated_recording import simulated_camera
from seo_slam.simulation.trajectory import look_at
from seo_slam.simulation.world import Light, Part, Thing, World

FRAMES = 1500
CAMERA = simulated_camera(160, 120)
SHARE = 640 * 480 / (160 * 120)


def cups(apart_m: float = 0.6, ids: tuple[int, ...] = (1, 2), label: str = "cup") -> World:
    part = Part(Box((0.2, 0.2, 0.2)), textures.mottled(("a",), (0.5, 0.5, 0.5)), np.eye(4))
    things = []
    for k, i in enumerate(ids):
        T = np.eye(4)
        T[0, 3] = (k - (len(ids) - 1) / 2) * apart_m
        things.append(Thing(i, label, (part,), T))
    return World(tuple(things), (), Light(np.array([0.0, 0.0, 1.0])), np.zeros(3))


def view_of(world: World, angle_rad: float = -np.pi / 2) -> View:
    T = look_at(np.array([1.5 * np.cos(angle_rad), 1.5 * np.sin(angle_rad), 0.5]), np.zeros(3))
    return View(0, world, CAMERA, T, render(world, CAMERA, T, smooth_edges=False))


def many(knobs: DetectorKnobs, world: World, angle_rad: float = -np.pi / 2, seed: int = 0, **options):
    view = view_of(world, angle_rad)
    detector = SimulatedDetector(knobs, seed, **options)
    return [detector.boxes(replace(view, index=index)) for index in range(FRAMES)]


def bound(p: float, n: int) -> float:
    """Five standard deviations of a share, so that only a wrong rate fails."""
    return 5 * np.sqrt(p * (1 - p) / n)


def test_level_zero_gives_perfect_boxes() -> None:
    desk = SimulatedDesk(seed=1, frames=6, level=0.0)
    for frame in desk:
        detections = desk.detector.detect(frame)
        view = render(desk.world, desk.camera, desk.trajectory.T_world_camera[frame.index])
        expected = set()
        for thing in desk.world.things:
            v, u = np.nonzero(view.instance_ids == thing.id)
            if len(u) >= 15:  # 60 pixels at 640x480
                expected.add((thing.label, float(u.min()), float(v.min()), float(u.max() + 1), float(v.max() + 1)))
        assert {(label, *box) for label, box in zip(detections.labels, detections.boxes_px.tolist(), strict=True)} == expected
        assert len(detections) == len(expected)


def test_misses() -> None:
    found = sum(len(boxes) for boxes in many(DetectorKnobs(miss=0.12), cups()))
    assert found / (2 * FRAMES) == pytest.approx(0.88, abs=bound(0.12, 2 * FRAMES))


def test_small_and_hidden_things_are_missed_more() -> None:
    wall = Part(Box((0.5, 0.02, 0.34)), textures.mottled(("a",), (0.5, 0.5, 0.5)), np.eye(4))
    T = np.eye(4)
    T[:3, 3] = (-0.30, -0.5, 0.1)
    hidden = cups().with_thing(Thing(9, "screen", (wall,), T))
    counts = dict.fromkeys((1, 2, 9), 0)
    for boxes in many(DetectorKnobs(visibility=1.0), hidden):
        for box in boxes:
            counts[box.thing_ids[0]] += 1
    assert counts[2] > 0.98 * FRAMES
    assert counts[9] > 0.98 * FRAMES
    assert counts[1] < 0.8 * FRAMES


def test_too_few_pixels_are_never_detected() -> None:
    tiny = cups(ids=(1,))
    view = view_of(tiny)
    assert SimulatedDetector(DetectorKnobs()).boxes(view)
    pixels = int((view.rendered.instance_ids == 1).sum())
    assert not SimulatedDetector(DetectorKnobs(smallest_px=SHARE * (pixels + 1))).boxes(view)
    assert SimulatedDetector(DetectorKnobs(smallest_px=SHARE * (pixels - 1))).boxes(view)


def test_labels_are_confused_among_look_alikes() -> None:
    # Fresh draws only: the rate in the frames of one seed is the knob.
    labels = [box.label for boxes in many(DetectorKnobs(relabel=0.22, sticky=0.0), cups()) for box in boxes]
    wrong = [label for label in labels if label != "cup"]
    assert len(wrong) / len(labels) == pytest.approx(0.22, abs=bound(0.22, len(labels)))
    assert set(wrong) == set(LOOK_ALIKES["cup"])


def test_sticky_labels_belong_to_thing_and_side() -> None:
    knobs = DetectorKnobs(relabel=0.22, sticky=1.0)
    wrong = total = 0
    views = [view_of(cups(), angle) for angle in np.arange(8) * np.pi / 4 + 0.2]
    for seed in range(40):
        for view in views:
            detector = SimulatedDetector(knobs, seed)
            per_thing = [
                {box.label for index in range(4) for box in detector.boxes(replace(view, index=index)) if i in box.thing_ids}
                for i in (1, 2)
            ]
            assert all(len(words) <= 1 for words in per_thing)  # the same in every frame
            wrong += sum(words != {"cup"} for words in per_thing if words)
            total += sum(bool(words) for words in per_thing)
    assert wrong / total == pytest.approx(0.22, abs=bound(0.22, total))


def test_octants_change_with_the_side() -> None:
    world = cups(ids=(1,))
    sides = [octant(world.things[0], view_of(world, angle)) for angle in np.arange(8) * np.pi / 4 + 0.2]
    assert sorted(sides) == list(range(8))


def test_box_jitter() -> None:
    exact = many(DetectorKnobs(), cups(ids=(1,)))[0][0].box_px
    boxes = np.array([b[0].box_px for b in many(DetectorKnobs(box_jitter=0.04), cups(ids=(1,)))])
    share = (boxes - exact) / np.tile(exact[2:] - exact[:2], 2)
    assert share.std(axis=0) == pytest.approx(0.04, rel=0.12)
    assert np.abs(share.mean(axis=0)).max() < 5 * 0.04 / np.sqrt(FRAMES)


def test_neighbours_of_one_class_merge() -> None:
    near, far = cups(apart_m=0.25), cups(apart_m=0.8)
    joined = sum(len(boxes) == 1 and boxes[0].thing_ids == (1, 2) for boxes in many(DetectorKnobs(merge=0.35), near))
    assert joined / FRAMES == pytest.approx(0.35, abs=bound(0.35, FRAMES))
    assert all(len(boxes) == 2 for boxes in many(DetectorKnobs(merge=0.35), far)[:200])
    other = World((near.things[0], replace(near.things[1], label="bowl")), (), near.light, near.gaze_world)
    assert all(len(boxes) == 2 for boxes in many(DetectorKnobs(merge=0.35), other)[:200])


def test_splits_and_doubles() -> None:
    runs = many(DetectorKnobs(split=0.2), cups(ids=(1,)))
    two = [boxes for boxes in runs if len(boxes) == 2]
    assert len(two) / FRAMES == pytest.approx(0.2, abs=bound(0.2, FRAMES))
    doubled = sum((a.box_px == b.box_px).all() for a, b in two)
    assert doubled / len(two) == pytest.approx(0.5, abs=bound(0.5, len(two)))
    exact = many(DetectorKnobs(), cups(ids=(1,)))[0][0].box_px
    for a, b in two:  # together they are the thing
        assert (np.minimum(a.box_px, b.box_px)[:2] == exact[:2]).all()
        assert (np.maximum(a.box_px, b.box_px)[2:] == exact[2:]).all()


def test_spurious_boxes() -> None:
    loose = [box for boxes in many(DetectorKnobs(spurious=0.15), cups()) for box in boxes if not box.thing_ids]
    assert len(loose) / FRAMES == pytest.approx(0.15, abs=5 * np.sqrt(0.15 / FRAMES))


def test_phantom_rate_and_place() -> None:
    world = cups(apart_m=1.0)
    wall = Thing(0, "wall", (Part(Box((6.0, 0.1, 4.0)), textures.mottled(("w",), (0.5, 0.5, 0.5)), np.eye(4)),), np.eye(4))
    T = np.eye(4)
    T[1, 3] = 1.0
    world = replace(world, structure=(wall.at(T),))
    spot = PhantomSpot(np.array([0.1, 0.95, 0.3]), 0.2, "poster")
    view = view_of(world)
    runs = many(DetectorKnobs(phantom_rate=0.35), world, phantoms=[spot])
    posters = [box for boxes in runs for box in boxes if box.label == "poster"]
    assert len(posters) / FRAMES == pytest.approx(0.35, abs=bound(0.35, FRAMES))
    uv = CAMERA.project(transform_points(inverse(view.T_world_camera), spot.p_world))
    assert np.abs((posters[0].box_px[:2] + posters[0].box_px[2:]) / 2 - uv).max() < 0.02
    hidden = replace(spot, p_world=np.array([0.1, 1.6, 0.3]))  # behind the wall
    assert not any(box.label == "poster" for boxes in many(DetectorKnobs(), world, phantoms=[hidden])[:50] for box in boxes)


def test_draws_do_not_depend_on_the_order_of_calls() -> None:
    desk = SimulatedDesk(seed=2, frames=4, level=1.0)
    forward = [desk.detector.detect(frame) for frame in desk]
    again = SimulatedDesk(seed=2, frames=4, level=1.0)
    for index in (3, 1):
        detections = again.detector.detect(again.frame(index))
        assert (detections.boxes_px == forward[index].boxes_px).all()
        assert detections.labels == forward[index].labels


def test_is_a_detector_and_knows_only_what_it_was_shown() -> None:
    desk, other = SimulatedDesk(frames=2), SimulatedDesk(frames=2)
    assert isinstance(desk.detector, Detector)
    frame = desk.frame(1)
    with pytest.raises(FrameError, match="not a frame that was shown"):
        other.detector.detect(frame)


def test_knobs_of_the_reference_level() -> None:
    knobs = DetectorKnobs.at_level(1.0)
    assert (knobs.miss, knobs.relabel, knobs.sticky, knobs.box_jitter, knobs.merge, knobs.split) == (0.12, 0.22, 0.7, 0.04, 0.35, 0.06)
    assert (knobs.phantom_spots, knobs.phantom_rate, knobs.spurious, knobs.smallest_px) == (6, 0.35, 0.15, 60)
    assert DetectorKnobs.at_level(0) == DetectorKnobs()
    assert DetectorKnobs.at_level(0.5).phantom_spots == 3
    with pytest.raises(ConfigError, match="level"):
        DetectorKnobs.at_level(-1)
