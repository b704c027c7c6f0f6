"""Laws of axis-aligned boxes, and the rules that make one box of two."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.perception.boxes import areas, containment, intersections, iou, truncated_sides
from seo_slam.perception.fusion import coincident, distinct
from seo_slam.testing.worlds import tiny_observations
from seo_slam.types import Detections


@st.composite
def boxes(draw, most=5):
    """(N, 4) boxes with whole-pixel corners on a small grid, so that touching and equal ones come often."""
    corner = st.integers(0, 12)
    side = st.integers(1, 8)
    rows = draw(st.lists(st.tuples(corner, corner, side, side), max_size=most))
    return np.array([[x, y, x + w, y + h] for x, y, w, h in rows], dtype=np.float64).reshape(-1, 4)


def painted(boxes_px):
    """(N, 24, 24) bool: the unit cells that each box covers."""
    y, x = np.mgrid[0:24, 0:24]
    return np.array([(x >= a) & (x < c) & (y >= b) & (y < d) for a, b, c, d in boxes_px], dtype=bool).reshape(-1, 24, 24)


@given(boxes(), boxes())
def test_areas_and_overlaps_are_those_of_painted_cells(a, b):
    cells_a, cells_b = painted(a), painted(b)
    shared = (cells_a[:, None] & cells_b[None]).sum(axis=(2, 3))
    either = (cells_a[:, None] | cells_b[None]).sum(axis=(2, 3))
    smaller = np.minimum(cells_a.sum(axis=(1, 2))[:, None], cells_b.sum(axis=(1, 2))[None])
    np.testing.assert_allclose(areas(a), cells_a.sum(axis=(1, 2)))
    np.testing.assert_allclose(intersections(a, b), shared)
    np.testing.assert_allclose(iou(a, b), shared / np.maximum(either, 1))
    np.testing.assert_allclose(containment(a, b), shared / np.maximum(smaller, 1))


@given(boxes(), boxes())
def test_overlaps_are_shares_and_do_not_depend_on_the_order(a, b):
    for measure in (iou, containment):
        values = measure(a, b)
        assert ((values >= 0) & (values <= 1 + 1e-12)).all()
        np.testing.assert_allclose(values, measure(b, a).T)
    assert (iou(a, b) <= containment(a, b) + 1e-12).all()
    np.testing.assert_allclose(np.diag(iou(a, a)), 1.0)


def test_a_flat_box_has_no_area_and_overlaps_nothing():
    flat, other = np.array([[3.0, 3.0, 3.0, 9.0]]), np.array([[0.0, 0.0, 10.0, 10.0]])
    assert areas(flat)[0] == 0
    assert iou(flat, other)[0, 0] == 0
    assert np.isfinite(containment(flat, flat)).all()


def test_truncated_sides_are_left_top_right_bottom():
    whole, all_of_it = [100.0, 100.0, 200.0, 200.0], [0, 0, 640, 480]
    touching = np.array([whole, [0, 100, 200, 200], [100, 0, 200, 200], [100, 100, 639, 200], [100, 100, 200, 479], all_of_it], float)
    assert truncated_sides(touching, 640, 480).tolist() == [
        [False] * 4,
        [True, False, False, False],
        [False, True, False, False],
        [False, False, True, False],
        [False, False, False, True],
        [True] * 4,
    ]
    assert truncated_sides(np.zeros((0, 4)), 640, 480).shape == (0, 4)


def test_a_cut_box_that_ends_some_pixels_early_counts_as_cut():
    near, away = [4.0, 100.0, 90.0, 200.0], [30.0, 100.0, 90.0, 200.0]
    assert truncated_sides(np.array([near, away]), 640, 480)[:, 0].tolist() == [True, False]


# --- one thing, one box --------------------------------------------------------------------------------------------------------


def detections(rows, scores, labels=None):
    return Detections(np.array(rows, dtype=np.float64).reshape(-1, 4), labels or ("cup",) * len(scores), np.array(scores, dtype=np.float64))


def test_of_boxes_on_one_place_the_best_stays_whatever_their_labels():
    found = detections([[0, 0, 100, 100], [5, 0, 100, 100], [200, 0, 300, 100]], [0.4, 0.8, 0.3], ("laptop", "monitor", "cup"))
    assert distinct(found, 0.7).tolist() == [False, True, True]


def test_equal_scores_keep_the_first():
    found = detections([[0, 0, 100, 100], [0, 0, 100, 100]], [0.5, 0.5])
    assert distinct(found, 0.7).tolist() == [True, False]


def test_a_box_that_was_dropped_drops_no_other():
    chain = detections([[0, 0, 100, 100], [20, 0, 120, 100], [40, 0, 140, 100]], [0.9, 0.8, 0.7])
    assert iou(chain.boxes_px, chain.boxes_px)[0, 2] < 0.6 < iou(chain.boxes_px, chain.boxes_px)[1, 2]
    assert distinct(chain, 0.6).tolist() == [True, False, True]


@given(boxes(8), st.integers(0, 2**31), st.floats(0.1, 1.0))
def test_what_is_kept_does_not_overlap_and_what_is_dropped_does(rows, seed, limit):
    scores = np.random.default_rng(seed).uniform(size=len(rows))
    keep = distinct(detections(rows, scores), limit)
    overlap = iou(rows, rows)
    kept = np.flatnonzero(keep)
    assert (overlap[np.ix_(kept, kept)] - np.eye(len(kept)) <= limit + 1e-12).all()
    for row in np.flatnonzero(~keep):
        assert any(overlap[row, other] > limit and scores[other] >= scores[row] for other in kept)


def observed(p_world, scores, scale=1.0):
    seen = tiny_observations(np.array(p_world, dtype=np.float64), ("cup",) * len(scores))
    object.__setattr__(seen, "scores", np.array(scores, dtype=np.float64))
    return seen


AT = np.array([1.2, 0.3, 0.9])


def test_two_bodies_cannot_fill_one_place():
    seen = observed([AT, AT + np.array([0.0, 0.02, 0.0])], [0.4, 0.6])
    assert coincident(seen).tolist() == [True, False]


def test_things_side_by_side_or_behind_each_other_stay_two():
    seen = observed([AT, AT + np.array([0.0, 0.13, 0.0])], [0.4, 0.6])
    assert coincident(seen).tolist() == [False, False]
    behind = observed([AT, AT + np.array([0.15, 0.0, 0.0])], [0.4, 0.6])
    assert containment(behind.boxes_px, behind.boxes_px)[0, 1] > 0.7  # the boxes alone would be one
    assert coincident(behind).tolist() == [False, False]


def test_a_small_thing_on_a_large_one_stays():
    seen = observed([AT, AT], [0.4, 0.6])
    seen.size_m[1] *= 3.0
    low, high = seen.boxes_px[1, :2].copy(), seen.boxes_px[1, 2:].copy()
    seen.boxes_px[1] = np.concatenate([2 * low - high, 2 * high - low])
    assert coincident(seen).tolist() == [False, False]


def test_none_and_one_observation_coincide_with_nothing():
    assert coincident(observed(np.zeros((0, 3)), [])).shape == (0,)
    assert coincident(observed([AT], [0.5])).tolist() == [False]
