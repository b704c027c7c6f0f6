"""The overlap benchmark on a small room: both sides agree, and pairs that do not touch share nothing."""

import numpy as np
import overlap


def test_all_sides_agree(monkeypatch):
    for name, value in {"OBSERVATIONS": 3, "OBJECTS": 40, "POINTS": 150, "OTHER_PAIRS": 5}.items():
        monkeypatch.setattr(overlap, name, value)
    row = overlap.measure(seed=1, rounds=1)
    assert row["max_difference_ours"] <= 1e-12
    assert row["largest_share_of_pairs_apart"] == 0.0
    assert 3 <= row["touching_pairs"] < 20
    assert row["mean_share_of_own"] > 0.1


def test_brute_force_counts_points_that_are_closer():
    near, far = np.array([[0.0, 0.0, 0.0]]), np.array([[0.02, 0.0, 0.0], [0.03, 0.0, 0.0]])
    assert overlap.exact_share(far, near) == 0.5
    name, share = overlap.flat_index_share()
    assert share(far, near) == 0.5
    assert name
