"""Class-agnostic segments: what they cover, and how many are missed."""

from dataclasses import replace

import numpy as np
import pytest

from seo_slam.errors import FrameError
from seo_slam.interfaces import Detector
from seo_slam.simulation.detector import DetectorKnobs, View
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.segments import SimulatedSegmenter, surfaces_of

FRAMES = 400


def desk_view(level: float = 0.0) -> tuple[SimulatedDesk, View]:
    desk = SimulatedDesk(seed=3, frames=6, level=level)
    return desk, View(2, desk.world, desk.camera, desk.trajectory.T_world_camera[2], desk.rendered(2))


def test_perfect_segments_cover_the_image_once() -> None:
    desk = SimulatedDesk(seed=3, frames=6, level=0.0)
    segmenter = SimulatedSegmenter.of(desk)
    assert isinstance(segmenter, Detector)
    frame = desk.frame(2)
    found = segmenter.detect(frame)
    assert found.masks is not None
    covered = found.masks.sum(axis=0)
    assert covered.max() == 1
    assert (covered == 0).mean() < 0.005
    assert set(found.labels) == {None}
    ids = desk.rendered(2).instance_ids
    whole = [mask for mask in found.masks if ids[mask][0]]
    for mask in whole:
        assert (mask == (ids == ids[mask][0])).all()
    assert len(whole) == sum((ids == i).sum() >= 15 for i in range(1, 16))
    for mask, box_px in zip(found.masks, found.boxes_px, strict=True):
        v, u = np.nonzero(mask)
        assert box_px.tolist() == [u.min(), v.min(), u.max() + 1, v.max() + 1]


def test_the_top_of_the_desk_and_the_floor_are_segments_of_their_own() -> None:
    _, view = desk_view()
    surfaces = surfaces_of(view.rendered, view.camera)
    xy = view.camera.rays()
    p_camera = np.concatenate([xy, np.ones((*xy.shape[:2], 1))], axis=-1) * view.rendered.depth_m[..., None]
    height_m = (p_camera @ view.T_world_camera[:3, :3].T + view.T_world_camera[:3, 3])[..., 2]
    assert not surfaces[view.rendered.instance_ids != 0].any()
    structure = view.rendered.instance_ids == 0
    top, floor = (surfaces[structure & (np.abs(height_m - z) < 0.002)] for z in (0.75, 0.0))
    chosen = [int(np.bincount(part).argmax()) for part in (top, floor)]
    assert chosen[0] != chosen[1]
    for part, surface, z in ((top, chosen[0], 0.75), (floor, chosen[1], 0.0)):
        assert (part == surface).sum() > 0.5 * len(part)
        assert (np.abs(height_m[surfaces == surface] - z) < 0.002).mean() > 0.95  # but for a pixel along its edges


def test_misses_follow_the_knob() -> None:
    _, view = desk_view()
    counts = []
    for knobs in (DetectorKnobs(), DetectorKnobs(miss=0.3)):
        segmenter = SimulatedSegmenter(knobs)
        counts.append(sum(1 for index in range(FRAMES // 10) for _ in segmenter._found(replace(view, index=index))))
    share = counts[1] / counts[0]
    assert share == pytest.approx(0.7, abs=5 * np.sqrt(0.21 / counts[0]))


def test_small_segments_are_missed_more_and_the_smallest_never_found() -> None:
    _, view = desk_view()
    segmenter = SimulatedSegmenter(DetectorKnobs(visibility=1.0))
    areas = np.array([patch.pixels.sum() for index in range(40) for _, patch in segmenter._found(replace(view, index=index))])
    everything = np.array([patch.pixels.sum() for _, patch in SimulatedSegmenter()._found(view)])
    assert areas.min() >= 15
    small, large = everything < 60, everything > 600
    assert (areas < 60).sum() < 0.75 * 40 * small.sum()
    assert (areas > 600).sum() == 40 * large.sum()


def test_segments_do_not_depend_on_the_order_of_calls_and_need_to_be_shown() -> None:
    a, b = SimulatedDesk(frames=3, level=1.0), SimulatedDesk(frames=3, level=1.0)
    first, second = SimulatedSegmenter.of(a), SimulatedSegmenter.of(b)
    frames = list(a)
    late = b.frame(2)
    one, two = first.detect(frames[2]), second.detect(late)
    assert (one.boxes_px == two.boxes_px).all()
    assert (one.masks == two.masks).all()
    with pytest.raises(FrameError, match="not a frame that was shown"):
        second.detect(frames[0])
