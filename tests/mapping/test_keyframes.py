"""A frame becomes a keyframe by distance, turn or time, whichever comes first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.config import KeyframeSettings
from seo_slam.geometry import exp
from seo_slam.mapping.keyframes import is_keyframe

LIMITS = KeyframeSettings(distance_m=0.1, angle_deg=5.0, period_s=0.5)


@pytest.mark.parametrize(
    ("turn_deg", "shift_m", "elapsed_s", "wanted"),
    [
        (0.0, 0.0, 0.0, False),
        (0.0, 0.099, 0.0, False),
        (0.0, 0.101, 0.0, True),
        (4.9, 0.0, 0.0, False),
        (5.1, 0.0, 0.0, True),
        (0.0, 0.0, 0.49, False),
        (0.0, 0.0, 0.5, True),
        (0.0, 0.0, 0.4999999, True),  # stamps are rounded
        (4.9, 0.099, 0.49, False),
        (180.0, 0.0, 0.0, True),
    ],
)
def test_any_limit_is_enough(turn_deg, shift_m, elapsed_s, wanted):
    T = exp([0.0, np.radians(turn_deg), 0.0, 0, 0, 0])
    T[:3, 3] = shift_m, 0.0, 0.0
    assert is_keyframe(T, elapsed_s, LIMITS) is wanted


@given(st.lists(st.floats(-3, 3), min_size=6, max_size=6), st.floats(0, 2), st.floats(0, 1))
def test_more_motion_or_time_never_undoes_a_keyframe(xi, elapsed_s, more_s):
    T = exp(xi)
    if is_keyframe(T, elapsed_s, LIMITS):
        assert is_keyframe(T, elapsed_s + more_s, LIMITS)
        farther = T.copy()
        farther[:3, 3] *= 1.5
        assert is_keyframe(farther, elapsed_s, LIMITS)
