"""Masks that overlap: how much, which are one thing, which are news, and how they are parted."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from seo_slam.perception.colour_merge import colour_histograms, merged
from seo_slam.perception.mask_overlap import Masks, disjoint, mask_iou, shared_pixels
from seo_slam.perception.novel_segments import joined, novel, parted
from seo_slam.settings.hybrid import HybridSettings
from seo_slam.types import Detections

SIZE = (60, 80)
RED, BLUE = (200, 30, 20), (20, 40, 210)


def block(x0, y0, x1, y1):
    mask = np.zeros(SIZE, dtype=np.bool_)
    mask[y0:y1, x0:x1] = True
    return mask


def seen(*blocks, labels=None, scores=None, embeddings=None):
    labels = labels or tuple(f"thing {i}" for i in range(len(blocks)))
    scores = np.array(scores if scores is not None else np.linspace(0.9, 0.5, len(blocks)))
    return Detections(np.array(blocks, dtype=np.float64), labels, scores, np.array([block(*b) for b in blocks]), embeddings)


def painted(*rows):
    rgb = np.full((*SIZE, 3), 128, dtype=np.uint8)
    for (x0, y0, x1, y1), colour in rows:
        rgb[y0:y1, x0:x1] = colour
    return rgb


stacks = arrays(np.bool_, st.tuples(st.integers(0, 5), st.just(7), st.just(9)))


@given(a=stacks, b=stacks)
def test_shared_pixels_and_iou_are_those_of_counting(a, b):
    shared = shared_pixels(Masks(a), Masks(b))
    expected = (a[:, None] & b[None]).sum(axis=(2, 3))
    assert np.array_equal(shared, expected)
    union = (a[:, None] | b[None]).sum(axis=(2, 3))
    assert np.allclose(mask_iou(shared, Masks(a), Masks(b)), expected / np.maximum(union, 1))
    own = Masks(a)
    assert np.array_equal(shared_pixels(own, own), (a[:, None] & a[None]).sum(axis=(2, 3)))
    assert np.array_equal(own[np.arange(len(a))[::-1]].areas, a[::-1].sum(axis=(1, 2)))


@given(stacks)
def test_parted_masks_share_nothing_and_lose_nothing(pixels):
    out = disjoint(Masks(pixels))
    assert out.sum(axis=0).max(initial=0) <= 1
    assert np.array_equal(out.any(axis=0), pixels.any(axis=0))
    assert not (out & ~pixels).any()
    if len(pixels):
        smallest = int(np.argmin(pixels.sum(axis=(1, 2))))
        assert np.array_equal(out[smallest], pixels[smallest])


def test_the_larger_loses_the_overlap_and_small_ones_go():
    found = seen((0, 0, 40, 40), (30, 30, 50, 50), (70, 50, 72, 51), labels=("thing 0", "thing 1", None))
    out = parted(found, HybridSettings(smallest_px=300.0))  # 300 of 640x480 are 4.7 here
    assert out.labels == ("thing 0", "thing 1")
    assert out.masks.sum(axis=(1, 2)).tolist() == [1500, 400]
    assert len(parted(found, HybridSettings(smallest_px=0.0))) == 3


def test_a_word_lets_a_smaller_one_stay():
    found = seen((0, 0, 2, 1), (10, 0, 12, 1), (20, 0, 21, 1), labels=("peach", None, "pea"))  # 2, 2 and 1 pixels
    settings = HybridSettings(smallest_px=204.0, smallest_named_px=96.0)  # 3.2 and 1.5 here
    assert parted(found, settings).labels == ("peach",)


def test_a_mask_that_is_wholly_covered_goes():
    out = parted(seen((0, 0, 10, 10), (0, 0, 10, 10)), HybridSettings(smallest_px=0.0))
    assert out.labels == ("thing 0",)


def test_histograms_are_told_apart_by_colour_only():
    rgb = painted(((0, 0, 20, 20), RED), ((30, 0, 70, 40), RED), ((0, 30, 20, 50), BLUE))
    rows = colour_histograms(rgb, Masks(np.array([block(0, 0, 20, 20), block(30, 0, 70, 40), block(0, 30, 20, 50), block(0, 0, 0, 0)])))
    assert rows[0] @ rows[1] == pytest.approx(1.0)
    assert rows[0] @ rows[2] < 0.5
    assert not rows[3].any()


def test_a_thing_seen_twice_becomes_one_under_the_better_word():
    found = seen((10, 10, 40, 40), (11, 10, 41, 41), labels=("laptop", "monitor"), scores=(0.4, 0.8), embeddings=np.eye(2))
    one = merged(found, painted(), HybridSettings())
    assert one.labels == ("monitor",)
    assert one.scores.tolist() == [0.8]
    assert one.boxes_px.tolist() == [[10, 10, 41, 41]]
    assert np.array_equal(one.masks[0], found.masks.any(axis=0))
    assert one.embeddings.tolist() == [[0.0, 1.0]]


PARTS = ((0, 0, 30, 30), (15, 0, 45, 30))


@pytest.mark.parametrize(
    ("colours", "left"),
    [((RED, RED), 1), ((RED, BLUE), 2)],
)
def test_overlapping_boxes_merge_if_their_colours_are_alike(colours, left):
    rgb = painted(((0, 0, 22, 30), colours[0]), ((22, 0, 45, 30), colours[1]))
    assert len(merged(seen(*PARTS), rgb, HybridSettings(merge_colour=0.9))) == left


def test_alike_neighbours_whose_masks_are_apart_stay_two_unless_boxes_alone_decide():
    found = seen((0, 0, 30, 30), (15, 0, 45, 30))
    masks = np.array([block(0, 0, 20, 30), block(22, 0, 45, 30)])
    found = Detections(found.boxes_px, ("chair", "chair"), found.scores, masks)
    rgb = painted(((0, 0, 45, 30), RED))
    assert len(merged(found, rgb, HybridSettings())) == 2
    assert len(merged(found, rgb, HybridSettings(merge_by="boxes"))) == 1


def test_what_hangs_together_is_followed_from_box_to_box_and_the_order_is_kept():
    row = [(0, 20, 10, 30), (50, 0, 70, 10), (5, 20, 15, 30), (10, 20, 20, 30), (15, 20, 25, 30)]
    found = seen(*row, scores=(0.5, 0.9, 0.6, 0.7, 0.8))
    out = merged(found, painted(((0, 20, 25, 30), RED)), HybridSettings())
    assert out.labels == ("thing 1", "thing 4")
    assert out.boxes_px[1].tolist() == [0, 20, 25, 30]


@given(stacks.filter(len))
def test_merging_covers_the_same_pixels(pixels):
    n = len(pixels)
    boxes = np.tile([0.0, 0.0, 9.0, 7.0], (n, 1))
    out = merged(
        Detections(boxes, tuple("abcde"[:n]), np.linspace(0.1, 0.9, n), pixels), np.zeros((7, 9, 3), dtype=np.uint8), HybridSettings()
    )
    assert np.array_equal(out.masks.any(axis=0), pixels.any(axis=0))
    assert set(out.labels) <= set("abcde"[:n])


def test_news_is_what_overlaps_no_detection():
    known, nothing = Masks(np.array([block(0, 0, 40, 40)])), Masks(np.zeros((0, *SIZE), dtype=np.bool_))
    segments = [
        block(0, 0, 40, 30),  # most of it
        block(5, 5, 10, 10),  # inside it
        block(0, 0, 80, 60),  # around it
        block(35, 35, 55, 55),  # touches a corner
        block(60, 0, 70, 20),  # apart
        block(60, 0, 70, 19),  # the same again
        block(0, 0, 0, 0),
    ]
    news = novel(Masks(np.array(segments)), known, nothing, HybridSettings())
    assert news.tolist() == [False, False, False, True, True, False, False]
    assert novel(Masks(np.array(segments)), nothing, nothing, HybridSettings()).sum() == 5
    before_a_wall = novel(Masks(np.array(segments)), nothing, known, HybridSettings())
    assert before_a_wall.tolist() == [False, True, True, True, True, False, False]


def test_joined_rows_keep_their_embeddings():
    found, segments = seen((0, 0, 10, 10), embeddings=np.ones((1, 3))), seen((20, 20, 30, 30), labels=(None,))
    both = joined(found, segments)
    assert both.labels == ("thing 0", None)
    assert both.embeddings.tolist() == [[1.0, 1.0, 1.0], [0.0, 0.0, 0.0]]
    assert joined(seen((0, 0, 10, 10)), segments).embeddings is None
    assert joined(found, segments[np.array([False])]) is found
